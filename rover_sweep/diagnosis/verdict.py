"""The verdict of a diagnosis, its sentence, and remarks on the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rover_sweep.diagnosis.result import Finding, Unknown, Verdict
from rover_sweep.diagnosis.simulation.candidates import speeds_of
from rover_sweep.diagnosis.simulation.experiment import Experiment

SETTLED = 1.5  # mean square of the residual rows (noise: 1) up to which findings explain everything


def verdict_of(
    findings: Sequence[Finding],
    left: Unknown | None,
    variance: float,
    stopped: bool = False,
    worse: bool = False,
) -> Verdict:
    """The verdict. left: an unexplained misfit; variance: of a residual row with all findings, 1 is noise.

    worse: a channel of a held-out run is predicted worse than without the findings.
    """
    if findings:
        return "partly explained" if left or stopped or worse or variance > SETTLED else "explained"
    return "unexplained" if left or stopped else "none"


def sentence_of(
    findings: Sequence[Finding],
    left: Unknown | None,
    variance: float,
    stopped: bool = False,
    first: Sequence[str] = (),
    listed: bool = False,
    possible: Mapping[str, float] | None = None,
) -> str:
    """The answer in one sentence, the details are in `left`. first: what must be measured before any name.

    listed: effects that are present and do not matter are listed in the remarks. possible: {effect:
    probability} of those that are not sure enough for a name.
    The other arguments are those of `verdict_of`.
    """
    named = " and ".join(f.sentence.removesuffix(", ") for f in findings)
    rest = ""
    if stopped:
        rest = "the search was stopped before all effects were tried"
    elif left:
        rest = left.sentence.partition(";")[0]
    elif variance > SETTLED and findings:
        ratio = f"{variance**0.5:.1f} times the noise floor"
        rest = f"the remaining residual, which no function of the state predicts, is {ratio}"
    if named and rest:
        answer = f"{named}, explain{'s' if len(findings) == 1 else ''} a part, but {rest}"
    elif left and not stopped:
        answer = rest if "candidate" in rest else f"{rest}, and no candidate explains it"
    else:
        nothing = "nothing that matters was found" if listed else "these runs show no missing effect"
        answer = named or rest or f"{nothing}: the residual is at the noise floor"
        if possible and not named and not rest:
            best = max(possible, key=lambda e: possible[e])
            sure = 100 * possible[best]
            answer = f"no effect is sure enough for a name; the most probable is {best} ({sure:.0f} %)"
    begin, *others = (*first, answer)
    return ". ".join((begin, *(words[:1].upper() + words[1:] for words in others)))


def remarks_of(
    used: Sequence[Experiment],
    findings: Sequence[Finding],
    minor: Mapping[str, str],
    possible: Mapping[str, float],
    worse: Mapping[str, Sequence[str]],
) -> tuple[str, ...]:
    """Limits of the runs, and effects that are not named.

    minor: {effect: why it does not matter}. possible: {effect: probability}, of others. worse: {held-out
    run: channels that are predicted worse with the findings}.
    """
    out = []
    if len(speeds_of(used)) < 2:
        out.append("all runs have the same speed, so a lag over a distance looks like a lag in time")
    if len({round(run.amplitude, 2) for run in used}) < 2:
        out.append("all runs have the same amplitude, so saturation looks like a smaller linear gain")
    out += [f"{effect} is present and does not matter: {why}" for effect, why in minor.items()]
    out += [
        f"{effect} is possible ({100 * p:.0f} %), but not sure enough for a name"
        for effect, p in possible.items()
    ]
    out += [
        f"with the findings {', '.join(channels)} of {run} fits worse than without"
        for run, channels in worse.items()
    ]
    for finding in findings:
        failed = [h.run for h in finding.held_out if h.share_removed is not None and h.share_removed < 0]
        if failed:
            out.append(
                f"{finding.effect} is not confirmed: the model with it is worse on {', '.join(failed)}"
            )
    return tuple(out)
