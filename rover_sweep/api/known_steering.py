"""What `bench` measured of the steering as known parts of the model: not found again, and not mistaken.

Curve and band bend the commanded angle. A rate limit and play lie behind the servo's lag, which belongs to
the models: so the steering becomes the command that makes an ideal first-order servo of that lag turn the
wheels as limit and play let the real one turn them. A vehicle file without such numbers changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.material_sizes import MATERIAL
from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.data.vehicle_file import Measured, Vehicle

SURE = 1.645  # standard deviations of a 90 % interval's half
# effect: (its parameter, the number of the vehicle file, unit)
MEASURED = {
    "steering_asymmetry": ("e", "asymmetry", ""),
    "steering_nonlinearity": ("c3", "nonlinearity", " 1/rad^2"),
    "steering_deadband": ("w", "deadband", " rad"),
    "steering_backlash": ("b", "backlash", " rad"),
}
LAG, LIMIT = "servo_lag", "servo_rate_limit"
USUAL_LAG = 0.020  # s, where limit or play were measured and no lag: of an ordinary servo, at half load
LOADED, LEAST_LAG = 1.25, 0.005  # lag of a servo on the ground over that on blocks at the most; s
NO_LAG = 0.001  # s, below which a servo has as good as none
FINE = 0.0025  # s between two points of an angle that moves between two commands
SLOWEST = 40.0  # Hz: where a servo went between commands that are further apart is not known


@dataclass(frozen=True)
class Known:
    """What a bench settles for a diagnosis. settled: {effect: why it is not looked for}; spread: with the
    measured lag, and what a servo under load may have more, as the bound of the servo's."""

    settled: Mapping[str, str]
    spread: Tolerances


def has_linkage(vehicle: Vehicle) -> bool:
    """Whether a curve, a band, play or a rate limit stands in the vehicle file."""
    return any(number.value for number in _numbers(vehicle).values()) or vehicle.servo_rate_limit is not None


def through_linkage(run: Recording, vehicle: Vehicle) -> Recording:
    """The run with the angle `delta` that the measured steering asks of a servo with nothing but a lag; as it
    is where nothing was measured."""
    if not has_linkage(vehicle):
        return run
    from rover_sweep.bench.linkage import curve, wheel_behind_gap

    delta, q = run["delta"], {p: n.value for p, n in _numbers(vehicle).items()}
    wanted = curve(delta.x, q.get("e", 0.0), q.get("c3", 0.0), q.get("w", 0.0))
    gap, limit = q.get("b", 0.0), vehicle.servo_rate_limit
    if not gap and limit is None:
        found = replace(delta, x=wanted)
    elif delta.rate < SLOWEST:
        found = replace(delta, x=wheel_behind_gap(wanted, gap))
    else:
        lag = vehicle.servo_lag.value if vehicle.servo_lag is not None else USUAL_LAG
        found = behind_servo(replace(delta, x=wanted), lag, 1.0 / limit.value if limit else 0.0, gap)
    return replace(run, channels={**run.channels, "delta": found})


def behind_servo(wanted: Signal, lag: float, slowness: float, gap: float) -> Signal:
    """The staircase that a first-order lag [s] alone follows as a servo with that lag, a rate limit
    1/slowness [rad/s] and play of half gap [rad] behind it follows `wanted` [rad, a staircase]."""
    from rover_sweep.bench.linkage import driven

    t = _finer(wanted.t)
    wheel = driven(wanted.t, wanted.x, t, lag, slowness, gap, 0.0)
    if lag <= NO_LAG:
        return replace(wanted, t=t, x=wheel)
    left = np.exp(-np.diff(t) / lag)  # of an error, after each interval
    asked = (wheel[1:] - left * wheel[:-1]) / (1.0 - left)
    return replace(wanted, t=t, x=np.append(asked, wheel[-1]))


def _finer(t: Array) -> Array:
    """Every interval of t (n,) s in equal parts of at most `FINE`."""
    parts = np.ceil(np.diff(t) / FINE).astype(int)
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(np.repeat(t[:-1], parts) + within * np.repeat(np.diff(t) / parts, parts), t[-1])


def known(vehicle: Vehicle, spread: Tolerances) -> Known:
    """What the vehicle file's [steering] settles; spread: what an ordinary rover has, [material] in it.

    An effect is settled where what its measurement leaves open is less than what counts as a finding.
    """
    from rover_sweep.diagnosis.effects import library
    from rover_sweep.diagnosis.search.material import material_sizes

    settled = {}
    for effect, (parameter, key, unit) in MEASURED.items():
        number: Measured | None = getattr(vehicle, key)
        counts = material_sizes(library()[effect], spread).get(parameter, 0.0)
        if number is not None and number.sd is not None and SURE * number.sd < counts:
            settled[effect] = f"the bench measured {key} {number}{unit}, and the steering is used with it"
    limit = vehicle.servo_rate_limit
    counts = material_sizes(library()[LIMIT], spread)["R"]  # s/rad, of 1/R
    if limit is not None and limit.sd is not None and SURE * limit.sd / limit.value**2 < counts:
        settled[LIMIT] = f"the bench measured {LIMIT} {limit} rad/s, and the steering is used with it"
    lag, usual = vehicle.servo_lag, MATERIAL[LAG].default
    chosen = vehicle.material.get(LAG, usual) != usual  # by hand, in [material]
    if chosen or lag is None or lag.sd is None or SURE * lag.sd > 0.25 * spread.lag:
        return Known(settled, spread)
    settled[LAG] = f"the bench measured {LAG} {lag} s, and the model's servo has at most a little more"
    bound = max(LOADED * lag.value + 2.0 * lag.sd, LEAST_LAG)
    return Known(settled, replace(spread, lag=bound, together=spread.together + bound - spread.lag))


def _numbers(vehicle: Vehicle) -> dict[str, Measured]:
    """{parameter: number} of curve, band and play that the file has."""
    found = {parameter: getattr(vehicle, key) for parameter, key, _ in MEASURED.values()}
    return {parameter: number for parameter, number in found.items() if number is not None}
