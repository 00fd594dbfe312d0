"""The proposal as plain data for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from typing import Any

from rover_sweep.gains.check import SpeedCheck, SteeringCheck
from rover_sweep.gains.corner import Corner
from rover_sweep.gains.first import FirstFeedForward
from rover_sweep.gains.proposal import AssessedGains, Proposal, SteeringLimits
from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal


def gains_document(proposal: Proposal) -> dict[str, Any]:
    """The proposal; keys include units. "proposed" is null if `support.level` is "none"; infinity is null."""
    loop = proposal.autopilot
    document = {
        "format": "rover-sweep gains",
        "format_version": 1,
        "support": {
            "level": proposal.support.level,
            "reasons": list(proposal.support.reasons),
            "remarks": list(proposal.support.remarks),
        },
        "speed_m_s": proposal.speed,
        "holds_from_to_m_s": list(proposal.speed_range),
        "model": {
            "name": proposal.found.name,
            "level": proposal.found.level,
            "identified_at_m_s": list(proposal.found.speeds),
            "usable_band_of_r_rad_s": list(proposal.found.band) if proposal.found.band else None,
            "steady_r_per_angle_1_s": proposal.steady_gain,
            "delay_s": proposal.delay,
            "intervals_90": {name: list(ends) for name, ends in proposal.found.intervals.items()},
        },
        "autopilot": {
            "loop_rate_hz": loop.loop_hz,
            "gyro_filter_hz": loop.gyro_hz,
            "speed_scale_base_m_s": loop.scale_base,
            "speed_scale": loop.speed_scale(proposal.speed),
            "servo": loop.servo,
            "travel_us": {"right": loop.us_right, "left": loop.us_left},
            "assumed": list(loop.assumed),
        },
        "now": _judged(proposal.now),
        "proposed": _judged(proposal.proposed),
        "feed_forward_by_speed": [
            {"speed_m_s": v, "ATC_STR_RAT_FF": ff} for v, ff in (proposal.feed_forwards or {}).items()
        ],
    }
    return _finite(document)


def _judged(judged: AssessedGains | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    (gain, gain_at), (phase, phase_at) = judged.worst_gain, judged.worst_phase
    return {
        "parameters": judged.gains.parameters,
        "gain_margin_db": judged.margins.gain_db,
        "phase_margin_deg": judged.margins.phase_deg,
        "crossover_rad_s": judged.margins.crossover,
        "phase_crossover_rad_s": judged.margins.phase_crossover,
        "worst": {
            "gain_margin_db": gain,
            "gain_margin_at": gain_at,
            "phase_margin_deg": phase,
            "phase_margin_at": phase_at,
        },
        "bandwidth_rad_s": judged.bandwidth,
        "steady_without_integrator": judged.steady,
        "step": {f"{k}{_UNITS[k]}": v for k, v in asdict(judged.step).items()},
    }


_UNITS = {
    "size": "_rad_s",
    "rise": "_s",
    "overshoot": "_percent",
    "settling": "_s",
    "lag": "_s",
    "used": "_of_travel",
}


def _finite(value: Any) -> Any:
    """The value with null for every number that is not finite."""
    match value:
        case dict():
            return {k: _finite(v) for k, v in value.items()}
        case list():
            return [_finite(v) for v in value]
        case float():
            return value if math.isfinite(value) else None
    return value


# The proposal as a parameter file with a reason on every line. "NAME,value  # reason" is the form of a step
# of ArduPilot MethodicConfigurator; ground stations read it too.


def param_text(proposal: Proposal) -> str:
    """The text of the .param file; ValueError without proposed gains."""
    judged = proposal.proposed
    if judged is None:
        raise ValueError("there are no gains to write")
    loop, reasons = proposal.autopilot, _reasons(proposal, judged)
    lines = _lines(judged.gains.parameters, loop.gains.parameters, reasons, loop.assumed)
    return _with_heading(_heading(proposal, judged), lines)


def _lines(
    new: Mapping[str, float], now: Mapping[str, float], reasons: Mapping[str, str], assumed: Sequence[str]
) -> list[str]:
    """A line for each parameter with a reason, and what it was. assumed: those at the firmware's default."""
    out = []
    for name, why in ((name, reasons[name]) for name in new if name in reasons):
        same = f"{now[name]:.6g}" == f"{new[name]:.6g}"
        was = f"default {now[name]:g}" if name in assumed else "unchanged" if same else f"was {now[name]:.6g}"
        out.append(f"{name},{new[name]:.6g}  # {why} ({was})")
    return out


def _with_heading(heading: Sequence[str], lines: Sequence[str]) -> str:
    return "\n".join((*(f"# {line}" for line in heading), "", *lines)) + "\n"


