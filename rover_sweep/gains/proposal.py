"""Current and proposed gains with their margins and step responses on the model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.gains.controller import (
    BEFORE,
    SECONDS,
    Step,
    feedback_response,
    forward_response,
    step_of,
    target_response,
)
from rover_sweep.gains.identified import Identified
from rover_sweep.gains.steering_chain import Autopilot, Gains, sampled_plant
from rover_sweep.gains.tuning import (
    MOST_CHANGE,
    SPEED_RANGE,
    Family,
    Margins,
    bandwidth,
    bound,
    bounds,
    design_gains,
    feed_forward,
    frequencies,
    margins,
    speeds_around,
    unbounded,
    why_none,
)

# Whether an identification supports gains, with the reasons as sentences.


Level = Literal["gains", "feed-forward only", "none"]
LEAST_CROSSOVER = 0.5  # rad/s: a slower loop needs more than 2 s to correct an error; a pilot is faster
SLOW_GYRO_HZ = 10.0  # below this the filter's lag exceeds 22 ms, as much as a servo's
OTHER_SPEEDS = (0.9, 1.1, 0.8, 1.2, 0.7, 0.6, 0.5)  # shares of the design speed, tried if it has no gains
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


MOST_CORNERS = 6  # parameters whose interval ends are combined: 64 corners per speed, 32 with Cf = Cr


@dataclass(frozen=True)
class AssessedGains:
    """Gains assessed on the model. margins: as identified, at the design speed; worst_gain, worst_phase: the
    lowest margin [dB], [deg] of the family and its member; bandwidth of r / target [rad/s]; steady:
    r / target without the integrator."""

    gains: Gains
    margins: Margins
    worst_gain: tuple[float, str]
    worst_phase: tuple[float, str]
    bandwidth: float
    steady: float
    step: Step


@dataclass(frozen=True, eq=False)
class Proposal:
    """Proposed gains for `speed` [m/s], None if not supported, and the current gains.

    speed_range: valid speed range [m/s]. steady_gain: r / road-wheel angle [1/s]; delay: of the model [s].
    feed_forwards: {speed [m/s]: FF of a steady turn there}.
    """

    found: Identified
    autopilot: Autopilot
    speed: float
    support: Support
    now: AssessedGains | None
    proposed: AssessedGains | None
    speed_range: tuple[float, float]
    steady_gain: float | None = None
    delay: float | None = None
    feed_forwards: Mapping[float, float] | None = None


def propose_gains(
    found: Identified, autopilot: Autopilot, speed: float | None = None, at_once: bool = False
) -> Proposal:
    """Gains for a design speed [m/s], by default that of the runs.

    at_once: give the designed gains in full, not a limited step from the current ones towards them.
    """
    at = speed or float(np.mean(found.speeds))
    speed_range = (min(speeds_around(at)), max(speeds_around(at)))
    support = supported(found, autopilot, at)
    if (
        found.structure is None
        or not found.has_servo  # margins without it would be too large, those of the present gains too
        or found.rad_per_us is None
        or autopilot.angle_per_output(found.rad_per_us) <= 0
    ):
        return Proposal(found, autopilot, at, support, None, None, speed_range)
    family = family_of(found, autopilot, at)
    support = _with_reach_remark(_stable(support, family), family)
    if any(not plant.stable for plant in family.plants):
        return Proposal(found, autopilot, at, support, None, None, speed_range)
    now = assess_gains(family, autopilot.gains)
    made = _supported_gains(support, family, unbounded(autopilot.gains))
    judged = assess_gains(family, made) if made else None
    if judged is None and support.level == "gains":
        support = replace(support, level="none", reasons=(_why_no_gains(found, family, at),))
    support, judged = _with_design_check(found, support, judged)
    if judged is not None and not at_once:
        support, judged = _step(support, family, judged)
    if judged is not None and support.level == "gains" and math.isnan(judged.step.rise):
        support = replace(support, remarks=(_short_step(judged), *support.remarks))
    values = found.structure.values
    return Proposal(
        found,
        autopilot,
        at,
        support,
        now,
        judged,
        speed_range,
        family.nominal.gain,
        sum(values[d] for d in found.structure.delays if d.startswith("tau")),
        {p.speed: feed_forward(family, p) for p in family.plants if p.label.startswith("as identified")},
    )


def family_of(found: Identified, autopilot: Autopilot, speed: float) -> Family:
    """All corners of the intervals at V, V / 1.5 and 1.5 V, for both sides of the servo."""
    assert found.structure is not None and found.rad_per_us is not None
    kept = dict(list(found.intervals.items())[:MOST_CORNERS])
    corners = list(replace(found, intervals=kept).spread())
    plants = tuple(
        sampled_plant(structure, v, autopilot, found.hidden, label)
        for v in speeds_around(speed)
        for label, structure in corners
    )
    mean = autopilot.angle_per_output(found.rad_per_us)
    sides = {abs(found.rad_per_us) * us for us in (autopilot.us_right, autopilot.us_left)}
    return Family(plants, (mean, *sorted(sides - {mean})), autopilot)


def assess_gains(family: Family, gains: Gains) -> AssessedGains:
    """Assess gains on the family: margins, bandwidth and step."""
    loop, plant = family.autopilot, family.nominal
    w = frequencies(loop.period)
    one = (np.array([gains.p]), np.array([gains.i]))
    feedback = feedback_response(gains, *one, loop.period, w)[0]
    found = [
        (margins(feedback * p.response(w) * angle, w), f"{p.speed:.2f} m/s, {p.label}")
        for p, angle in family.loop_gains()
    ]
    gain = min(((m.gain_db, where) for m, where in found), key=lambda pair: pair[0])
    phase = min(((m.phase_deg, where) for m, where in found), key=lambda pair: pair[0])
    path = plant.response(w) * family.loop_gains()[0][1]
    forward = forward_response(gains, gains.ff, loop.period, w)
    closed = target_response(gains, loop.period, w) * path * (forward + feedback) / (1 + path * feedback)
    unity = gains.ff / feed_forward(family)
    share = gains.p / feed_forward(family)
    step = step_of(loop, plant, family.angle_per_output[0], gains)
    return AssessedGains(
        gains, found[0][0], gain, phase, bandwidth(closed, w), (unity + share) / (1 + share), step
    )


def _supported_gains(support: Support, family: Family, most: Gains) -> Gains | None:
    """The gains at the supported level up to `most`; None if unsupported or if no pair keeps the margins."""
    now = family.autopilot.gains
    if support.level == "none":
        return None
    if support.level == "feed-forward only":
        return replace(now, ff=round(min(feed_forward(family), most.ff), 3))
    return design_gains(family, now, most)


def _step(support: Support, family: Family, designed: AssessedGains) -> tuple[Support, AssessedGains | None]:
    """The step from the current gains to the designed ones, with a remark if it is not the whole way."""
    now = family.autopilot.gains
    before, most = now.parameters, bounds(now).parameters
    beyond = [
        f"{name} from {before[name]:.3g} to {most[name]:.3g} now (the design is {value:.3g})"
        for name, value in designed.gains.parameters.items()
        if value > most[name]
    ]
    if not beyond:
        return support, designed
    made = _supported_gains(support, family, bounds(now))
    if made is None:
        why = f"no P and I keep 6 dB and 45 deg if none is raised by more than a factor of {MOST_CHANGE:g}"
        return replace(support, level="none", reasons=(why,)), None
    words = (
        f"one step raises no gain by more than a factor of {MOST_CHANGE:g}: {', '.join(beyond)}. Try it with "
        "the wheels off the ground, then at low speed; then compute again from the new gains"
    )
    return replace(support, remarks=(words, *support.remarks)), assess_gains(family, made)


def _short_step(judged: AssessedGains) -> str:
    return (
        f"with these gains a requested turn rate is not reached within {SECONDS - BEFORE:.1f} s (without I, "
        f"{100 * judged.steady:.0f} % of it): they are an intermediate step"
    )


def _why_no_gains(found: Identified, family: Family, speed: float) -> str:
    """Which requirement fails at this speed [m/s], and the next speed at which gains exist."""
    now = family.autopilot.gains
    why = why_none(family, now, unbounded(now))
    for share in OTHER_SPEEDS:
        other = round(share * speed, 1)
        if other > 0 and design_gains(family_of(found, family.autopilot, other), now, unbounded(now)):
            return f"{why}; at {other:g} m/s there are such gains (--speed {other:g})"
    return why


def _with_design_check(
    found: Identified, support: Support, judged: AssessedGains | None
) -> tuple[Support, AssessedGains | None]:
    """The support and the gains after checking the designed loop."""
    if support.level != "gains" or judged is None:
        return support, judged
    reasons = supported_loop(found, judged.margins)
    if reasons:
        return replace(support, level="none", reasons=reasons), None
    return replace(support, remarks=(*support.remarks, *extrapolated(found, judged.margins))), judged


def _with_reach_remark(support: Support, family: Family) -> Support:
    """Adds a remark if the steering stops, not the limit of the target, limit the turn rate."""
    plant, most = family.nominal, family.autopilot.rate_limit(family.nominal.speed)
    reach = min(plant.gain * abs(angle) for angle in family.angle_per_output)
    if reach >= most:
        return support
    words = (
        f"at {plant.speed:.3g} m/s the steering reaches its stops at {math.degrees(reach):.0f} deg/s, but "
        f"the firmware allows targets up to {math.degrees(most):.0f} deg/s: lower ATC_STR_RAT_MAX"
    )
    return replace(support, remarks=(*support.remarks, words))


def _stable(support: Support, family: Family) -> Support:
    bad = next((p for p in family.plants if not p.stable), None)
    if bad is None:
        return support
    why = f"the rover is unstable at {bad.speed:.3g} m/s ({bad.label}), above its critical speed"
    return replace(support, level="none", reasons=(*support.reasons, why))


# ATC_STR_RAT_MAX and ATC_TURN_MAX_G from the steering results: what the stops reach, what the runs
# confirm.


REACH = 0.9  # share of the turn rate at the stops: the rest is left for feedback


@dataclass(frozen=True)
class SteeringLimits:
    """rate_max: ATC_STR_RAT_MAX [deg/s], from the turn rate at the stops; turn_g: ATC_TURN_MAX_G [g], the
    largest lateral acceleration that the runs confirm, at most that at the stops; None if
    unknown. Neither is raised beyond `tuning.bound` at once. now_g: the current one."""

    rate_max: float
    turn_g: float | None
    reach: float
    confirmed_g: float | None
    now_g: float

    @property
    def lowers(self) -> bool:
        """True if turn_g is below the current value: a lack of evidence, no reason to lower it."""
        return self.turn_g is not None and self.turn_g < self.now_g


def steering_limits(proposal: Proposal) -> SteeringLimits | None:
    """The limits at the design speed; None without a proposal of gains."""
    found, loop, speed = proposal.found, proposal.autopilot, proposal.speed
    if proposal.proposed is None or proposal.steady_gain is None or found.rad_per_us is None:
        return None
    travel = min(loop.us_right, loop.us_left)
    per_us = abs(proposal.steady_gain * found.rad_per_us)
    reach = per_us * travel
    confirmed = None
    if found.largest_us is not None:
        confirmed = per_us * min(found.largest_us, travel) * speed / STANDARD_GRAVITY
    most_g = REACH * reach * speed / STANDARD_GRAVITY
    largest_g = bound("ATC_TURN_MAX_G", loop.lateral_g_max)
    turn_g = (
        None if confirmed is None else max(math.floor(100 * min(confirmed, most_g, largest_g)) / 100, 0.1)
    )
    rate = math.floor(math.degrees(REACH * reach))
    if loop.rate_max > 0:  # 0 is no limit
        rate = min(rate, math.floor(bound("ATC_STR_RAT_MAX", math.degrees(loop.rate_max))))
    return SteeringLimits(rate, turn_g, math.degrees(reach), confirmed, loop.lateral_g_max)
