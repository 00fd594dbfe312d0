"""Whether an effect earns its name on data that did not choose it.

Each named effect is judged by two fits: the model with it, and the model without it, refitted.

1. Held-out runs. s are the whitened rows by which both models differ there, G the drop of the sum of squares.
   If the effect is true, G is about s^T s; if the model without it is true, about -s^T s. The noise of G is
   2 sqrt(v s^T s), v the mean square of a row. G must be positive wherever s^T s is large enough to judge.
2. Runs left out one by one, where no held-out run judges. At the optimum of all runs with the Jacobian J
and the residual r, the optimum
   without the rows k is x + (N - J_k^T J_k)^-1 (-J_k^T r_k), N = J^T J + priors, which predicts the residual
   of those rows (Cook and Weisberg 1982, chapter 2; no simulation is needed). The gain over all rows
   that were
   predicted this way must be positive.
3. Its size must be known: an interval that holds its absent value, or spans a decade, is no finding.
4. Beside a larger finding its gain must exceed what a wrong form of that one may leave, and G be half of
   s^T s. Where no held-out run judges it, it must explain a share of what remains unexplained, since that too
   is a wrong form; and no refused effect may explain far more, since that one is nearer to the truth.

Cook and Weisberg 1982: Residuals and Influence in Regression, Chapman and Hall.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.held_out.worth import JUDGED
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.search.candidate_fits import Trial
from rover_sweep.diagnosis.search.rounds import Round
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model

DECADE = 10.0  # ratio of the ends of an interval
FORM_ERROR = 0.02  # share of a larger finding's gain that its wrong form may leave
FAR_MORE = (
    2.5  # ratio of gains; a slope is named beside 1.8, a change of ground was beside a backlash with 4.4
)
OF_EXCESS = 0.08  # least share of what remains above the noise; a bank named a change of ground had 0.05
CLEAR_EXCESS = 5.0  # standard deviations of the sum of squares, from which something remains
IN_PART = 0.5  # share of s^T s that a further finding must gain; true ones had 0.8 and more, false ones below
PLAUSIBLE = 2.5  # share of s^T s; a gain beyond is made by what both models lack
NEITHER = 4.0  # mean square of a held-out run's rows, from which neither model describes that run
STEPS = 3  # of the fit without tolerances


@dataclass(frozen=True)
class EffectSupport:
    """What speaks for one named effect; gains are drops of the sum of squares.

    gain: on the runs of the fit. predicted: on the same runs, each predicted by the others; None where the
    effect shows in one run only, or there is one run. held_out, expected: on the held-out runs, and what a
    true effect would gain there; None without such runs. spread: largest relative change of its size when a
    run is left out. against: why it is no finding, "" where it is one.
    """

    effect: str
    gain: float
    predicted: float | None = None
    held_out: float | None = None
    expected: float | None = None
    spread: float | None = None
    against: str = ""


@dataclass(frozen=True, eq=False)
class Withheld:
    """Held-out runs as problems with their noise floors, and the model-independent part of the judgement."""

    problems: tuple[Problem, ...] = field(default_factory=tuple)

    def gain(self, fits: tuple[Fitted, Fitted] | None) -> tuple[float, float] | None:
        """(gain, gain expected of a true effect) over the runs that can judge it; None where none can.

        fits: without the effect, and with it.
        """
        if fits is None:
            return None
        without, whole = fits
        gains, sizes = [], []
        for problem in self.problems:
            before = problem.measured - problem.model(without.structure, without.x)
            after = problem.measured - problem.model(whole.structure, whole.x)
            difference = before - after
            size = float(difference @ difference)
            scatter = max(1.0, float(after @ after) / after.size)  # more than noise where both are wrong
            gain = float(before @ before - after @ after)
            if scatter < NEITHER and size > JUDGED * scatter and abs(gain) < PLAUSIBLE * size:
                gains.append(gain)
                sizes.append(size)
        return (sum(gains), sum(sizes)) if gains else None


def support_in(effect: str, last: Round, held: Withheld, larger: float) -> EffectSupport:
    """The support of one effect of the last round's model. larger: the largest gain of the other findings."""
    whole, rest = last.fitted, last.model.without(effect)
    known = None if effect in DEGREES_OF_FREEDOM else whole
    less = fit(last.problem, rest.structure, rest.free, whole.x, known=known)
    nearest = (_without_tolerances(last.problem, less), last.closest) if held.problems else None
    return _support(effect, last.problem, last.model, whole, less, held.gain(nearest), larger)


def support_of(
    trial: Trial, base: Round, held: Withheld, larger: float, refused: float = 0.0
) -> EffectSupport:
    """The support of a trial of a round, beside the round's own effects.

    larger: their largest gain. refused: the largest gain of a trial of this round that did not earn its name.
    """
    problem, whole = base.problem, trial.fitted
    nearest = (base.closest, _without_tolerances(problem, whole)) if held.problems else None
    found = _support(trial.effect, problem, trial.model, whole, base.fitted, held.gain(nearest), larger)
    if not found.against and found.held_out is None and refused > FAR_MORE * found.gain:
        return replace(found, against="an effect that is refused explains far more than it")
    return found