def _heading(proposal: Proposal, judged: AssessedGains) -> tuple[str, ...]:
    """Heading lines: speed, conditions, margins, reasons and remarks."""
    loop, (low, high), margins = proposal.autopilot, proposal.speed_range, judged.margins
    lines = (
        f"Turn-rate gains for {proposal.speed:.2f} m/s, from the {proposal.found.name} model; valid from "
        f"{low:.2f} to {high:.2f} m/s.",
        f"Computed for MOT_SPD_SCA_BASE {loop.scale_base:g} m/s, SCHED_LOOP_RATE {loop.loop_hz:g} Hz, "
        f"INS_GYRO_FILTER {loop.gyro_hz:g} Hz and SERVO{loop.servo}_MIN, _TRIM, _MAX {_travel(proposal)}:",
        "compute them again if one of these changes.",
        f"By the model: gain margin {margins.gain_db:.1f} dB, phase margin {_degrees(margins.phase_deg)}; "
        f"worst within the intervals and these speeds: {judged.worst_gain[0]:.1f} dB, "
        f"{_degrees(judged.worst_phase[0])}.",
        *proposal.support.reasons,
        *proposal.support.remarks,
    )
    return (*lines, loop.assumed_words) if loop.assumed else lines


def _reasons(proposal: Proposal, judged: AssessedGains) -> dict[str, str]:
    """{parameter: reason} of the proposed parameters."""
    scale = proposal.autopilot.speed_scale(proposal.speed)
    forward = (
        f"r per road-wheel angle is {proposal.steady_gain:.3g} 1/s and the firmware scales steering by "
        f"{scale:.3g} at {proposal.speed:.2f} m/s{_other_speeds(proposal)}{_integrator(proposal, judged)}"
    )
    if proposal.support.level != "gains":
        return {"ATC_STR_RAT_FF": forward}
    with_p = f"crossover frequency {judged.margins.crossover:.2g} rad/s"
    return {
        "ATC_STR_RAT_FF": forward,
        "ATC_STR_RAT_P": with_p if judged.gains.p > 0 else "does not help with this delay and FF",
        "ATC_STR_RAT_I": "fastest correction of a disturbance (with P) within margins and 5 % overshoot",
        "ATC_STR_RAT_D": "would mainly pass the gyro's noise to the servo"
        if judged.gains.d == 0
        else "compensates part of the loop's lag, so that P and I can be larger",
        "ATC_STR_RAT_IMAX": "covers the error of FF at the largest turn rate and a trim error of 0.03 rad",
    }


def _other_speeds(proposal: Proposal) -> str:
    others = [(v, ff) for v, ff in (proposal.feed_forwards or {}).items() if v != proposal.speed]
    if not others:
        return ""
    here = (proposal.feed_forwards or {})[proposal.speed]
    elsewhere = ", ".join(f"{ff:.3f} at {v:.2g} m/s" for v, ff in sorted(others))
    return f": {here:.3f} holds a steady turn ({elsewhere})"


def _integrator(proposal: Proposal, judged: AssessedGains) -> str:
    right = (proposal.feed_forwards or {}).get(proposal.speed)
    return ", minus what the integrator supplies" if right and judged.gains.ff < 0.999 * right else ""


def _travel(proposal: Proposal) -> str:
    loop = proposal.autopilot
    right, left = (loop.us_left, loop.us_right) if loop.reversed else (loop.us_right, loop.us_left)
    return f"-{left:g}/0/+{right:g} us about the trim"


def _degrees(angle: float) -> str:
    return f"{angle:.0f} deg" if angle < 1e3 else "unlimited (the loop gain never reaches 1)"


# The proposal of the speed loop and the steering's limits as plain data for JSON.


def speed_gains_document(proposal: SpeedProposal) -> dict[str, Any]:
    """The proposal; "proposed" is null if level is "none"; infinity is null."""
    document = {
        "level": proposal.level,
        "reasons": list(proposal.reasons),
        "remarks": list(proposal.remarks),
        "speeds_m_s": list(proposal.found.speeds),
        "assumed_parameters": list(proposal.loop.assumed),
        "throttle_min_percent": proposal.throttle_min,
        "now": _assessed(proposal.now),
        "proposed": _assessed(proposal.proposed),
    }
    return _finite(document)


def limits_document(limits: SteeringLimits) -> dict[str, Any]:
    """The steering's limits, with their sources."""
    return {
        "parameters": {"ATC_STR_RAT_MAX": limits.rate_max, "ATC_TURN_MAX_G": limits.turn_g},
        "reach_deg_s": limits.reach,
        "confirmed_g": limits.confirmed_g,
    }


def corners_document(turns: Sequence[Corner]) -> list[dict[str, Any]]:
    """The 90 degree corners; distances in m, "leaves_m" and "returns_m" null inside the corridor."""
    units = {"speed": "speed_m_s", "gains": "gains", "rate": "rate_rad_s"}
    return [{units.get(k, f"{k}_m"): v for k, v in asdict(turn).items()} for turn in turns]


