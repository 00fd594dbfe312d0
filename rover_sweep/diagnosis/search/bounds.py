"""Nominal numbers at the end of their tolerance, where a value beyond it would fit better."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import exp

from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.nominal import Coordinate

MANY = 3  # numbers outside their tolerances, from which the model is wrong and not the numbers
COUNTS = 25.0  # drop of the cost from which the end of a tolerance is reported
WIDENED = 5.0  # factor on the distance of a bound from the start value
MEASURED = {
    "lag": "the servo's lag",
    "delay": "the steering's delay",
    "trim": "the steering's trim",
    "bias_ay": "the accelerometer's bias",
    "ln_ratio": "the ratio of front to rear cornering stiffness",
    "vy_lag": "the lag of the lateral velocity",
    "scale": "the steering scale (rad_per_us)",
    "vscale": "the scale of the speed",
    "imu_x": "the IMU's place along the rover",
    "imu_z": "the IMU's height",
    "da": "the place of the centre of gravity",
    "ln_h": "the height of the sprung mass",
    "ln_Ixx": "the roll inertia",
}
UNITS = {
    "lag": (1e3, "ms"),
    "delay": (1e3, "ms"),
    "trim": (1e3, "mrad"),
    "bias_ay": (1.0, "m/s^2"),
    "vy_lag": (1e3, "ms"),
    "imu_x": (1e3, "mm"),
    "imu_z": (1e3, "mm"),
    "da": (1e3, "mm"),
}
FIRST = ("delay", "lag")  # instruments before anything else


def at_the_end(problem: Problem, fitted: Fitted) -> dict[str, str]:
    """{number: sentence} of the nominal numbers at the end of their tolerances that fit better beyond.

    The delay comes first.
    """
    found = [c for c in _at_their_bounds(fitted) if c.low != 0.0 or fitted.x[c.name] > c.low]
    found.sort(key=lambda c: FIRST.index(c.name) if c.name in FIRST else len(FIRST))
    out = {}
    for c in found:
        freed = _freed(problem, fitted, c)
        if fitted.cost - freed.cost > COUNTS and _is_beyond(c, freed.x[c.name]):
            name = MEASURED[c.name]
            out[name] = (
                f"{name} is at the end of its normal tolerance ({_number(c.name, fitted.x)}) and fits better "
                f"at {_number(c.name, freed.x)}: measure it"
            )
    return out


def many_at_the_end(ends: Mapping[str, str]) -> tuple[str, ...]:
    """What it means that `MANY` or more numbers want to leave their tolerances together, () if fewer do."""
    if len(ends) < MANY:
        return ()
    return (
        f"{len(ends)} numbers fit better outside their tolerances ({', '.join(ends)}): the model lacks "
        "something else, or the runs and the vehicle file are not of one rover",
    )


def _is_beyond(c: Coordinate, value: float) -> bool:
    """True for a value outside the bounds by a tenth of their distance or more."""
    room = 0.1 * (c.high - c.low)
    return not c.low - room < value < c.high + room


def _number(name: str, x: Mapping[str, float]) -> str:
    if name in UNITS:
        factor, unit = UNITS[name]
        return f"{factor * x[name]:.3g} {unit}"
    value = exp(x[name]) - 1.0 if name.startswith("ln_") else x[name]
    return f"{100 * value:+.0f} %"


def cost_of(problem: Problem, fitted: Fitted) -> float:
    """Sum of squares, in the metric of `problem`, of the residual of a model fitted in another metric."""
    rows = problem.measured - problem.model(fitted.structure, fitted.x)
    return float(rows @ rows)


def _at_their_bounds(fitted: Fitted) -> Iterator[Coordinate]:
    for c, inside in zip(fitted.free, fitted.inside, strict=True):
        if c.name in MEASURED and not inside:
            yield c


def _freed(problem: Problem, fitted: Fitted, c: Coordinate) -> Fitted:
    """The fit with this coordinate's bounds widened."""
    low = c.low if c.low == 0.0 else c.start - WIDENED * (c.start - c.low)
    wide = replace(c, low=low, high=c.start + WIDENED * (c.high - c.start), prior=None)
    free = tuple(wide if one.name == c.name else one for one in fitted.free)
    return fit(problem, fitted.structure, free, fitted.x, known=fitted)
