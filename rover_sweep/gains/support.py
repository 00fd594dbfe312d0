"""Whether an identification carries gains, in sentences: what it supports, and what it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from rover_sweep.gains.identified import Identified
from rover_sweep.gains.margins import Margins
from rover_sweep.gains.steering_chain import Autopilot
from rover_sweep.gains.tuning import SPEED_RANGE

Level = Literal["gains", "feed-forward only", "none"]
LEAST_CROSSOVER = 0.5  # rad/s: a slower loop takes longer than 2 s to correct anything; a pilot is faster
SLOW_GYRO_HZ = 10.0  # below it the filter's lag is above 22 ms, as much as a servo's
FULL_TRAVEL = 0.98  # of the servo's travel: a run that far was cut


@dataclass(frozen=True)
class Support:
    """level: what is supported; reasons: why not more; remarks: what must be known of what is."""

    level: Level
    reasons: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def supported(found: Identified, autopilot: Autopilot, speed: float) -> Support:
    """Before anything is computed. speed: wanted [m/s]."""
    if found.structure is None:
        return Support("none", ("there is no model to compute gains from", *found.reasons))
    none = [
        why
        for why in (
            _poor(found),
            _too_far(found, speed),
            _wrong_way(found, autopilot),
            _cut(found, autopilot),
        )
        if why
    ]
    if none:
        return Support("none", tuple(none), found.remarks)
    if found.kinematic:
        why = (
            "only the kinematic model was identified: it tells the steady turn rate, and so FF, but neither "
            "the tyres' lag that bounds P and I nor the understeer at other speeds"
        )
        return Support("feed-forward only", (why,), found.remarks)
    return Support("gains", (), (*found.remarks, *_conditions(autopilot, speed)))


def supported_loop(found: Identified, loop: Margins) -> tuple[str, ...]:
    """Reasons why a designed loop is not carried by the data after all."""
    reasons = []
    if found.band is not None and loop.crossover > found.band[1]:
        reasons.append(
            f"the loop would cross over at {loop.crossover:.1f} rad/s, where the response of the yaw rate "
            f"is not coherent (usable from {found.band[0]:.2g} to {found.band[1]:.3g} rad/s): sweep to a "
            "higher frequency"
        )
    if not loop.crossover >= LEAST_CROSSOVER:
        reasons.append(
            "delay and lag allow no loop worth having: with 6 dB and 45 deg it would cross over at "
            f"{loop.crossover:.2g} rad/s (least {LEAST_CROSSOVER:g}); shorten the delay (loop rate, gyro "
            "filter, servo)"
        )
    return tuple(reasons)


def extrapolated(found: Identified, loop: Margins) -> tuple[str, ...]:
    """A remark where the gain margin lies beyond the usable band."""
    if found.band is None or not loop.phase_crossover > found.band[1]:
        return ()
    return (
        f"the gain margin is the model's alone: the phase crosses -180 deg at {loop.phase_crossover:.1f} "
        f"rad/s, beyond the usable band (to {found.band[1]:.3g} rad/s)",
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
        f"{speed:.3g} m/s is too far from the runs: they carry gains for {low:.2g} to {high:.2g} m/s; "
        "drive a sweep at the speed that is wanted"
    )


def _wrong_way(found: Identified, autopilot: Autopilot) -> str | None:
    if found.rad_per_us is None:
        return "the road-wheel angle of a PWM is not known: give the vehicle file with [steering] rad_per_us"
    if autopilot.angle_per_output(found.rad_per_us) > 0:
        return None
    return (
        f"rad_per_us {found.rad_per_us:g} with SERVO{autopilot.servo}_REVERSED {int(autopilot.reversed)} "
        "steers left where the controller wants right: correct SERVO_REVERSED (or rad_per_us) first"
    )


def _cut(found: Identified, autopilot: Autopilot) -> str | None:
    least = min(autopilot.us_left, autopilot.us_right)
    if found.amplitude_us is None or found.amplitude_us < FULL_TRAVEL * least:
        return None
    return (
        f"all runs steered to the stops (amplitude {found.amplitude_us:.0f} us of {least:g} us): what was "
        "cut off looks like delay and lost gain; drive one with a smaller amplitude"
    )


def _conditions(autopilot: Autopilot, speed: float) -> tuple[str, ...]:
    said = []
    if not autopilot.integrates(speed):
        base = f"MOT_SPD_SCA_BASE {autopilot.scale_base:g} m/s"
        said.append(
            f"at {speed:.3g} m/s, at or below {base}, the firmware does not scale the steering and lets the "
            "integrator only shrink: I does nothing there"
        )
    if 0 < autopilot.gyro_hz < SLOW_GYRO_HZ:
        lag = 1000 * math.sqrt(2) / (2 * math.pi * autopilot.gyro_hz)
        said.append(
            f"INS_GYRO_FILTER {autopilot.gyro_hz:g} Hz holds the loop back by {lag:.0f} ms: raised to 20 Hz "
            "it allows a faster one (compute again)"
        )
    said += [
        f"{name} = {value:g} is set and not part of this computation"
        for name, value in autopilot.not_modelled.items()
    ]
    return tuple(said)
