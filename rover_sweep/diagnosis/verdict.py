"""The verdict of a diagnosis, its sentence, remarks on the data, and how much a finding matters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rover_sweep.diagnosis.held_out.turn_impact import VISIBLE, Turn
from rover_sweep.diagnosis.result import Diagnosis, Finding, HeldOut, Unknown, Verdict
from rover_sweep.diagnosis.simulation.candidates import same_speed
from rover_sweep.diagnosis.simulation.experiment import Experiment

NOTABLE = 1.45  # mean square of the residual rows (noise: 1) from which something is left to explain


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
        return "partly explained" if left or stopped or worse or variance > NOTABLE else "explained"
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
    elif variance > NOTABLE:
        ratio = f"{variance**0.5:.1f} times the noise floor"
        rest = f"the remaining residual, which no function of the state predicts, is {ratio}"
    if named and rest:
        answer = f"{named}, explain{'s' if len(findings) == 1 else ''} a part, but {rest}"
    elif left and not stopped:
        answer = rest if "candidate" in rest else f"{rest}, and no candidate explains it"
    else:
        nothing = "nothing that matters was found" if listed else "these runs show no missing effect"
        answer = named or rest or f"{nothing}: over all frequencies, the residual is at the noise floor"
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
    by_speed = sorted(used, key=lambda run: run.mean_speed)
    if not used or same_speed(by_speed[0], by_speed[-1]):
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


def refuted_words(refuted: tuple[str, float]) -> str:
    """A sentence on (an effect that held-out runs refute, its probability in the other runs)."""
    effect, sure = refuted
    return (
        f"{effect} is not named: it fits the runs ({100 * sure:.0f} %), but the held-out runs are predicted "
        "worse with it, so it is something like it"
    )


def why_it_does_not_matter(absent: bool, turn: Turn | None = None, change: float = 1.0) -> str:
    """Why a probable effect is listed as present and not named, "" where it matters.

    absent: the 90 % intervals of its size hold no effect at all. turn: what it does to one, None where it has
    no part in it. change: of a channel in the runs, rms over rms.
    """
    if absent:
        return "the 90 % interval of its size includes zero"
    if turn is not None and not turn.visible and change < 2 * VISIBLE:
        return "it changes no turn visibly"
    return ""


def hardly_matters(held_out: Sequence[HeldOut]) -> bool:
    """True where J_rms falls by less than 5 % on every held-out run."""
    return bool(held_out) and all(h.before.j_rms - h.after.j_rms < 0.05 * h.before.j_rms for h in held_out)


def importance_words(f: Finding) -> str:
    """A sentence with the share of the held-out residual that the effect explains, "" without such runs."""
    if not f.held_out:
        return ""
    best = max(f.held_out, key=lambda h: h.share_removed if h.share_removed is not None else -np.inf)
    share = "" if best.share_removed is None else f"{100 * min(best.share_removed, 1.0):.0f} % of "
    fall = f"J_rms, with the noise: {best.before.j_rms:.2f} without it, {best.after.j_rms:.2f} with it"
    if best.share_removed is not None and best.share_removed <= 0:
        return f"It explains nothing of the residual above the noise on {best.run} ({fall})."
    words = f"It explains {share or 'little of '}the squared residual above the noise on {best.run} ({fall})"
    return f"{words}: it hardly matters, no repair is needed." if hardly_matters(f.held_out) else f"{words}."


def turn_change(found: Diagnosis) -> tuple[float, float] | None:
    """(later start [s] within 0.4 s, relative change) of the yaw rate by all findings; None without findings.

    By least squares from the simulated yaw rate of the first run, against the model without them.
    """
    overlay = next((o for o in found.overlays if o.channel == "r"), None)
    if overlay is None or not found.findings or overlay.t.size < 10:
        return None
    a, b = overlay.after - np.mean(overlay.after), overlay.before - np.mean(overlay.before)
    delays = np.linspace(-0.4, 0.4, 801)
    moved = [np.interp(overlay.t - d, overlay.t, b) for d in delays]
    gains = [float(m @ a) / max(float(m @ m), 1e-30) for m in moved]
    k = int(np.argmin([np.sum((a - g * m) ** 2) for g, m in zip(gains, moved, strict=True)]))
    return float(delays[k]), gains[k] - 1.0
