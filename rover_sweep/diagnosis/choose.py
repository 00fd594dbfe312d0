"""Effects are added until none helps, each is then tried without, and what would do as well is named."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.search.bounds import Beyond, beyond_ordinary, cost_of
from rover_sweep.diagnosis.search.candidate_fits import Trial, tangent, tried
from rover_sweep.diagnosis.search.look_alikes import Alike, look_alikes
from rover_sweep.diagnosis.search.rounds import Left, Options, Round, material, round_of
from rover_sweep.diagnosis.simulation.candidates import WHOLE, Model
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.unexplained.unexplained import nameless_gain

MOST = 3  # effects at once
ASTRAY = 0.8  # of what there was, from which no second effect is looked for
LEFT = 0.5  # of what there was, from which the effects found are no explanation
INEXACT = 2e-3  # of what an effect explains, that its law may be wrong by: what is left of it is no effect
BETTER = 1.2  # times what the named effects explain, from which they only stand in for something else
FAR_BETTER = 4.0  # the same, of a law without a name, as an effect's own law may be inexact


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that stays: its trial beside the model without it, threshold and look-alikes."""

    trial: Trial
    base: Fitted
    threshold: float
    alike: tuple[Alike, ...]


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen. first: the round of the nominal model; last: that of the model with all effects.

    withdrawn: effects that were found and yet leave most of what is to be explained; of three, also where
    a fourth would help. beyond: a parameter that explains more than they, let go farther; nameless: a law
    without a name does. stopped: before all had been tried.
    """

    first: Round
    last: Round
    named: tuple[Named, ...]
    withdrawn: tuple[str, ...] = ()
    beyond: Beyond | None = None
    nameless: bool = False
    stopped: bool = False


def choose(runs: Sequence[Experiment], model: Model, start: Mapping[str, float], options: Options) -> Choice:
    """Adds and removes effects until neither helps; one that was removed does not come back."""
    first = current = round_of(runs, model, start, options)
    named: list[Named] = []
    removed: set[str] = set()
    while len(named) < MOST and not options.stop():
        found = _wanting(current, named, removed)
        if not found:
            break
        best = found[0]
        alike = look_alikes(
            current.fitted,
            best,
            [t for t in found if _rival(t, best)],
            current.tangent,
            current.tiny,
            best.fitted.overdispersion,
            options.seed,
        )
        threshold = current.thresholds.thresholds.get(best.effect, 0.0)
        named.append(Named(best, current.fitted, threshold, alike))
        current = round_of(runs, best.model, best.fitted.x, options, near=True)
        named = _kept(named, current, options)
        effects = tuple(n.trial.effect for n in named)
        if effects != current.model.effects:
            removed |= {*current.model.effects} - {*effects}
            fewer = replace(current.model, effects=effects)
            current = round_of(runs, fewer, current.fitted.x, options, near=True)
        if named and best.effect not in WHOLE and _astray(first, current, _wanting(current, named, removed)):
            break
    stopped = options.stop()
    if stopped and not named and (found := current.significant()):  # what there is, as it was fitted
        named = [Named(found[0], first.fitted, first.thresholds.thresholds.get(found[0].effect, 0.0), ())]
        current = replace(first, model=found[0].model, fitted=found[0].fitted, trials=())
    more = _wanting(current, named, removed) if len(named) == MOST else []
    endless = more and _little_scatter_taken(first, current)
    effects = tuple(n.trial.effect for n in named)
    if not named or (not stopped and (endless or _little_explained(first, current.left))):
        return Choice(first, first, (), effects, stopped=stopped)
    if not stopped:
        # the last fit is the best in another metric, that of an effect alone in this one
        fitted = first.fitted.data_cost - cost_of(first.problem, current.fitted)
        explained = max(fitted, *(n.trial.gain for n in named if n.base is first.fitted), 0.0)
        beyond = beyond_ordinary(first.problem, first.fitted)
        if beyond is not None and beyond.gain > BETTER * explained:
            return Choice(first, first, (), effects, beyond)
        if nameless_gain(first, options.seed) > FAR_BETTER * explained:
            return Choice(first, first, (), effects, nameless=True)
    return Choice(first, current, tuple(named), stopped=stopped)


def _wanting(current: Round, named: Sequence[Named], removed: Collection[str]) -> list[Trial]:
    """Effects that would be findings beside those that are named."""
    doubtful = INEXACT * sum(n.trial.gain for n in named if n.trial.effect not in WHOLE)
    return [t for t in current.significant() if t.effect not in removed and t.gain > doubtful]


def _astray(first: Round, current: Round, wanting: Sequence[Trial]) -> bool:
    """True where the effects so far explain next to nothing, and the one that would be next no more."""
    if not _little_explained(first, current.left, ASTRAY):
        return False
    return not wanting or _little_explained(first, current.left_by(wanting[0].fitted))


def _little_explained(first: Round, after: Mapping[str, Left], share: float = LEFT) -> bool:
    """True where much is left: in no channel that was loud less than a share of what stood out there, and
    in one of them no less either where nothing is allowed for, which hides a small effect."""
    much = any(left.much for left in after.values())
    pairs = [(after[c], before) for c, before in first.left.items() if before.loud]
    allowed = all(_stays(now.loudness, then.loudness, share) for now, then in pairs)
    plain = any(_stays(now.plain, then.plain, share) for now, then in pairs)
    return much and allowed and (plain or not pairs)


def _little_scatter_taken(first: Round, last: Round) -> bool:
    """True where the rows scatter beyond their noise by more than a share of what they did."""
    return _stays(last.fitted.overdispersion, first.fitted.overdispersion, LEFT)


def _stays(now: float, then: float, share: float) -> bool:
    """True where more than a share of what stood out of the noise, of a mean square of 1, is still there."""
    return now - 1.0 > share * (then - 1.0)


def _rival(trial: Trial, best: Trial) -> bool:
    """A whole degree of freedom and a term are no rivals."""
    return trial.effect != best.effect and (trial.effect in WHOLE) == (best.effect in WHOLE)


def _kept(named: Sequence[Named], current: Round, options: Options) -> list[Named]:
    """The named effects without those that are not needed any more, or that another now does better."""
    out = list(named)
    for one in named:
        if options.stop() or one.trial.effect in WHOLE:
            continue
        rest = current.model.without(one.trial.effect)
        less = fit(current.problem, rest.structure, rest.free, current.fitted.x, known=current.fitted)
        trial = Trial(one.trial.effect, current.model, current.fitted, less.cost - current.fitted.cost)
        if trial.gain < one.threshold or not material(trial):
            out.remove(one)
            continue
        tang = tangent(less)
        again = [
            t
            for a in one.alike
            if (t := tried(current.problem, less, tang, rest, library()[a.effect]))
            and t.gain > 0.8 * trial.gain
        ]
        alike = tuple(a for a in one.alike if a.effect in {t.effect for t in again})
        out[out.index(one)] = replace(one, alike=alike)
    return out
