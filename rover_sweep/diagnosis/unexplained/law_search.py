"""Where in the equations the unknown acts, and by which law: chosen, confirmed, and fitted in the model.

The candidate laws of `groups` are scored by `selection`. The best at each place are fitted in the simulation,
and the largest drop of the cost is the law; places that come near are its alternatives. A second law is
sought in what is left. Runs that are held out judge the result and choose nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import LawHeldOut
from rover_sweep.diagnosis.simulation.table_law import TableLaw, with_laws
from rover_sweep.diagnosis.unexplained.curve_fit import FittedLaws, fit_laws
from rover_sweep.diagnosis.unexplained.groups import groups, rows_of
from rover_sweep.diagnosis.unexplained.selection import Regression, Score
from rover_sweep.diagnosis.unexplained.transfers import transfers

LAWS = 2  # most laws at once
TRIED = 3  # most places whose law is fitted in the simulation
NEAR = 0.85  # share of the best score from which a place is tried
ALIKE = 0.97  # share of the largest drop of the cost from which another place is an alternative
SIMPLER = 0.93  # share of the score from which a law without memory and factor is preferred
TIMELESS = 0.6  # share of the best score from which a law over time is not considered
WORTH = 0.15  # least share of what remains above the floor that a law predicts in other rows
CERTAIN = 60.0  # least drop of the cost in each half
FURTHER = 0.1  # least share of what the laws before leave in the held-out runs, for one more law
WORSE = 0.02  # rise of a held-out run's mean square at which a law does not hold
REMOVED = 0.2  # least share of the held-out residual above the floor that the laws remove
EXPLAINABLE = 1.05  # mean square of the rows above which a share is computed
ALIKE_BY_NATURE = {"side force front": "steering", "steering": "side force front"}  # the same motion
NATURAL = {
    ("steering", "delta"),
    ("steering", "delta_dot"),
    ("side force front", "a_y"),
    ("side force rear", "a_y"),
    ("yaw moment", "r"),
    ("roll moment", "p"),
    ("roll moment", "phi"),
    ("side force", "psi"),
    *((f"sensor of {c}", over) for c in ("r", "ay", "p", "vy") for over in ("signal", "signal_dot")),
}


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """One law with its places. gain: drop of the cost; confirmed: share of the half that chose nothing."""

    law: TableLaw
    alternatives: tuple[str, ...]
    gain: float
    confirmed: float


@dataclass(frozen=True, eq=False)
class FoundLaws:
    """All laws, fitted together. held_out: of each held-out run."""

    laws: tuple[FoundLaw, ...]
    fitted: FittedLaws
    held_out: tuple[LawHeldOut, ...]

    @property
    def share_removed(self) -> float | None:
        """Share of the held-out residual above the floor that the laws remove; None without such runs."""
        judged = [h for h in self.held_out if h.share_left is not None]
        before, after = (
            sum(v - 1.0 for v in vs) for vs in ([h.before for h in judged], [h.after for h in judged])
        )
        return 1.0 - after / before if judged else None

    @property
    def contradicted(self) -> bool:
        """True where a held-out run gets worse."""
        return any(h.after > h.before + WORSE for h in self.held_out)

    @property
    def holds(self) -> bool:
        """True where the laws remove enough of the held-out runs, or of the second half without such runs."""
        share = self.share_removed
        if self.contradicted:
            return False
        return (self.laws[0].confirmed if share is None else share) >= REMOVED


@dataclass(frozen=True, eq=False)
class _Candidate:
    law: TableLaw
    rows: Array
    score: Score


def find_laws(problem: Problem, base: Fitted, held_out: Mapping[str, Problem]) -> FoundLaws | None:
    """The laws that explain the residual of `base`, None where no law predicts rows that did not choose it.

    problem: without tolerances; base: a fit to it, with its Jacobian there. held_out: {run: its problem}.
    """
    found: list[FoundLaw] = []
    kept: FoundLaws | None = None
    now, best = base, FittedLaws((), base)
    while len(found) < LAWS:
        one = _next_law(problem, base, now, best)
        if one is None:
            break
        law, fitted = one
        judged = tuple(_judged(n, p, base, fitted) for n, p in held_out.items())
        if kept and not _better(judged, kept.held_out):
            break
        best = fitted
        found.append(law)
        kept = FoundLaws(tuple(found), best, judged)
        now = _with_fixed(base, best)
        now = replace(now, rows=best.fitted.rows, jacobian=_nominal_columns(base, best))
    return kept


def _next_law(
    problem: Problem, base: Fitted, now: Fitted, before: FittedLaws
) -> tuple[FoundLaw, FittedLaws] | None:
    """The law that explains most of the fit `now`, fitted together with those before it."""
    above = now.data_cost - problem.size
    if above <= CERTAIN:
        return None
    candidates, regression = _scored(problem, now)
    least = max(WORTH * above / 2, CERTAIN)
    candidates = [c for c in candidates if c.score.chosen >= least and c.score.confirmed >= least]
    candidates = _without_time(candidates)
    best = max((c.score.chosen for c in candidates), default=0.0)
    tried = list(_one_a_place(candidates, best))[:TRIED]
    fitted = []
    for c in tried:
        amounts = regression.with_group(c.rows).amounts()[-len(c.law.x) :]
        earlier = [np.array(law.y) for law in before.laws]
        laws = [*(replace(law, y=(0.0,) * len(law.y)) for law in before.laws), c.law]
        start = replace(base, x={**base.x, **{k.name: before.fitted.x[k.name] for k in base.free}})
        fitted.append((fit_laws(problem, start, laws, [*earlier, amounts], known=not before.laws), c))
    drops = [before.fitted.cost - f.fitted.cost for f, _ in fitted]
    alike = [k for k, drop in enumerate(drops) if drop >= ALIKE * max(drops, default=0.0)]
    if not alike or max(drops) < WORTH * above:
        return None
    first = max(alike, key=lambda k: ((tried[k].law.place, tried[k].law.over) in NATURAL, drops[k]))
    others = sorted((k for k in alike if k != first), key=lambda k: -drops[k])
    law = tried[first].law
    places = dict.fromkeys(tried[k].law.place for k in others)
    if law.place in ALIKE_BY_NATURE:
        places.setdefault(ALIKE_BY_NATURE[law.place])
    confirmed = tried[first].score.confirmed / (above / 2)
    return FoundLaw(law, tuple(places), drops[first], confirmed), fitted[first][0]


def _scored(problem: Problem, now: Fitted) -> tuple[list[_Candidate], Regression]:
    """All candidate laws with their rows and scores in what `now` leaves, the best first."""
    found = transfers(problem.runs, now.structure, now.x)
    regression = Regression.of(problem, now)
    laws = list(groups(found))
    rows = rows_of(problem, found, laws)
    out = [_Candidate(law, r, regression.score(r)) for law, r in zip(laws, rows, strict=True)]
    return sorted(out, key=lambda c: -c.score.chosen), regression


def _without_time(candidates: list[_Candidate]) -> list[_Candidate]:
    """Without laws over time where another explains nearly as much: in a sweep, time stands for frequency."""
    others = [c for c in candidates if c.law.over != "t"]
    best, best_other = (max((c.score.chosen for c in some), default=0.0) for some in (candidates, others))
    return others if best_other >= TIMELESS * best else candidates


def _one_a_place(candidates: Sequence[_Candidate], best: float) -> Iterator[_Candidate]:
    """The best candidate at each place near the best of all, a simple one where it is nearly as good."""
    for place in dict.fromkeys(c.law.place for c in candidates):
        here = [c for c in candidates if c.law.place == place and c.score.chosen >= NEAR * best]
        if here:
            top = here[0].score.chosen
            near = [c for c in here if c.score.chosen >= SIMPLER * top]
            yield min(near, key=lambda c: (_complexity(c.law), -c.score.chosen))


def _complexity(law: TableLaw) -> int:
    return (law.times != "") + 2 * (law.memory != "")


def _with_fixed(base: Fitted, best: FittedLaws) -> Fitted:
    """The base with the laws at their fitted points, and the nominal coordinates fitted with them."""
    x = {k: v for k, v in best.fitted.x.items() if not k.startswith("law")}
    return replace(base, structure=with_laws(base.structure, best.laws), x=x)


def _nominal_columns(base: Fitted, best: FittedLaws) -> Array:
    names = [c.name for c in best.fitted.free]
    return best.fitted.jacobian[:, [names.index(c.name) for c in base.free]]


def _better(now: Sequence[LawHeldOut], before: Sequence[LawHeldOut]) -> bool:
    """True where one more law removes enough of the held-out runs, or there are none."""
    left = sum(h.after - 1.0 for h in before)
    return (
        not before or sum(b.after - h.after for h, b in zip(now, before, strict=True)) > FURTHER * left > 0.0
    )


def _judged(name: str, held: Problem, base: Fitted, best: FittedLaws) -> LawHeldOut:
    before, after = (
        float(np.mean((held.measured - held.model(f.structure, f.x)) ** 2)) for f in (base, best.fitted)
    )
    share = (after - 1.0) / (before - 1.0) if before > EXPLAINABLE else None
    return LawHeldOut(name, before, after, share)
