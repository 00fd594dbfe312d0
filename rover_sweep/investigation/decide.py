"""The next step of an investigation: settled, used up, or one more run with the reason for it.

The smallest first set is one sweep, which shows most effects, and one doublet, which is held out and confirms
what the sweep shows. After that every run answers an open question of the diagnosis: the plan selects the run
with the most information on these explanations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, inf, log, log2, prod
from typing import Literal

from rover_sweep.diagnosis.plans.expected_posterior import NONE, OTHER
from rover_sweep.diagnosis.plans.plan import NAMED, Odds, RunValue, effects_of, in_words
from rover_sweep.diagnosis.plans.planner import PlannedRun, run_text
from rover_sweep.diagnosis.posterior.infer import SURE
from rover_sweep.diagnosis.problem.least_squares import COARSE
from rover_sweep.diagnosis.result import Diagnosis, Finding, UpperBound

# The decision after a diagnosis, as frozen values.


Action = Literal["drive", "settled", "used up", "open"]


@dataclass(frozen=True)
class NextStep:
    """What to do now, and why.

    action: "drive" `run`; "settled"; "used up": runs, ground or battery; "open": no run would tell more.
    reason: a sentence. effects: named by the diagnosis. run: only with "drive". bits: information that it is
    expected to give on the explanations, now as probable as `odds`; None if unknown.
    """

    action: Action
    reason: str
    effects: tuple[str, ...] = ()
    run: PlannedRun | None = None
    bits: float | None = None
    odds: Odds = field(default_factory=dict)


@dataclass(frozen=True)
class Means:
    """What is left to drive with. choices: the runs that limits and ground allow, may be empty.

    runs_left: number of runs. spent: why no further run is possible, "" while one is.
    """

    choices: tuple[PlannedRun, ...]
    runs_left: int
    spent: str = ""


# What a diagnosis leaves open: explanations with their probabilities.
#
# The verdict `explained` is settled if - no finding has a look-alike, - the probability that all findings
# are right is at least `SURE`: the product of theirs, where they are known, - held-out runs confirm each
# finding: the model with it predicts them better than without it.
#
# The verdict `none` is settled if each effect is excluded from the size that matters on, or no run is
# expected to tell more. `partly explained` and `unexplained` are never settled.


RIVALS = 3  # other effects that are considered where nothing names one
LEAST = 1e-3  # least probability that an explanation had before a run: probabilities have that precision
FOLLOWS = 0.3  # share of the largest gain, from which on an effect is considered


@dataclass(frozen=True)
class OpenQuestions:
    """odds: of the open explanations, for the choice of a run. why: what is open, a sentence without capital
    and stop; "" if nothing is. unchecked: findings that no held-out run has tested."""

    odds: Odds
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
    named = [f.effect for f in found.findings]
    odds = _odds(found, dict.fromkeys(named or _strongest(found)[:1], 0.0), _rivals(found))
    return OpenQuestions(odds, f"a part of the residual has no name ({left})")


def _of_finding(finding: Finding, found: Diagnosis) -> OpenQuestions:
    effect = finding.effect
    if finding.look_alikes:
        others = " and ".join(finding.look_alikes)
        verb = "explains" if len(finding.look_alikes) == 1 else "explain"
        share = {e: finding.evidence.get(f"probability:{e}", 0.0) for e in finding.look_alikes}
        odds = _odds(found, {effect: finding.probability or 0.0, **share}, ())
        return OpenQuestions(odds, f"{others} {verb} the runs as well as {effect}")
    # where the residual of all held-out runs is at the noise floor without it, chi-squared decides
    shares = [h.share_removed for h in finding.held_out if h.share_removed is not None]
    shares = shares or [finding.evidence.get("held_out_gain", 1.0)]
    if min(shares) <= 0.0:
        return OpenQuestions(_doubtful(finding, found), f"held-out data do not confirm {effect}")
    if not finding.held_out:
        return OpenQuestions({}, f"{effect} is not tested on a held-out run", (effect,))
    return OpenQuestions({})


def _of_all(found: Diagnosis) -> OpenQuestions:
    """Whether all findings together are probable; if not, tests the least probable one."""
    known = {f.effect: f.probability for f in found.findings if f.probability is not None}
    together = prod(known.values())
    if together >= SURE:
        return OpenQuestions({})
    least = min((f for f in found.findings if f.effect in known), key=lambda f: known[f.effect])
    what = least.effect if len(known) == 1 else f"all of {', '.join(known)}"
    return OpenQuestions(_doubtful(least, found), f"the probability of {what} is only {100 * together:.0f} %")


def _joined(parts: list[OpenQuestions]) -> OpenQuestions:
    odds = {e: p for part in parts for e, p in part.odds.items()}
    why = "; ".join(part.why for part in parts if part.why)
    return OpenQuestions(odds, why, tuple(e for part in parts for e in part.unchecked))


def _bounds(found: Diagnosis) -> OpenQuestions:
    """Effects that were not found, but may still be larger than the size that matters."""
    over = {
        unseen.effect: max(map(times_over, unseen.up_to.values()))
        for unseen in found.cannot_see
        if unseen.material and unseen.up_to
    }
    over = {effect: times for effect, times in over.items() if 1.0 < times < inf}
    if not over:
        return OpenQuestions({})
    why = f"no effect is missing, but {len(over)} may still be larger than the size that matters"
    return OpenQuestions(_odds(found, {}, tuple(over)), why)


def told(before: Odds, found: Diagnosis) -> float:
    """Information [bit] that the diagnosis adds to the probabilities `before`.

    The divergence of their probabilities now from those before (Lindley 1956). The plan predicts its mean
    over all outcomes of a run.
    """
    now = {f.effect: f.probability or 0.0 for f in found.findings}
    now |= {e: f.evidence.get(f"probability:{e}", 0.0) for f in found.findings for e in f.look_alikes}
    after = _odds(found, now, [e for e in before if e not in (NONE, OTHER, *now)])
    sums = sum(before.values()), sum(after.get(e, 0.0) for e in before)
    if min(sums) <= 0.0:
        return 0.0
    pairs = [(after.get(e, 0.0) / sums[1], max(p, LEAST) / sums[0]) for e, p in before.items()]
    return max(sum(a * log2(a / b) for a, b in pairs if a > 0.0), 0.0)


def times_over(bound: UpperBound) -> float:
    """The bound over the size that matters: 1 if they are equal, inf if that size is not known.

    For a ratio the logarithm counts; for a parameter that is infinite if absent, the reciprocal.
    """
    value, matters = bound.value, bound.matters
    if not value or not matters:
        return inf
    if bound.high is None:
        return abs(matters / value)
    if bound.low is not None and bound.low > 0.0 and matters > 0.0 and matters != 1.0:
        return abs(log(value) / log(matters))
    return abs(value / matters)


def _doubtful(finding: Finding, found: Diagnosis) -> Odds:
    return _odds(found, {finding.effect: finding.probability or 0.0}, _rivals(found))


def _odds(found: Diagnosis, known: Mapping[str, float], rivals: Sequence[str]) -> dict[str, float]:
    """{explanation: probability}: of none and of something else as diagnosed, of `known` effects as given.

    Rivals, and effects with the probability 0 (not known), share the rest by their drops of the cost, weighed
    as in `posterior.weights`.
    """
    odds = {NONE: found.p_none or 0.0, OTHER: found.p_else or 0.0, **known}
    open_now = [e for e, p in odds.items() if p == 0.0 and e in known] + [e for e in rivals if e not in known]
    most = max((found.scores.get(e, 0.0) for e in open_now), default=0.0)
    weights = {e: exp(0.5 * (found.scores.get(e, 0.0) - most) / COARSE) for e in open_now}
    rest = max(1.0 - sum(odds.values()), 0.0) / max(sum(weights.values()), 1.0)
    return odds | {e: rest * w for e, w in weights.items()}


def _rivals(found: Diagnosis) -> tuple[str, ...]:
    """The strongest effects that are not named."""
    named = {f.effect for f in found.findings}
    return tuple(e for e in _strongest(found) if e not in named)


def _strongest(found: Diagnosis) -> list[str]:
    """Effects by their gain alone, the largest first."""
    ranked = sorted(found.scores, key=lambda effect: -found.scores[effect])
    least = FOLLOWS * max(found.scores.values(), default=0.0)
    return [effect for effect in ranked if found.scores[effect] >= least][: RIVALS + 1]


CHECK = 0.6  # amplitude of the doublet over that of the sweep
SAME = 0.12  # relative; amplitudes and speeds that differ less count as equal
Ranking = Callable[[Odds], Sequence[RunValue]]
"""The choices that are worth driving for these odds, the best first."""


def first_run(driven: Sequence[PlannedRun], first: PlannedRun, means: Means) -> NextStep | None:
    """The next run of the smallest first set, None if the set is driven. first: its sweep."""
    shown = [run for run in driven if run.kind != "doublet"]
    if shown and len(shown) < len(driven):
        return None
    if reason := used_up(means):
        return NextStep("used up", reason)
    if not shown:
        return NextStep("drive", f"{run_text(first)}: one sweep shows most effects", (), first)
    run = check(shown)
    return NextStep("drive", f"{run_text(run)}: it is held out, and checks what the sweep shows", (), run)


def check(shown: Sequence[PlannedRun]) -> PlannedRun:
    """A doublet to confirm what these runs show, at the speed of the largest one."""
    top = max(shown, key=lambda run: run.amplitude_us)
    return PlannedRun("doublet", 10.0 * round(CHECK * top.amplitude_us / 10.0), round(top.speed, 1))


def next_step(found: Diagnosis, driven: Sequence[PlannedRun], means: Means, ranking: Ranking) -> NextStep:
    """What to do after the diagnosis of the driven runs.

    ranking: called at most once for each question, since it simulates the choices.
    """
    named = tuple(f.effect for f in found.findings)
    if found.verdict == "refused":
        return NextStep("open", f"the runs were refused: {found.sentence}")
    asked = open_questions(found)
    if not asked.why:
        why = "no effect is missing, and the bounds of all effects are below the size that matters"
        if named:
            why = f"{in_words(named)}: no look-alike is left, and held-out data confirm it"
        return NextStep("settled", why, named)
    if reason := used_up(means):
        return NextStep("used up", f"{reason}; {asked.why}", named)
    best = next(iter(ranking(asked.odds)), None)
    if found.verdict == "none" and best is None:
        return NextStep("settled", f"{asked.why}, and no run is expected to tell more about them")
    if best is not None:
        run, bits, names = run_text(best.run), f"({best.bits:.1f} bit expected)", effects_of(asked.odds)
        tells = f"{run} tells most about {in_words(names) if len(names) <= NAMED else 'them'} {bits}"
        if best.settles:
            tells = f"{run} is expected to settle it if {in_words(best.settles, 'or')} is true {bits}"
        return NextStep("drive", f"{asked.why}; {tells}", named, best.run, best.bits, asked.odds)
    # the plan knows no run for the question: a test on other data, else another operating point
    if asked.unchecked:
        test = check([r for r in driven if r.kind != "doublet"])
        return NextStep("drive", f"{asked.why}; {run_text(test)} is held out and tests it", named, test)
    largest = sorted(means.choices, key=lambda run: -run.amplitude_us)
    new = next((run for run in largest if is_new(run, driven)), None)
    if new is None:
        return NextStep("open", f"{asked.why}, and no run is expected to tell more", named)
    return NextStep("drive", f"{asked.why}; {run_text(new)} shows another amplitude or speed", named, new)


def used_up(means: Means) -> str:
    """Why no run can be driven, "" if one can."""
    if means.spent:
        return means.spent
    if means.runs_left <= 0:
        return "all runs that were allowed are driven"
    return "" if means.choices else "no run fits on the ground and within the limits"


def is_new(run: PlannedRun, driven: Sequence[PlannedRun]) -> bool:
    """True if no driven run has nearly this kind, amplitude and speed."""
    return not any(
        run.kind == other.kind
        and abs(run.amplitude_us - other.amplitude_us) <= SAME * other.amplitude_us
        and abs(run.speed - other.speed) <= SAME * other.speed
        and abs(run.bias_us - other.bias_us) <= SAME * other.amplitude_us
        for other in driven
    )
