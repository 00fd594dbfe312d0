"""The proposal as a parameter file with a reason on every line, like `firmware_params/*.param`."""

from __future__ import annotations

from rover_sweep.gains.proposal import AssessedGains, Proposal


def param_text(proposal: Proposal) -> str:
    """The text of the .param file; ValueError without proposed gains."""
    judged = proposal.proposed
    if judged is None:
        raise ValueError("there are no gains to write")
    now, reasons = proposal.autopilot.gains.parameters, _reasons(proposal, judged)
    lines = [
        f"{name} {value:.6g}  # {reasons[name]}{_was(name, now[name], value, proposal)}"
        for name, value in judged.gains.parameters.items()
        if name in reasons
    ]
    return "\n".join((*(f"# {line}" for line in _heading(proposal, judged)), "", *lines)) + "\n"


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


def _was(name: str, now: float, value: float, proposal: Proposal) -> str:
    if name in proposal.autopilot.assumed:
        return f" (default {now:g})"
    return " (unchanged)" if f"{now:.6g}" == f"{value:.6g}" else f" (was {now:.6g})"


def _travel(proposal: Proposal) -> str:
    loop = proposal.autopilot
    right, left = (loop.us_left, loop.us_right) if loop.reversed else (loop.us_right, loop.us_left)
    return f"-{left:g}/0/+{right:g} us about the trim"


def _degrees(angle: float) -> str:
    return f"{angle:.0f} deg" if angle < 1e3 else "unlimited (the loop gain never reaches 1)"