def _assessed(judged: AssessedSpeed | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    return {
        "parameters": judged.settings.parameters,
        "gain_margin_db": judged.margins.gain_db,
        "phase_margin_deg": judged.margins.phase_deg,
        "worst_gain_margin_db": judged.worst_gain,
        "worst_phase_margin_deg": judged.worst_phase,
        "crossover_rad_s": judged.margins.crossover,
        "step": asdict(judged.step),
    }


# The settings of the speed loop and the steering's limits as lines of a parameter file, a reason on each.


def speed_text(proposal: SpeedProposal) -> str:
    """The text for the .param file; ValueError without a proposal."""
    judged = proposal.proposed
    if judged is None:
        raise ValueError("there are no settings of the speed loop to write")
    loop, reasons = proposal.loop, _speed_reasons(proposal, judged)
    lines = _lines(judged.settings.parameters, loop.now.parameters, reasons, loop.assumed)
    if proposal.throttle_min is not None:
        was = f"(was {100 * loop.least:g})"
        why = "dead zone of the motor controller; counts in all modes, MANUAL too"
        lines.append(f"MOT_THR_MIN,{proposal.throttle_min:g}  # {why} {was}")
    margins, step = judged.margins, judged.step
    heading = (
        "Speed loop, from a throttle sweep. By the model: gain margin "
        f"{margins.gain_db:.1f} dB, phase margin {margins.phase_deg:.0f} deg; worst within the intervals: "
        f"{judged.worst_gain:.1f} dB, {judged.worst_phase:.0f} deg.",
        f"Predicted step of {step.size:.1f} m/s: overshoot {step.overshoot:.1f} %, rise {step.rise:.2f} s.",
        *proposal.reasons,
        *proposal.remarks,
    )
    return _with_heading(heading, lines)


def limits_text(limits: SteeringLimits, now: dict[str, float]) -> str:
    """Lines of ATC_STR_RAT_MAX and ATC_TURN_MAX_G, the latter a comment if it would be lowered. now: the
    current values by name, {} if unknown.
    """
    reasons = {
        "ATC_STR_RAT_MAX": (limits.rate_max, f"90 % of the {limits.reach:.0f} deg/s at the steering's stops"),
        "ATC_TURN_MAX_G": (
            limits.turn_g,
            "lateral acceleration that the runs confirm; a larger sweep may raise it",
        ),
    }
    off = {"ATC_TURN_MAX_G"} if limits.lowers else set[str]()
    was = {name: f" (was {value:g})" for name, value in now.items()}
    return "".join(
        f"{'# ' if name in off else ''}{name},{value:.6g}  # {why}{was.get(name, '')}\n"
        for name, (value, why) in reasons.items()
        if value is not None
    )


def _speed_reasons(proposal: SpeedProposal, judged: AssessedSpeed) -> dict[str, str]:
    """{parameter: reason} of the proposed parameters."""
    s = judged.settings
    cruise = {
        "CRUISE_SPEED": "mean speed of the sweeps (also the speed of missions, unless WP_SPEED is set)",
        "CRUISE_THROTTLE": f"holds {s.cruise_speed:.2f} m/s without feedback",
    }
    if proposal.level != "gains":
        return cruise
    return cruise | {
        "ATC_SPEED_P": f"crossover frequency {judged.margins.crossover:.2g} rad/s",
        "ATC_SPEED_I": "smallest error on steps and slopes (with P) within margins and 5 % overshoot",
        "ATC_SPEED_D": "would mainly pass the noise of the speed to the motor",
        "ATC_ACCEL_MAX": "three quarters of what drive and drag can do at these speeds",
    }


# The checks of logged drives as plain data for JSON.

BothChecks = tuple[Sequence[SteeringCheck], Sequence[SpeedCheck]]


def check_document(
    before: BothChecks, now: BothChecks, first: FirstFeedForward | None = None
) -> dict[str, Any]:
    """The checks of the drive before and of the present one, each of steering and speed. first: instead of
    them, the FF from a drive without the controller.

    Turn rates in rad/s, speeds in m/s, null for an unknown number.
    """
    own = ("achieved", "oscillation", "findings")
    names = (*own, "response", "limits", "predicted", "after")
    found = {
        when: {
            "steering": [
                {
                    "log": check.log.name,
                    "speed_m_s": check.speed,
                    "gains": check.autopilot.gains.parameters,
                    **{name: _plain(getattr(check, name)) for name in names},
                    "feed_forward": _ends(check.feed_forward),
                    "not_checked": list(check.skipped),
                }
                for check in steering
            ],
            "speed": [
                {
                    "log": check.log.name,
                    **{
                        name: _plain(getattr(check, name)) for name in ("achieved", "oscillation", "findings")
                    },
                    "cruise_throttle_percent": _ends(check.cruise),
                }
                for check in speed
            ],
        }
        for when, (steering, speed) in (("before", before), ("now", now))
    }
    document: dict[str, Any] = {"format": "rover-sweep gains check", "format_version": 1, **found}
    if first is not None:
        document["first"] = {**asdict(first), "next": first.next}
    return _finite(document)


def _ends(found: tuple[float, float, float] | None) -> dict[str, float] | None:
    return dict(zip(("value", "low", "high"), found, strict=True)) if found else None


def _plain(value: Any) -> Any:
    """A frozen value, several of them or None as plain data."""
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