def _support(
    effect: str,
    problem: Problem,
    model: Model,
    whole: Fitted,
    less: Fitted,
    judged: tuple[float, float] | None,
    larger: float,
) -> EffectSupport:
    law = next(law for law in map(model.law, model.effects) if law.id == effect)
    gain = less.cost - whole.cost
    sure = _unsure_size(law, whole)
    several = len(problem.runs) > 1 and not law.in_one_run and effect not in DEGREES_OF_FREEDOM
    predicted = spread = None
    if several:
        with_it, sizes = _left_out(problem, whole, law)
        predicted = _left_out(problem, less, law)[0] - with_it
        spread = _spread(sizes, law, whole.x)
    held_out, expected = judged or (None, None)
    found = EffectSupport(effect, gain, predicted, held_out, expected, spread)
    return replace(found, against=_against(found, law, larger, _excess(whole), sure))


def _without_tolerances(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit nearest to the recordings, since another run is predicted by the model alone."""
    return fit(problem.plain, fitted.structure, fitted.free, fitted.x, steps=STEPS)


def _excess(whole: Fitted) -> float:
    """The sum of squares above the noise that remains with the effect, 0 where chance may make as much."""
    rows = whole.rows.size
    excess = whole.data_cost - rows
    return excess if excess > CLEAR_EXCESS * np.sqrt(2.0 * rows) else 0.0


def _against(found: EffectSupport, law: Effect, larger: float, excess: float, unsure: str) -> str:
    if found.held_out is not None and found.held_out <= 0:
        return "it makes the held-out runs worse"
    if found.held_out is None and found.predicted is not None and found.predicted <= 0:
        return "fitted to the other runs, it makes each run worse"
    if law.id in DEGREES_OF_FREEDOM:
        return ""
    share = found.held_out / found.expected if found.held_out and found.expected else 1.0
    if found.gain < larger and share < IN_PART:
        return "beside the larger finding it predicts the held-out runs in part only"
    if found.gain < FORM_ERROR * larger:
        return "a slightly wrong form of the larger finding would leave as much"
    if found.held_out is None and found.gain < OF_EXCESS * excess:
        return "it explains too little of what differs, and no held-out run can judge it"
    return unsure


def _unsure_size(law: Effect, whole: Fitted) -> str:
    """Why the size is not known, "" where it is: no interval of a parameter is away from its absent value."""
    error = standard_errors(whole)
    why = "its size cannot be told from none"
    for p in law.parameters:
        name = law.coordinate_name(p)
        if p.name == "t" or name not in error:
            continue
        if p.jumps:
            return ""
        value, reach = abs(whole.x[name]), 1.645 * error[name]
        if value <= reach:
            continue
        if not p.nominal and value + reach > DECADE * (value - reach):
            why = "its size is known to a factor of ten only"
            continue
        return ""
    return why


def standard_errors(fitted: Fitted) -> dict[str, float]:
    """{coordinate: standard deviation} from the curvature of the cost and the rows' variance."""
    scale = np.array([c.scale for c in fitted.free])
    covariance = np.linalg.inv(_normal(fitted)) * fitted.overdispersion
    return {c.name: float(s) for c, s in zip(fitted.free, scale * np.sqrt(np.diag(covariance)), strict=True)}


def _normal(fitted: Fitted) -> Array:
    prior = np.array([(c.scale / c.prior) ** 2 if c.prior else 0.0 for c in fitted.free])
    return np.asarray(fitted.jacobian.T @ fitted.jacobian + np.diag(prior + 1e-6))


def _loose(fitted: Fitted) -> NDArray[np.intp]:
    inside = [
        c.step > 0 and c.low + 1e-6 * c.scale < fitted.x[c.name] < c.high - 1e-6 * c.scale
        for c in fitted.free
    ]
    return np.flatnonzero(inside)


def _left_out(problem: Problem, fitted: Fitted, law: Effect) -> tuple[float, list[dict[str, float]]]:
    """(sum of squares of all rows, each run's predicted by the other runs; the effect's coordinates then)."""
    loose = _loose(fitted)
    jacobian, normal = fitted.jacobian[:, loose], _normal(fitted)[np.ix_(loose, loose)]
    free = [fitted.free[k] for k in loose]
    low = np.array([(c.low - fitted.x[c.name]) / c.scale for c in free])
    high = np.array([(c.high - fitted.x[c.name]) / c.scale for c in free])
    names = {law.coordinate_name(p) for p in law.parameters if p.name != "t"}
    total, sizes = 0.0, []
    for run in range(len(problem.runs)):
        rows = np.concatenate([np.arange(r.start, r.start + r.size) for r in problem.rows if r.run == run])
        part, left = jacobian[rows], fitted.rows[rows]
        rest = normal - part.T @ part + 1e-6 * np.eye(loose.size)
        move = np.clip(np.linalg.solve(rest, -part.T @ left), low, high)
        predicted = left - part @ move
        total += float(predicted @ predicted)
        sizes.append(
            {
                fitted.free[k].name: fitted.x[fitted.free[k].name] + fitted.free[k].scale * step
                for k, step in zip(loose, move, strict=True)
                if fitted.free[k].name in names
            }
        )
    return total, sizes


def _spread(sizes: Sequence[Mapping[str, float]], law: Effect, x: Mapping[str, float]) -> float | None:
    """Largest relative change of the parameter that changes least."""
    names = {n for found in sizes for n in found if x.get(n)}
    changes = [max(abs(found.get(n, x[n]) / x[n] - 1.0) for found in sizes) for n in names]
    return min(changes, default=None)
