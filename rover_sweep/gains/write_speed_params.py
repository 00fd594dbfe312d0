"""The settings of the speed loop and the steering's limits as lines of a parameter file, a reason on each."""

from __future__ import annotations

from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal
from rover_sweep.gains.steering_limits import SteeringLimits


def speed_text(proposal: SpeedProposal) -> str:
    """The text for the .param file; ValueError without a proposal."""
    judged = proposal.proposed
    if judged is None:
        raise ValueError("there are no settings of the speed loop to write")
    now, reasons = proposal.loop.now.parameters, _reasons(proposal, judged)
    lines = [
        f"{name} {value:.6g}  # {reasons[name]}{_was(name, now[name], value, proposal)}"
        for name, value in judged.settings.parameters.items()
        if name in reasons
    ]
    if proposal.throttle_min is not None:
        was = f"(was {100 * proposal.loop.least:g})"
        why = "dead zone of the motor controller; counts in all modes, MANUAL too"
        lines.append(f"MOT_THR_MIN {proposal.throttle_min:g}  # {why} {was}")
    margins, step = judged.margins, judged.step
    heading = (
        "Speed loop, from a throttle sweep. By the model: gain margin "
        f"{margins.gain_db:.1f} dB, phase margin {margins.phase_deg:.0f} deg; worst within the intervals: "
        f"{judged.worst_gain:.1f} dB, {judged.worst_phase:.0f} deg.",
        f"Predicted step of {step.size:.1f} m/s: overshoot {step.overshoot:.1f} %, rise {step.rise:.2f} s.",
        *proposal.reasons,
        *proposal.remarks,
    )
    return "\n".join((*(f"# {line}" for line in heading), "", *lines)) + "\n"


def limits_text(limits: SteeringLimits, now: dict[str, float]) -> str:
    """Lines of ATC_STR_RAT_MAX and ATC_TURN_MAX_G, which is a comment where it would only lower. now: the
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
        f"{'# ' if name in off else ''}{name} {value:.6g}  # {why}{was.get(name, '')}\n"
        for name, (value, why) in reasons.items()
        if value is not None
    )


def _reasons(proposal: SpeedProposal, judged: AssessedSpeed) -> dict[str, str]:
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


def _was(name: str, now: float, value: float, proposal: SpeedProposal) -> str:
    if name in proposal.loop.assumed:
        return f" (default {now:g})"
    return " (unchanged)" if f"{now:.6g}" == f"{value:.6g}" else f" (was {now:.6g})"
