"""The verdict of a diagnosis, its sentence, and what a reader must know to judge it."""

from __future__ import annotations

from collections.abc import Sequence

from rover_sweep.diagnosis.result import Finding, Unknown, Verdict
from rover_sweep.diagnosis.simulation.candidates import speeds_of
from rover_sweep.diagnosis.simulation.experiment import Experiment

SETTLED = 1.5  # variance of a row over that of noise, beyond which not all is explained


def verdict_of(
    findings: Sequence[Finding], left: Unknown | None, variance: float, stopped: bool = False
) -> Verdict:
    """variance: of a row that the model with all findings leaves, 1 at the noise floor."""
    if findings:
        return "partly explained" if left or stopped or variance > SETTLED else "explained"
    return "unexplained" if left or stopped else "none"


def sentence_of(
    findings: Sequence[Finding], left: Unknown | None, variance: float, stopped: bool = False
) -> str:
    """The whole answer in a sentence."""
    parts = [f.sentence for f in findings]
    if stopped:
        parts.append("stopped before all effects were tried: not the last word")
    elif left:
        parts.append(left.sentence)
    elif variance > SETTLED and findings:
        ratio = f"{variance**0.5:.1f} times the noise floor"
        parts.append(f"what is left is {ratio}, and no function of the state predicts it")
    return "; ".join(parts) or "nothing is missing: what is left of the recordings is at the noise floor"


def remarks_of(
    used: Sequence[Experiment], findings: Sequence[Finding], withdrawn: Sequence[str], bettered: bool = False
) -> tuple[str, ...]:
    """What the runs could not tell apart, and findings that a fresh run does not bear out."""
    out = []
    if len(speeds_of(used)) < 2:
        out.append("all runs have one speed: what lags as 1/V is not told from what lags in time")
    if len({round(run.amplitude, 2) for run in used}) < 2:
        out.append("all runs have one amplitude: what saturates is not told from what is linear")
    if withdrawn:
        why = ", less than a law without a name would" if bettered else " and leave too much"
        out.append(f"{', '.join(withdrawn)} fit a part of it{why}: no explanation")
    for finding in findings:
        worse = [h.run for h in finding.held_out if h.share_removed is not None and h.share_removed < 0]
        if worse:
            out.append(f"{finding.effect} is not borne out: with it the model is worse on {', '.join(worse)}")
    return tuple(out)
