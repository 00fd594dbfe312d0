"""A diagnosed model as a variant of the simulated rover: the TOML file that `--variant` reads.

Only the file format is shared with the simulation: names of numbers and effects, SI units, ISO axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite, sqrt

from rover_sweep.comparison.answer import ABSENT
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.table_law import TableLaw
from rover_sweep.errors import UsageError

# The forms of effects in the words and units of a variant file.


AS_FIRST = {"from then on", "one run"}  # changes of ground that the simulated rover has as its first form
LEAST_SHAPE = 1e-3  # of a second-order servo
OTHER_FORMS = {
    "surface_change": "the ground stays changed after that run, in the model only until its end",
    "surface_change/one run": "the ground stays changed after that run, in the model only during it",
    "surface_change/all along": "the grip drifts on at standstill, in the model only while driving",
}  # sentences on those that the simulated rover has otherwise


def in_plant_units(model: AugmentedModel, effect: Effect, values: Mapping[str, Value]) -> dict[str, Value]:
    """The parameters of an effect as the simulated rover has them, and the form if it is not the first."""
    out: dict[str, Value] = dict(values)
    numbers = model.numbers
    if effect.id == "steering_compliance":
        out = {"k": numbers["compliance"]}
    elif effect.id == "yaw_damping":
        out = {"c": numbers["yaw_damp"] + numbers["yaw_damp_v"]}
    elif effect.name == "servo_lag/second order":
        out |= {"q": max(model.value("lag_shape"), LEAST_SHAPE)}
    elif effect.name == "surface_change/one run":
        out |= {"t": 0.0}
    if out and not effect.first and effect.form not in AS_FIRST:
        out |= {"form": effect.form}
    return out


# The tables [[table_law]] of a variant file: the laws without a name of a diagnosed model.


IN_THE_PLANT = ("delta", "a_y", "r", "p", "phi", "beta", "v")  # quantities over which the plant has tables


def law_lines(law: TableLaw) -> list[str]:
    """One table as lines of TOML."""
    lines = ["[[table_law]]", f'place = "{law.place}"', f'over = "{law.over}"']
    for name, values in (("x", law.x), ("y", law.y)):
        lines.append(f"{name} = [{', '.join(repr(float(f'{v:.7g}')) for v in values)}]")
    lines += [f'times = "{law.times}"'] if law.times else []
    lines += [f"play = {law.size:.7g}"] if law.memory == "play" else []
    if law.memory == "resonance":
        lines += [f"frequency = {law.size:.7g}", f"damping = {law.damping:.7g}"]
    return lines


def _in_the_plant(law: TableLaw) -> bool:
    return not law.place.startswith("sensor") and law.over in IN_THE_PLANT and law.memory != "lag"


LINEAR_TYRES = 4.0  # friction of practically linear tyres, for a model without tyre saturation
BEND_ALIKE = 5.8  # friction^2 * bend for equal force loss of both tyre laws at half the axle load
NO_LIMIT = 100.0  # rad/s, servo rate limit if none was found
STIFF = 30.0  # cornering stiffness per axle load, 1/rad, for a model without slip
NEAR_NOTHING = 1e-9
AS_NUMBERS = {"tyre_slip", "roll_dof", "front_rear_stiffness"}  # effects that every plant has as numbers
SAME_NUMBER = {
    "servo_lag": "servo_lag",
    "transport_delay": "servo_delay",
    "velocity_lag": "velocity_lag",
    "servo_rate_limit": "servo_rate_limit",
}

Value = float | str | tuple[float, float, float]


def variant_text(model: AugmentedModel) -> str:
    """The variant as TOML text; comments at the top list what the plant cannot reproduce.

    UsageError for a lumped model.
    """
    if model.lumped:
        raise UsageError(
            "the simulated rover needs tyres and springs, which a lumped model does not have; "
            "diagnose with --baseline roll-yaw, bicycle or kinematic"
        )
    effects, trim = plant_effects(model), model.value("trim")
    exported = [  # the simulated rover's trim acts before the table
        replace(law, x=tuple(x - trim for x in law.x))
        if law.place == "steering" and law.memory != "resonance"
        else law
        for law in model.laws
        if _in_the_plant(law)
    ]
    same = {number for effect, number in SAME_NUMBER.items() if effect in effects}
    numbers = {name: value for name, value in _numbers(model).items() if name not in same}
    laws = [f"{len(exported)} laws without a name"] if exported else []
    found = ", ".join((*model.effects, *laws)) or "no further effects"
    lines = [
        f"# Rover diagnosed by rover-sweep: {model.baseline} model with {found}.",
        "# Everything else (noise, road, drive, estimator) is as in the nominal simulated rover.",
        *(f"# {sentence[0].upper()}{sentence[1:]}." for sentence in not_in_the_plant(model)),
        'base = "nominal"',
        "",
        *(f"{name} = {_toml(value)}" for name, value in numbers.items()),
    ]
    if effects:
        lines += ["", "[effects]"]
    for name, values in effects.items():
        inside = ", ".join(f"{key} = {_toml(value)}" for key, value in values.items())
        lines.append(f"{name} = {{ {inside} }}")
    for law in exported:
        lines += ["", *law_lines(law)]
    return "\n".join([*lines, ""])


def not_in_the_plant(model: AugmentedModel) -> list[str]:
    """Sentences on the parts of the model that the simulated rover does not have."""
    out, x = [], model.value
    if abs(x("vscale")) > 1e-4:
        times = f"{1 + x('vscale'):.4f}"
        out.append(f"the true speed is {times} times the logged one; this rover logs the true speed")
    lags = [(c, 1e3 * x(f"{c}_lag")) for c in ("ay", "p") if abs(x(f"{c}_lag")) > 1e-4]
    if lags:
        late = ", ".join(f"{c} by {ms:.1f} ms" for c, ms in lags)
        out.append(f"small lags of the channels relative to r are not included: {late}")
    if abs(x("vy_gain")) > 1e-3:
        out.append(
            f"the logged V_y is {1 + x('vy_gain'):.3f} times the true one; this rover logs the true V_y"
        )
    if x("lag_shape") > 0.01 and x("lag") > 1e-3 and "servo_lag/second order" not in model.effects:
        out.append("the servo is of second order; this rover's servo is of first order with the same lag")
    if not model.simulated.slip:
        out.append(
            "the model has no tyre slip: this rover has stiff tyres, and a + b is the effective wheelbase"
        )
    if not model.simulated.roll:
        out.append("the model does not roll: the centre of the sprung mass is on the roll axis")
    if model.simulated.slip and "tyre_saturation" not in {e.id for e in model.added}:
        out.append(
            "the model knows of no friction limit, so `friction` is not that of your ground: set it "
            "before driving to the limit"
        )
    out += [
        f"the law at the {law.place} over {law.over} is not included: this rover has no such table"
        for law in model.laws
        if not _in_the_plant(law)
    ]
    names = {effect.name for effect in model.added}
    out += [words for name, words in OTHER_FORMS.items() if name in names]
    if "clock_offset" in model.effects:
        out.append(
            "a redrive uses the log's time stamps as they are: its motion is later than the log's by T"
        )
    return out


def _numbers(model: AugmentedModel) -> dict[str, Value]:
    n, x = model.numbers, model.value
    rover, roll = model.rover, model.simulated.roll
    h, bend = n["h"] if roll else 0.0, x("bend")  # the tyres saturate as the model's do
    imu = n["imu_x"], n["imu_z"]
    if "imu_offset" in model.effects:  # the effect has the offset
        imu = rover.imu_x, rover.imu_z
    out: dict[str, Value] = {
        "mass": n["m"],
        "sprung_mass": n["ms"] or n["m"],
        **_axles(model, n),
        "cg_height_above_roll_centre": h,
        "yaw_inertia": n["Izz"] if model.simulated.slip else rover.yaw_inertia or n["m"] * n["a"] * n["b"],
        "roll_yaw_inertia": n["Ixz"] if roll else 0.0,
        "friction": min(LINEAR_TYRES, sqrt(BEND_ALIKE / bend)) if bend > 0 else LINEAR_TYRES,
        "servo_lag": x("lag"),
        "servo_delay": _delay(model),
        "servo_rate_limit": NO_LIMIT,
        "velocity_lag": x("vy_lag"),
        "imu_position": (imu[0], 0.0, h - imu[1]),
        "accel_bias": (0.0, 0.0 if "imu_tilt" in model.effects else -x("bias_ay"), 0.0),
    }
    if roll:
        out |= {"roll_inertia": n["Ixx"], "roll_stiffness": n["k_phi"], "roll_damping": n["b_phi"]}
    else:
        out |= {"road_roll_moment": 0.0}
    if model.steering:
        trim, scale = model.steering
        own = 0.0 if "steering_scale" in model.effects else x("scale")
        out |= {"steering_trim_us": trim, "rad_per_us": scale * (1.0 + own)}
    return out


def _axles(model: AugmentedModel, n: Mapping[str, float]) -> dict[str, Value]:
    """Positions and stiffness of the axles; for a model without slip, stiff and neutral-steering ones."""
    a, b, front, rear = n["a"], n["b"], n["Cf"], n["Cr"]
    if not model.simulated.slip:
        share = n["L_eff"] / (a + b)
        a, b = a * share, b * share
        weight = STIFF * n["m"] * n["g"] / (a + b)
        front, rear = weight * b, weight * a
    return {
        "cg_to_front_axle": a,
        "cg_to_rear_axle": b,
        "front_cornering_stiffness": front,
        "rear_cornering_stiffness": rear,
    }


def _delay(model: AugmentedModel) -> float:
    """Delay of the servo alone [s]: the simulated rover already adds the wait for the main loop."""
    from rover_sweep.diagnosis.effects.sensors import USUAL_DELAY

    whole = USUAL_DELAY if "clock_offset" in model.effects else model.value("delay")
    return max(whole - model.wait, 0.0)


def plant_effects(model: AugmentedModel) -> dict[str, dict[str, Value]]:
    """The table [effects]: the findings, and the trim error that every rover has."""
    out: dict[str, dict[str, Value]] = {}
    for effect in model.added:
        if effect.id in AS_NUMBERS:
            continue
        values: dict[str, Value] = {
            p: value
            for p, (value, _, _) in model.reported(effect).items()
            if isfinite(value) and abs(value) < ABSENT
        }
        if effect.id == "transport_delay":
            values["T"] = _delay(model)
        if effect.id == "steering_deadband":
            values["of"] = "command"
        if effect.in_one_run and model.happened_in:
            values["run"] = model.happened_in
        values = in_plant_units(model, effect, values)
        if values:
            out[effect.id] = values
    trim = model.value("trim")
    if "steering_trim" not in out and abs(trim) > NEAR_NOTHING:
        out["steering_trim"] = {"u0": trim}
    return out


def _toml(value: Value) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(part) for part in value) + "]"
    return repr(float(f"{value:.7g}"))
