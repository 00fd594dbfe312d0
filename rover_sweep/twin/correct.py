"""Corrects the numbers and effects of a simulated rover by the differences that a comparison found.

A correction is relative to the simulation: a new number is the old one plus (or times) the change from
simulation to recordings in the common model. So a bias of that model cancels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt
from typing import Any

from rover_sweep.comparison.answer import ABSENT, Comparison, Correction, Difference, Kind
from rover_sweep.data.results import Quantity
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.report.comparison_report import value_text
from rover_sweep.report.export.plant_variant import BEND_ALIKE, LINEAR_TYRES, plant_effects
from sitl.plant.effects_table import PARAMETERS
from sitl.plant.variant import PlantParameters, unit_of

Entry = Mapping[str, float | str]
Changes = dict[str, object]  # {field of PlantParameters: new value}
OTHER_UNITS = {"yaw_damping", "steering_compliance"}
WHY: Mapping[Kind, str] = {
    "number": "another number",
    "instrument": "another number of the instrument",
    "left out": "left out of the simulation",
    "too much": "not in the recordings",
    "size": "another size",
}
LEAST_BEND = BEND_ALIKE / LINEAR_TYRES**2
NOT_IN_THE_PLANT = {
    "lag_shape": "the second-order share of the servo's lag",
    "track": "the second track of wheels",
    "ay_lag": "a lag of the accelerometer alone",
    "p_lag": "a lag of the roll gyro alone",
    "heading": "a wrong heading of the estimator",
    "vy_gain": "a wrong scale of the estimator's V_y",
    "speed_scale": "a wrong scale of the logged speed",
}


@dataclass(frozen=True)
class Corrected:
    """The rover after a correction; left: sentences on uncorrectable differences."""

    parameters: PlantParameters
    corrections: tuple[Correction, ...]
    left: tuple[str, ...]


def corrected(rover: PlantParameters, found: Comparison, model: AugmentedModel) -> Corrected:
    """The rover corrected by all differences, small ones too. model: of the recordings, for new effects."""
    corrections: list[Correction] = []
    left: list[str] = []
    for d in (*found.differences, *found.minor):
        if d.name in NOT_IN_THE_PLANT:
            left.append(f"the simulated rover cannot have {NOT_IN_THE_PLANT[d.name]}: {d.sentence}")
            continue
        if d.name in _NUMBERS:
            try:
                numbers = _NUMBERS[d.name](rover, _change(rover, d))
                changed: PlantParameters | None = replace(rover, **numbers)  # type: ignore[arg-type]
            except ValueError:  # the new number is impossible beside the others
                changed = None
        else:
            changed = _with_effect(rover, d, model)
        if changed is None:
            left.append(f"this simulated rover has no such entry: {d.sentence}")
            continue
        corrections += _entries(rover, changed, d)
        rover = changed
    return Corrected(rover, tuple(corrections), tuple(left))


def halved(before: PlantParameters, by: Corrected) -> Corrected:
    """Half of each correction; added or removed effects are not halved."""
    after = by.parameters
    changed: Changes = {
        name: _between(one, two)
        for name, two in vars(after).items()
        if name not in ("effects", "laws") and (one := getattr(before, name)) != two
    }
    effects = {
        name: {
            p: _between(before.effects.get(name, entry).get(p, value), value) for p, value in entry.items()
        }
        for name, entry in after.effects.items()
    }
    rover = replace(after, **changed, effects=effects)  # type: ignore[arg-type]
    texts = {name: number_text(getattr(rover, name)) for name in changed}
    texts |= {f"effects.{name}": _entry_text(entry) for name, entry in rover.effects.items()}
    return Corrected(
        rover, tuple(replace(c, after=texts.get(c.entry, c.after)) for c in by.corrections), by.left
    )


def _between(one: Any, two: Any) -> Any:
    """The mean of two numbers, of their logarithms if both are above 0; else the second value."""
    if isinstance(two, tuple):
        return tuple(_between(a, b) for a, b in zip(one, two, strict=True))
    if not isinstance(one, float) or not isinstance(two, float):
        return two
    return sqrt(one * two) if one > 0.0 and two > 0.0 else 0.5 * (one + two)


def _entries(before: PlantParameters, after: PlantParameters, d: Difference) -> Iterator[Correction]:
    """What changed, entry by entry."""
    shown = value_text(d.recordings[0])
    if len(d.recordings) > 1:
        shown = "; ".join(f"{v.name} {value_text(v)}" for v in d.recordings)
    meaning = library()[d.name].title if d.name in library() else d.recordings[0].meaning
    why = f"{meaning or d.name}: {WHY[d.kind]}"  # without the size: the table has the values
    for name in vars(after):
        one, two = getattr(before, name), getattr(after, name)
        if name != "effects" and one != two:
            yield Correction(
                name, number_text(one), number_text(two), _in_plant(name, two, d) or shown, why, unit_of(name)
            )
    for name in {**before.effects, **after.effects}:
        one, two = before.effects.get(name), after.effects.get(name)
        if one != two:
            rules = PARAMETERS[name]
            units = ", ".join(rules[p].unit.strip() or "-" for p in two or one or {} if p in rules)
            yield Correction(f"effects.{name}", _entry_text(one), _entry_text(two), shown, why, units)


def _in_plant(name: str, value: object, d: Difference) -> str:
    """The recordings' value in the simulated rover's unit: the corrected one, with its interval.

    "" where the entry is not the quantity itself.
    """
    v = d.recordings[0]
    if not isinstance(value, float) or v.low is None or v.high is None or not v.value:
        return ""
    if name == "friction":  # it falls where the tyres bend more, and bend is what was compared
        bend = BEND_ALIKE / value**2
        times = bend / v.value if v.value > 0.0 else 1.0
        low, high = (_friction(bend + times * (end - v.value)) for end in (v.high, v.low))
        return value_text(replace(v, value=value, unit="", low=low, high=high))
    ends = (v.low / v.value, v.high / v.value) if d.relative else (v.low - v.value, v.high - v.value)
    low, high = (value * end if d.relative else value + end for end in ends)
    if name == "cg_to_rear_axle":  # it moves against the front one
        low, high = 2 * value - high, 2 * value - low
    return value_text(replace(v, value=value, low=low, high=high))


def number_text(value: object) -> str:
    """A value of a variant file with four digits."""
    if isinstance(value, tuple):
        return "[" + ", ".join(number_text(part) for part in value) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _entry_text(entry: Entry | None) -> str:
    return "" if entry is None else ", ".join(f"{name} {number_text(value)}" for name, value in entry.items())


def _change(rover: PlantParameters, d: Difference) -> float:
    """The change in the rover's own unit, or the factor.

    The fitted bend of a tyre depends on the slip that was driven, so it is corrected by a ratio.
    """
    one, two = d.simulation[0], d.recordings[0]
    if d.name == "tyre_bend" and one.low is not None and one.low > 0.0:
        return BEND_ALIKE / rover.friction**2 * (max(two.value, 0.0) / one.value - 1.0)
    return next(iter(d.change.values()))


def _times(*names: str) -> Callable[[PlantParameters, float], Changes]:
    return lambda rover, factor: {name: getattr(rover, name) * factor for name in names}


def _plus(name: str, effect: str = "", parameter: str = "T") -> Callable[[PlantParameters, float], Changes]:
    """Adds to a number that is never negative, or to the effect that replaces it."""

    def change(rover: PlantParameters, shift: float) -> Changes:
        if effect in rover.effects:
            entry = rover.effects[effect]
            whole = {**entry, parameter: max(float(entry.get(parameter, 0.0)) + shift, 0.0)}
            return {"effects": {**rover.effects, effect: whole}}
        return {name: max(getattr(rover, name) + shift, 0.0)}

    return change


def _trim(rover: PlantParameters, shift: float) -> Changes:
    now = float(rover.effects.get("steering_trim", {}).get("u0", 0.0))
    return {"effects": {**rover.effects, "steering_trim": {"u0": now + shift}}}


def _bend(rover: PlantParameters, shift: float) -> Changes:
    """The friction for `shift` more bend."""
    return {"friction": _friction(BEND_ALIKE / rover.friction**2 + shift)}


def _friction(bend: float) -> float:
    return sqrt(BEND_ALIKE / max(bend, LEAST_BEND))


def _centre_of_mass(rover: PlantParameters, shift: float) -> Changes:
    front, rear = rover.cg_to_front_axle + shift, rover.cg_to_rear_axle - shift
    return {"cg_to_front_axle": front, "cg_to_rear_axle": rear}


def _imu(forward: float, up: float) -> Callable[[PlantParameters, float], Changes]:
    def change(rover: PlantParameters, shift: float) -> Changes:
        x, y, down = rover.imu_position
        return {"imu_position": (x + forward * shift, y, down - up * shift)}

    return change


def _accelerometer(rover: PlantParameters, shift: float) -> Changes:
    x, y, z = rover.accel_bias
    return {"accel_bias": (x, y - shift, z)}  # right positive


_NUMBERS: Mapping[str, Callable[[PlantParameters, float], Changes]] = {
    "C": _times("front_cornering_stiffness", "rear_cornering_stiffness"),
    "Cf": _times("front_cornering_stiffness"),
    "Cr": _times("rear_cornering_stiffness"),
    "Izz": _times("yaw_inertia"),
    "L_eff": _times("cg_to_front_axle", "cg_to_rear_axle"),
    "k_phi": _times("roll_stiffness"),
    "b_phi": _times("roll_damping"),
    "h": _times("cg_height_above_roll_centre"),
    "Ixx": _times("roll_inertia"),
    "rad_per_us": _times("rad_per_us"),
    "servo_lag": _plus("servo_lag", "servo_lag"),
    "servo_delay": _plus("servo_delay", "transport_delay"),
    "velocity_lag": _plus("velocity_lag", "velocity_lag"),
    "steering_trim": _trim,
    "tyre_bend": _bend,
    "cg_to_front_axle": _centre_of_mass,
    "imu_x": _imu(1.0, 0.0),
    "imu_z": _imu(0.0, 1.0),
    "bias_ay": _accelerometer,
}


def _with_effect(rover: PlantParameters, d: Difference, model: AugmentedModel) -> PlantParameters | None:
    """The rover with an effect added, removed or changed in size."""
    effects = {name: entry for name, entry in rover.effects.items() if name != d.name}
    if d.kind != "too much":
        known = rover.effects.get(d.name)
        entry = _resized(known, d) if known else plant_effects(model).get(d.name) or _as_said(d)
        if not entry:
            return None
        effects[d.name] = entry  # type: ignore[assignment]
    return replace(rover, effects=effects)


def _as_said(d: Difference) -> Entry:
    """The effect as the comparison found it; empty if the simulated rover uses another unit."""
    if d.name in OTHER_UNITS or any(v.name not in PARAMETERS[d.name] for v in d.recordings):
        return {}
    return {v.name: v.value for v in d.recordings if abs(v.value) < ABSENT}


def _resized(entry: Entry, d: Difference) -> Entry:
    """The entry with each parameter moved by its difference to the recordings."""
    forms = {p.name: p.form for p in library()[d.name].parameters}
    out = dict(entry)
    for one, two in zip(d.simulation, d.recordings, strict=True):
        now = entry.get(one.name)
        if (
            isinstance(now, float)
            and (new := _moved(now, one, two, forms.get(one.name, "plain"))) is not None
        ):
            out[one.name] = new
    return out


def _moved(now: float, one: Quantity, two: Quantity, form: str) -> float | None:
    if form == "inverse":
        inverse = 1.0 / now + _inverse(two) - _inverse(one)
        return 1.0 / inverse if inverse > 0 else None
    new = now * two.value / one.value if form == "ratio" and one.value else now + two.value - one.value
    return new if isfinite(new) else None


def _inverse(v: Quantity) -> float:
    return 0.0 if v.value >= 1e5 or v.value == inf else 1.0 / v.value
