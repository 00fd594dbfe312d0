"""The throttle sweeps as one self-contained page: answer and settings first, then the charts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

from rover_sweep.gains.speed_proposal import SpeedProposal
from rover_sweep.gains.steering_limits import SteeringLimits
from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.shown_chart import by_section, shown_chart
from rover_sweep.report.charts.throttle_chart import (
    speed_step_chart,
    throttle_response_chart,
    throttle_run_chart,
)
from rover_sweep.report.speed.speed_tables import (
    speed_gains_table,
    speed_margin_table,
    speed_parameter_table,
    throttle_run_table,
)
from rover_sweep.report.templates import environment
from rover_sweep.report.wording.effect_names import sentence
from rover_sweep.report.wording.provenance import versions

TONES = {"good": "good", "acceptable": "warn", "poor": "bad", "none": "bad"}


@dataclass(frozen=True, eq=False)
class SpeedFindings:
    """What the page shows. limits: of the steering, None without steering sweeps; current: the autopilot's
    parameters by name; steering: whether report.html is in the same folder."""

    result: SpeedResult
    proposal: SpeedProposal
    limits: SteeringLimits | None = None
    current: Mapping[str, float] = field(default_factory=dict)
    steering: bool = False


def speed_page(found: SpeedFindings) -> str:
    """The whole page."""
    result, proposal = found.result, found.proposal
    return (
        environment("report/speed")
        .get_template("speed.html.j2")
        .render(
            result=result,
            tone=TONES[result.level],
            proposal=proposal,
            answer=_answer(found),
            reasons=[sentence(words) for words in result.reasons],
            law=speed_parameter_table(result),
            settings=speed_gains_table(proposal, found.limits, found.current),
            margins=speed_margin_table(proposal),
            remarks=[sentence(words) for words in _remarks(proposal)],
            runs=throttle_run_table(result),
            steering=found.steering,
            versions=versions(),
            pictures=by_section([shown_chart(plan) for plan in _plans(found)]),
        )
    )


def _answer(found: SpeedFindings) -> str:
    """The one sentence of the page."""
    judged, low, high = found.proposal.proposed, found.result.speeds[0], found.result.speeds[2]
    if found.result.fit is None:
        return "The response of the speed to the throttle was not identified."
    if judged is None:
        return "The response of the speed was identified, but it supports no gains."
    if found.proposal.level != "gains":
        return "Only CRUISE_SPEED and CRUISE_THROTTLE can be computed."
    s, step = judged.settings, judged.step
    return (
        f"ATC_SPEED_P {s.p:.3g} and ATC_SPEED_I {s.i:.3g} for {low:.2f} to {high:.2f} m/s: predicted "
        f"overshoot {step.overshoot:.0f}\N{NO-BREAK SPACE}%, rise {step.rise:.2f} s, margins at least "
        f"{judged.worst_gain:.0f} dB and {judged.worst_phase:.0f} deg."
    )


def _remarks(proposal: SpeedProposal) -> Iterator[str]:
    if proposal.level != "none":  # the reasons are then those of the identification
        yield from proposal.reasons
    yield from proposal.remarks
    if proposal.now is not None and proposal.loop.assumed:
        yield f"assumed at the firmware's defaults: {', '.join(proposal.loop.assumed)}"


def _plans(found: SpeedFindings) -> Iterator[ChartPlan]:
    result, fit = found.result, found.result.fit
    for k, run in enumerate(result.runs):
        words = "Throttle and speed, measured and simulated by the law. Grey: not part of the fit."
        yield ChartPlan(f"throttle-{run.name}", "runs", words, partial(throttle_run_chart, run, fit, k))
    if fit is not None and (coherent := result.coherence) is not None:
        words = (
            "Response of the speed to the throttle, measured (Welch's averages) and of the law. Grey: "
            "coherence below 0.6."
        )
        yield ChartPlan("speed-response", "response", words, partial(throttle_response_chart, coherent, fit))
    if found.proposal.now is not None and found.proposal.proposed is not None:
        words = "Predicted by simulation of the firmware's speed loop around the law, with all its limits."
        yield ChartPlan("speed-step", "step", words, partial(speed_step_chart, found.proposal))
