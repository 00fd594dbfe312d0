"""Normal tolerances of a rover: the material size of an effect, and nominal numbers at their ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import exp

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.candidates import Model, added_coordinates
from rover_sweep.diagnosis.simulation.nominal import Coordinate

LAGS = ("servo_lag", "transport_delay")
EARLIER = 0.008  # s, least time that these runs show: the motion before its command, a servo's swinging
COUNTS = 25.0  # drop of the cost from which the end of a tolerance is reported
MEASURED = {  # number of the nominal model: (in words, its factor, its unit)
    "delay": ("the steering's delay", 1e3, "ms"),
    "lag": ("the servo's lag", 1e3, "ms"),
    "scale": ("the steering scale (rad_per_us)", 100.0, "%"),
    "vscale": ("the scale of the speed", 100.0, "%"),
    "trim": ("the steering's trim", 1e3, "mrad"),
    "bias_ay": ("the accelerometer's bias", 1.0, "m/s^2"),
    "imu_x": ("the IMU's place along the rover", 1e3, "mm"),
    "imu_z": ("the IMU's height", 1e3, "mm"),
    "vy_lag": ("the lag of the lateral velocity", 1e3, "ms"),
    "ln_ratio": ("the ratio of front to rear cornering stiffness", 100.0, "%"),
    "da": ("the place of the centre of gravity", 1e3, "mm"),
    "ln_h": ("the height of the sprung mass", 100.0, "%"),
    "ln_Ixx": ("the roll inertia", 100.0, "%"),
}


def material_sizes(effect: Effect, spread: Tolerances, wheelbase: float) -> dict[str, float]:
    """{parameter: coordinate to exceed}: the effect's own material size, or a tolerance of the rover.

    wheelbase: of the rover, m.
    """
    moved: Mapping[str, Mapping[str, float]] = {
        "front_rear_stiffness": {"ratio": spread.ratio},
        "imu_offset": {"x": 2.0 * spread.imu_x * wheelbase, "z": 2.0 * spread.imu_z * wheelbase},
        "imu_tilt": {"roll": spread.bias_ay / GRAVITY},
        "steering_trim": {"u0": spread.trim},
        "velocity_lag": {"T": spread.velocity_lag},
    }
    return {
        name: size for name, size in {**effect.thresholds, **moved.get(effect.id, {})}.items() if size > 0
    }


def least_size(effect: Effect, parameter: EffectParameter, model: Model, x: Mapping[str, float]) -> float:
    """The coordinate of a parameter, without sign, from which its effect matters; 0 where every size does.

    x: {coordinate: value}. Lag and delay matter only where both together are above the normal tolerance.
    """
    if effect.id in LAGS:
        return model.spread.together - x["delay" if effect.id == "servo_lag" else "lag"]
    if effect.id == "clock_offset" and not model.two_clocks:
        return EARLIER
    return material_sizes(effect, model.spread, model.rover.wheelbase).get(parameter.name, 0.0)


def is_material(effect: str, model: Model, x: Mapping[str, float]) -> bool:
    """False where an effect of a fitted model is below its material size, or beyond 80 % of its bound.

    effect: its id. x: {coordinate: value}.
    """
    law = next(f for f in map(model.law, model.effects) if f.id == effect)
    limits = {c.name: max(abs(c.low), abs(c.high)) for c in added_coordinates(law)}
    if any(abs(x[name]) > 0.8 * limit for name, limit in limits.items() if not name.endswith(".t")):
        return False
    if law.name == "servo_lag/second order" and x["lag_shape"] > 1.0 and x["lag"] > EARLIER:
        return True  # it swings more than usual, with a damping ratio below 0.5
    if effect in LAGS:
        return x["lag"] + x["delay"] > model.spread.together
    if effect == "clock_offset" and not model.two_clocks:
        return x["delay"] < -EARLIER
    return law.exceeds(x, material_sizes(law, model.spread, model.rover.wheelbase))


def at_the_end(problem: Problem, fitted: Fitted) -> dict[str, str]:
    """{number: sentence} of the nominal numbers at the end of their tolerances that fit better beyond.

    Beyond: by a tenth of the tolerance or more. Delay and lag come first: instruments before anything else.
    """
    ends = {c.name: c for c, inside in zip(fitted.free, fitted.inside, strict=True) if not inside}
    out = {}
    for name, (words, factor, unit) in MEASURED.items():
        c = ends.get(name)
        if c is None or (c.low == 0.0 and fitted.x[name] <= c.low):
            continue
        freed, room = _freed(problem, fitted, c), 0.1 * (c.high - c.low)
        if fitted.cost - freed.cost > COUNTS and not c.low - room < freed.x[name] < c.high + room:
            now, better = (
                exp(v) - 1.0 if name.startswith("ln_") else v for v in (fitted.x[name], freed.x[name])
            )
            digits = "+.0f" if unit == "%" else ".3g"
            out[name] = (
                f"{words} is at the end of its normal tolerance ({factor * now:{digits}} {unit}) and fits "
                f"better at {factor * better:{digits}} {unit}: measure it"
            )
    return out


def many_at_the_end(ends: Mapping[str, str]) -> tuple[str, ...]:
    """What it means that three or more numbers want to leave their tolerances together, () if fewer do."""
    if len(ends) < 3:
        return ()
    return (
        f"{len(ends)} numbers fit better outside their tolerances ({', '.join(ends)}): the model lacks "
        "something else, or the runs and the vehicle file are not of one rover",
    )


def _freed(problem: Problem, fitted: Fitted, c: Coordinate) -> Fitted:
    """The fit with this coordinate's bounds five times as far from its start value."""
    low = c.low if c.low == 0.0 else c.start - 5.0 * (c.start - c.low)
    wide = replace(c, low=low, high=c.start + 5.0 * (c.high - c.start), prior=None)
    free = tuple(wide if one.name == c.name else one for one in fitted.free)
    return fit(problem, fitted.structure, free, fitted.x, known=fitted)
