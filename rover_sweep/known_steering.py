"""What `bench` measured of the steering as known parts of the model: not found again, and not mistaken.

Curve, band and play turn the PWM into the angle that the linkage really gives. The play comes before the
servo's lag here and behind it on the rover, which changes little for a lag of some hundredths of a second. A
vehicle file without such numbers changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from rover_sweep.diagnosis.nominal import Spread
from rover_sweep.identify.recording import Recording
from rover_sweep.vehicle_file import Measured, Vehicle

SURE = 1.645  # standard deviations of a 90 % interval's half
# effect: (its parameter, the number of the vehicle file, unit)
MEASURED = {
    "steering_asymmetry": ("e", "asymmetry", ""),
    "steering_nonlinearity": ("c3", "nonlinearity", " 1/rad^2"),
    "steering_deadband": ("w", "deadband", " rad"),
    "steering_backlash": ("b", "backlash", " rad"),
}
LAG, LIMIT = "servo_lag", "servo_rate_limit"


@dataclass(frozen=True)
class Known:
    """What a bench settles for a diagnosis. settled: {effect: why it is not looked for}; spread: with the
    measured lag as the bound of the servo's."""

    settled: Mapping[str, str]
    spread: Spread


def has_linkage(vehicle: Vehicle) -> bool:
    """Whether a curve, a band or play stands in the vehicle file."""
    return any(number.value for number in _numbers(vehicle).values())


def through_linkage(run: Recording, vehicle: Vehicle) -> Recording:
    """The run with the angle `delta` that the measured linkage gives; as it is where nothing was measured."""
    q = {p: n.value for p, n in _numbers(vehicle).items() if n.value}
    if not q:
        return run
    from rover_sweep.bench.linkage import curve, play

    delta = run["delta"]
    wanted = curve(delta.x, q.get("e", 0.0), q.get("c3", 0.0), q.get("w", 0.0))
    return replace(run, channels={**run.channels, "delta": replace(delta, x=play(wanted, q.get("b", 0.0)))})


def known(vehicle: Vehicle, spread: Spread) -> Known:
    """What the vehicle file's [steering] settles; spread: what an ordinary rover has, [material] in it.

    An effect is settled where what its measurement leaves open is less than what counts as a finding.
    """
    from rover_sweep.diagnosis.material import material_sizes
    from rover_sweep.identify.effects import library

    settled = {}
    for effect, (parameter, key, unit) in MEASURED.items():
        number: Measured | None = getattr(vehicle, key)
        counts = material_sizes(library()[effect], spread).get(parameter, 0.0)
        if number is not None and number.sd is not None and SURE * number.sd < counts:
            settled[effect] = f"the bench measured {key} {number}{unit}, and the steering is used with it"
    limit = vehicle.servo_rate_limit
    counts = library()[LIMIT].material["R"]  # s/rad, of 1/R
    if limit is not None and limit.sd is not None and limit.value - SURE * limit.sd > 1.0 / counts:
        settled[LIMIT] = f"the bench measured {LIMIT} {limit} rad/s, faster than any that counts"
    lag = vehicle.servo_lag
    if lag is None or lag.sd is None or SURE * lag.sd > 0.25 * spread.lag or "servo_lag" in vehicle.material:
        return Known(settled, spread)
    settled[LAG] = f"the bench measured {LAG} {lag} s, and the model's servo has no more"
    bound = max(lag.value + 2.0 * lag.sd, 0.005)
    return Known(settled, replace(spread, lag=bound, together=spread.together + bound - spread.lag))


def _numbers(vehicle: Vehicle) -> dict[str, Measured]:
    """{parameter: number} of curve, band and play that the file has."""
    found = {parameter: getattr(vehicle, key) for parameter, key, _ in MEASURED.values()}
    return {parameter: number for parameter, number in found.items() if number is not None}
