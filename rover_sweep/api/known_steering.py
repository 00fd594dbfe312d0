"""The steering that `bench` measured, as a known part of the model, so that no diagnosis finds it again.

Gain curve and deadband change the commanded angle. Rate limit and backlash act behind the servo lag, which
is a part of the models. The steering is therefore replaced by a command: with it, an ideal first-order servo
of that lag turns the wheels as the real one with limit and backlash. A vehicle file without these numbers
changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.recording import Recording, Signal
from rover_sweep.data.results import NORMAL_90
from rover_sweep.data.vehicle_file import Measured, Vehicle
from rover_sweep.data.vehicle_rules import MATERIAL

# effect: (its parameter, the number of the vehicle file, unit)
MEASURED = {
    "steering_asymmetry": ("e", "asymmetry", ""),
    "steering_nonlinearity": ("c3", "nonlinearity", " 1/rad^2"),
    "steering_deadband": ("w", "deadband", " rad"),
    "steering_backlash": ("b", "backlash", " rad"),
}
LAG, LIMIT = "servo_lag", "servo_rate_limit"
USUAL_LAG = 0.020  # s, of a usual servo at half load, where limit or play were measured and no lag
LOADED, LEAST_LAG = (
    1.25,
    0.005,
)  # largest ratio of the lag on the ground to that on blocks; least bound of the lag [s]
NO_LAG = 0.001  # s; a smaller lag is neglected
FINE = 0.0025  # s, longest step of the angle between two commands
SLOWEST = 40.0  # Hz; between commands further apart the motion of the servo is unknown


@dataclass(frozen=True)
class Known:
    """The effects that a bench settles for a diagnosis.

    settled: {effect: why it is not looked for}. spread: normal tolerances; their bound of the servo lag is
    the measured lag plus its increase under load.
    """

    settled: Mapping[str, str]
    spread: Tolerances


def has_linkage(vehicle: Vehicle) -> bool:
    """Whether the vehicle file has a gain curve, a deadband, backlash or a rate limit."""
    return any(number.value for number in _numbers(vehicle).values()) or vehicle.servo_rate_limit is not None


def through_linkage(run: Recording, vehicle: Vehicle) -> Recording:
    """The run with the road-wheel angle `delta` [rad] as a command to a servo that has only a lag.

    The run itself if the vehicle file has no measured linkage.
    """
    if not has_linkage(vehicle):
        return run
    from rover_sweep.bench.static_curve import curve, wheel_behind_gap

    delta, q = run["delta"], {p: n.value for p, n in _numbers(vehicle).items()}
    wanted = curve(delta.x, q.get("e", 0.0), q.get("c3", 0.0), q.get("w", 0.0))
    gap, limit = q.get("b", 0.0), vehicle.servo_rate_limit
    if not gap and limit is None:
        found = replace(delta, x=wanted)
    elif run.manoeuvre("delta").rate < SLOWEST:
        found = replace(delta, x=wheel_behind_gap(wanted, gap))
    else:
        lag = vehicle.servo_lag.value if vehicle.servo_lag is not None else USUAL_LAG
        found = behind_servo(replace(delta, x=wanted), lag, 1.0 / limit.value if limit else 0.0, gap)
    return replace(run, channels={**run.channels, "delta": found})


def behind_servo(wanted: Signal, lag: float, slowness: float, gap: float) -> Signal:
    """The command [rad] to a first-order lag that gives the wheel angle of the real servo for `wanted`.

    wanted: commanded angle [rad], held between samples, as the result. The real servo has the lag [s], the
    rate limit 1/slowness [rad/s] and, behind it, backlash of half gap `gap` [rad].
    """
    from rover_sweep.bench.static_curve import driven

    parts = np.ceil(np.diff(wanted.t) / FINE).astype(int)  # every interval in equal parts of at most FINE
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    steps = np.repeat(np.diff(wanted.t) / parts, parts)
    t = np.append(np.repeat(wanted.t[:-1], parts) + within * steps, wanted.t[-1])
    wheel = driven(wanted.t, wanted.x, t, lag, slowness, gap, 0.0)
    if lag <= NO_LAG:
        return replace(wanted, t=t, x=wheel)
    left = np.exp(-np.diff(t) / lag)  # share of an error that is left after each interval
    asked = (wheel[1:] - left * wheel[:-1]) / (1.0 - left)
    return replace(wanted, t=t, x=np.append(asked, wheel[-1]))


def known(vehicle: Vehicle, spread: Tolerances) -> Known:
    """The effects that [steering] of the vehicle file settles; spread: normal tolerances, with [material].

    An effect is settled if the uncertainty of its measurement is smaller than the size that matters.
    """
    from rover_sweep.diagnosis.effects import library
    from rover_sweep.diagnosis.search import material_sizes

    settled = {}
    for effect, (parameter, key, unit) in MEASURED.items():
        number: Measured | None = getattr(vehicle, key)
        matters = material_sizes(library()[effect], spread, vehicle.wheelbase).get(parameter, 0.0)
        if number is not None and number.sd is not None and NORMAL_90 * number.sd < matters:
            settled[effect] = f"the bench measured {key} {number}{unit}, which the model includes"
    limit = vehicle.servo_rate_limit
    matters = material_sizes(library()[LIMIT], spread, vehicle.wheelbase)["R"]  # s/rad, of 1/R
    if limit is not None and limit.sd is not None and NORMAL_90 * limit.sd / limit.value**2 < matters:
        settled[LIMIT] = f"the bench measured {LIMIT} {limit} rad/s, which the model includes"
    lag, usual = vehicle.servo_lag, MATERIAL[LAG].default
    chosen = vehicle.material.get(LAG, usual) != usual  # set by hand in [material]
    if chosen or lag is None or lag.sd is None or NORMAL_90 * lag.sd > 0.25 * spread.lag:
        return Known(settled, spread)
    settled[LAG] = f"the bench measured {LAG} {lag} s, which bounds the servo lag of the model"
    bound = max(LOADED * lag.value + 2.0 * lag.sd, LEAST_LAG)
    return Known(settled, replace(spread, lag=bound, together=spread.together + bound - spread.lag))


def _numbers(vehicle: Vehicle) -> dict[str, Measured]:
    """{parameter: number} of the gain curve, deadband and backlash in the vehicle file."""
    found = {parameter: getattr(vehicle, key) for parameter, key, _ in MEASURED.values()}
    return {parameter: number for parameter, number in found.items() if number is not None}
