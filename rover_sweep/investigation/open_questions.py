"""What a diagnosis leaves open: pairs of effects to separate, and bounds to lower.

The verdict `explained` is settled if
- no finding has a look-alike,
- the probability that all findings are right is at least `SURE`: the product of theirs, where they are known,
- held-out runs confirm each finding: the model with it predicts them better than without it.

The verdict `none` is settled if each effect is
excluded from the size that matters on. `partly explained` and `unexplained` are never settled.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log, prod

from rover_sweep.diagnosis.plans.next_run import OpenPoints, Pair
from rover_sweep.diagnosis.result import Diagnosis, Finding, UpperBound

SURE = 0.8  # probability of the findings; of single ones with 78 % and more, 75 to 97 % were right (README)
RIVALS = 3  # other effects that are considered where nothing names one
FOLLOWS = 0.3  # share of the largest gain, from which on an effect is considered


@dataclass(frozen=True)
class OpenQuestions:
    """points: for the choice of a run. why: what is open, a sentence without capital and stop; "" if nothing
    is. unchecked: findings that no held-out run has tested."""

    points: OpenPoints
    why: str = ""
    unchecked: tuple[str, ...] = ()


def open_questions(found: Diagnosis) -> OpenQuestions:
    """What the diagnosis leaves open."""
    if found.verdict == "none":
        return _bounds(found)
    if found.verdict == "explained":
        asked = _joined([_of_finding(f, found) for f in found.findings])
        return asked if asked.why else _of_all(found)
    left = (found.unknown.sentence if found.unknown else found.sentence).partition(";")[0]
    weak = tuple(f.effect for f in found.findings) or tuple(_strongest(found)[:1])
    points = OpenPoints(_unexplained(found), {}, weak)
    return OpenQuestions(points, f"a part of the residual has no name ({left})")


def _of_finding(finding: Finding, found: Diagnosis) -> OpenQuestions:
    effect = finding.effect
    if finding.look_alikes:
        others = " and ".join(finding.look_alikes)
        verb = "explains" if len(finding.look_alikes) == 1 else "explain"
        pairs = tuple((effect, other) for other in finding.look_alikes)
        return OpenQuestions(OpenPoints(pairs), f"{others} {verb} the runs as well as {effect}")
    if _refuted(finding):
        return OpenQuestions(_doubtful(effect, found), f"held-out data do not confirm {effect}")
    if not finding.held_out:
        return OpenQuestions(OpenPoints(), f"{effect} is not tested on a held-out run", (effect,))
    return OpenQuestions(OpenPoints())


def _refuted(finding: Finding) -> bool:
    """A held-out run is not predicted better with the finding. Where the residual of all of them is at the
    noise floor without it, the gain in chi-squared decides."""
    shares = [h.share_removed for h in finding.held_out if h.share_removed is not None]
    if shares:
        return any(share <= 0.0 for share in shares)
    return finding.evidence.get("held_out_gain", 1.0) <= 0.0


def _of_all(found: Diagnosis) -> OpenQuestions:
    """Whether all findings together are probable; if not, the least probable one is in question."""
    known = {f.effect: f.probability for f in found.findings if f.probability is not None}
    together = prod(known.values())
    if together >= SURE:
        return OpenQuestions(OpenPoints())
    least = min(known, key=lambda effect: known[effect])
    what = least if len(known) == 1 else f"all of {', '.join(known)}"
    return OpenQuestions(_doubtful(least, found), f"the probability of {what} is only {100 * together:.0f} %")


def _joined(parts: list[OpenQuestions]) -> OpenQuestions:
    pairs = tuple(dict.fromkeys(pair for part in parts for pair in part.points.pairs))
    why = "; ".join(part.why for part in parts if part.why)
    weak = tuple(effect for part in parts for effect in part.points.weak)
    return OpenQuestions(OpenPoints(pairs, {}, weak), why, tuple(e for part in parts for e in part.unchecked))


def _bounds(found: Diagnosis) -> OpenQuestions:
    """Effects that were not found, but may still be larger than the size that matters."""
    over = {
        unseen.effect: max(map(times_over, unseen.up_to.values()))
        for unseen in found.cannot_see
        if unseen.material and unseen.up_to
    }
    over = {effect: times for effect, times in over.items() if 1.0 < times < inf}
    if not over:
        return OpenQuestions(OpenPoints())
    why = f"no effect is missing, but {len(over)} may still be larger than the size that matters"
    return OpenQuestions(OpenPoints((), over), why)


def times_over(bound: UpperBound) -> float:
    """How far the bound exceeds the size that matters: 1 where they are equal, inf where that is not known.

    A ratio counts by its logarithm; of a parameter that is absent at infinity the reciprocal counts.
    """
    value, matters = bound.value, bound.matters
    if not value or not matters:
        return inf
    if bound.high is None:
        return abs(matters / value)
    if bound.low is not None and bound.low > 0.0 and matters > 0.0 and matters != 1.0:
        return abs(log(value) / log(matters))
    return abs(value / matters)


def _doubtful(effect: str, found: Diagnosis) -> OpenPoints:
    return OpenPoints(_rivals(effect, found), {}, (effect,))


def _rivals(effect: str, found: Diagnosis) -> tuple[Pair, ...]:
    """The finding with each of the strongest other effects."""
    named = {f.effect for f in found.findings}
    return tuple((effect, other) for other in _strongest(found) if other not in named)


def _unexplained(found: Diagnosis) -> tuple[Pair, ...]:
    """Each finding with its look-alikes and the strongest others; without a finding, the strongest ones."""
    if not found.findings:
        first, *others = _strongest(found) or [""]
        return tuple((first, other) for other in others)
    pairs = [(f.effect, other) for f in found.findings for other in f.look_alikes]
    return tuple(
        dict.fromkeys([*pairs, *(pair for f in found.findings for pair in _rivals(f.effect, found))])
    )


def _strongest(found: Diagnosis) -> list[str]:
    """Effects by their gain in the first round, the largest first."""
    ranked = sorted(found.scores, key=lambda effect: -found.scores[effect])
    least = FOLLOWS * max(found.scores.values(), default=0.0)
    return [effect for effect in ranked if found.scores[effect] >= least][: RIVALS + 1]
