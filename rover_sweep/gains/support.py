"""Whether an identification supports gains, with the reasons as sentences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from rover_sweep.gains.identified import Identified
from rover_sweep.gains.margins import Margins
from rover_sweep.gains.steering_chain import Autopilot
from rover_sweep.gains.tuning import SPEED_RANGE

Level = Literal["gains", "feed-forward only", "none"]
LEAST_CROSSOVER = 0.5  # rad/s: a slower loop needs more than 2 s to correct an error; a pilot is faster
SLOW_GYRO_HZ = 10.0  # below this the filter's lag exceeds 22 ms, as much as a servo's
FULL_TRAVEL = 0.98  # of the servo's travel: a run with this amplitude reached the stops


@dataclass(frozen=True)
class Support:
    """level: supported gains; reasons: why not more; remarks: limits of the supported gains."""

    level: Level
    reasons: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def supported(found: Identified, autopilot: Autopilot, speed: float) -> Support:
    """The support before the design. speed: design speed [m/s]."""
    if found.structure is None:
        return Support("none", ("there is no model to compute gains from", *found.reasons))
    none = [
        why
        for why in (
            _poor(found),
            _too_far(found, speed),
            _wrong_way(found, autopilot),
            _clipped(found, autopilot),
            *found.doubts,
        )
        if why
    ]
    if none:
        return Support("none", tuple(none), found.remarks)
    if found.kinematic:
        why = (
            "only the kinematic model was identified: it gives the steady turn rate and so FF, but not the "
            "tyres' lag, which limits P and I, or the understeer at other speeds"
        )
        return Support("feed-forward only", (why,), found.remarks)
    return Support("gains", (), (*found.remarks, *_remarks(autopilot, speed)))


def supported_loop(found: Identified, loop: Margins) -> tuple[str, ...]:
    """Reasons why the data do not support a designed loop; empty if they do."""
    reasons = []
    if found.band is not None and loop.crossover > found.band[1]:
        reasons.append(
            f"the crossover frequency would be {loop.crossover:.1f} rad/s, where the yaw rate response is "
            f"not coherent (usable from {found.band[0]:.2g} to {found.band[1]:.3g} rad/s): sweep to a "
            "higher frequency"
        )
    if not loop.crossover >= LEAST_CROSSOVER:
        reasons.append(
            "delay and lag make the loop too slow: with 6 dB and 45 deg its crossover frequency is "
            f"{loop.crossover:.2g} rad/s (at least {LEAST_CROSSOVER:g} needed); reduce the delay (loop rate, "
            "gyro filter, servo)"
        )
    return tuple(reasons)


def extrapolated(found: Identified, loop: Margins) -> tuple[str, ...]:
    """A remark if the gain margin is outside the usable band."""
    if found.band is None or not loop.phase_crossover > found.band[1]:
        return ()
    return (
        f"the gain margin is extrapolated by the model: the phase crosses -180 deg at "
        f"{loop.phase_crossover:.1f} rad/s, above the usable band (to {found.band[1]:.3g} rad/s)",
    )


def _poor(found: Identified) -> str | None:
    if found.level in ("good", "acceptable"):
        return None
    because = f": {found.reasons[0]}" if found.reasons else ""
    return f"the {found.name} model is {found.level}{because}"


def _too_far(found: Identified, speed: float) -> str | None:
    low, high = min(found.speeds) / SPEED_RANGE, max(found.speeds) * SPEED_RANGE
    if low <= speed <= high:
        return None
    return (
        f"{speed:.3g} m/s is too far from the runs: they support gains for {low:.2g} to {high:.2g} m/s; "
        "drive a sweep at the design speed"
    )


def _wrong_way(found: Identified, autopilot: Autopilot) -> str | None:
    if found.rad_per_us is None:
        return (
            "the road-wheel angle per us of PWM is unknown: give the vehicle file with [steering] rad_per_us"
        )
    if autopilot.angle_per_output(found.rad_per_us) > 0:
        return None
    return (
        f"rad_per_us {found.rad_per_us:g} with SERVO{autopilot.servo}_REVERSED {int(autopilot.reversed)} "
        "steers left when the controller requests right: correct SERVO_REVERSED (or rad_per_us) first"
    )


def _clipped(found: Identified, autopilot: Autopilot) -> str | None:
    least = min(autopilot.us_left, autopilot.us_right)
    if found.amplitude_us is None or found.amplitude_us < FULL_TRAVEL * least:
        return None
    return (
        f"all runs steered to the stops (amplitude {found.amplitude_us:.0f} us of {least:g} us): this looks "
        "like delay and lower gain; drive a run with a smaller amplitude"
    )


def _remarks(autopilot: Autopilot, speed: float) -> tuple[str, ...]:
    remarks = []
    if not autopilot.integrates(speed):
        base = f"MOT_SPD_SCA_BASE {autopilot.scale_base:g} m/s"
        remarks.append(
            f"at {speed:.3g} m/s, at or below {base}, the firmware does not scale the steering and only lets "
            "the integrator shrink: I has no effect there"
        )
    if 0 < autopilot.gyro_hz < SLOW_GYRO_HZ:
        lag = 1000 * math.sqrt(2) / (2 * math.pi * autopilot.gyro_hz)
        remarks.append(
            f"INS_GYRO_FILTER {autopilot.gyro_hz:g} Hz delays the loop by {lag:.0f} ms: with 20 Hz "
            "it can be faster (then compute the gains again)"
        )
    remarks += [
        f"{name} = {value:g} is set but not included in this computation"
        for name, value in autopilot.not_modelled.items()
    ]
    return tuple(remarks)
