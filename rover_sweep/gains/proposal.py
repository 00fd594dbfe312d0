"""Current and proposed gains with their margins and step responses on the model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.gains.controller import feedback_response, forward_response, target_response
from rover_sweep.gains.identified import Identified
from rover_sweep.gains.margins import Margins, bandwidth, frequencies, margins
from rover_sweep.gains.steering_chain import Autopilot, Gains
from rover_sweep.gains.steering_plant import SampledPlant, sampled_plant
from rover_sweep.gains.step import Step, step_of
from rover_sweep.gains.support import Support, extrapolated, supported, supported_loop
from rover_sweep.gains.tuning import (
    MOST_CHANGE,
    Family,
    bounds,
    design_gains,
    feed_forward,
    speeds_around,
    unbounded,
)

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

    at_once: the designed gains, however far they are from the current ones, and not a step towards them.
    """
    at = speed or float(np.mean(found.speeds))
    speed_range = (min(speeds_around(at)), max(speeds_around(at)))
    support = supported(found, autopilot, at)
    if (
        found.structure is None
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
    support, judged = _with_design_check(found, support, judged)
    if judged is not None and not at_once:
        support, judged = _step(support, family, judged)
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
        {
            p.speed: _steady_feed_forward(family, p)
            for p in family.plants
            if p.label.startswith("as identified")
        },
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


def _with_design_check(
    found: Identified, support: Support, judged: AssessedGains | None
) -> tuple[Support, AssessedGains | None]:
    """The support and the gains after checking the designed loop."""
    if support.level != "gains":
        return support, judged
    if judged is None:
        why = "no P and I keep 6 dB and 45 deg for all parameter values within their intervals"
        return replace(support, level="none", reasons=(why,)), None
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


def _steady_feed_forward(family: Family, plant: SampledPlant) -> float:
    """FF of a steady turn at the plant's speed."""
    return 1.0 / (plant.gain * family.angle_per_output[0] * family.autopilot.speed_scale(plant.speed))
