"""A simulated rover's true parameters compared with the identified ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rover_sweep.identification.pipeline import Identification
    from rover_sweep.report.identification.comparison import Table
    from sitl.plant.variant import PlantParameters

_PHYSICAL = ("roll-yaw", "bicycle")  # models with physical parameters, whose true values are known


def truth_table(result: Identification, rover: PlantParameters) -> Table | None:
    """True and identified numbers, else the recommended physical model's parameters; None without any."""
    from rover_sweep.identification.acceptance import TITLES, usable
    from rover_sweep.report.identification.comparison import Cell, Table
    from rover_sweep.report.wording.number_format import change, number, symbol, unit

    models = usable(result)
    name = next((n for n in (result.recommended, *_PHYSICAL) if n in models and n in _PHYSICAL), None)
    if name is None:
        return None
    true = truth(rover)
    found = tuple(result.numbers) or tuple(e for e in models[name].fit.estimates if e.free)
    rows = tuple(
        (
            Cell(symbol(e.name)),
            Cell(unit(e.unit)),
            Cell(number(true[e.name])),
            Cell(number(e.value)),
            Cell(change(100 * (e.value / true[e.name] - 1)), "strong"),
        )
        for e in found
        if true.get(e.name)
    )
    tied = (
        "Cf = Cr: mean of both axles, at zero slip."
        if any(e.name == "C" for e in found)
        else "Cf, Cr: at zero slip."
    )
    note = (
        f"{tied} τ: lag and delay of the servo. The 90 % intervals below include a lag of the steering and "
        "the saturation of the tyres, and no other physics that the model leaves out."
    )
    if rover.effects:
        note += f" The rover also has effects that no model includes: {', '.join(rover.effects)}."
    column = "identified" if result.numbers else f"{TITLES[name]} model"
    headings = ("", "", "true", column, "difference %")
    return Table("True parameters of the simulated rover", headings, rows, note, 2)


def truth(rover: PlantParameters) -> dict[str, float]:
    """The plant's true parameters by the models' names, in SI units."""
    front, rear = rover.front_cornering_stiffness, rover.rear_cornering_stiffness
    return {
        "C": (front + rear) / 2,
        "Cf": front,
        "Cr": rear,
        "Izz": rover.yaw_inertia,
        "Ixx": rover.roll_inertia,
        "h": rover.cg_height_above_roll_centre,
        "k_phi": rover.roll_stiffness,
        "b_phi": rover.roll_damping,
        "tau": rover.servo_lag + rover.servo_delay,
    }
