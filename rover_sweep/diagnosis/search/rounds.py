"""One round of a diagnosis: a model is fitted, and every effect is added to it alone.

Every round has its own noise floor and its own metric, since both depend on the model of that round.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rover_sweep.diagnosis.problem.least_squares import Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.model_error import model_error
from rover_sweep.diagnosis.problem.residuals import Problem, centred, never, problem
from rover_sweep.diagnosis.problem.signatures import Signature, columns, signatures
from rover_sweep.diagnosis.problem.speed_drift import speed_drift
from rover_sweep.diagnosis.search.candidate_fits import (
    Tangent,
    Trial,
    fit_candidates,
    refit_candidates,
    tangent,
)
from rover_sweep.diagnosis.search.material import EARLIER, exceeds_material_size
from rover_sweep.diagnosis.search.threshold import NullDistribution, null_distribution
from rover_sweep.diagnosis.simulation.candidates import Model, added_coordinates, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged

NOTABLE = 1.45  # mean square of a channel's rows from which its residual is examined
NOTABLE_PLAIN = 3.0  # the same, for rows without tolerances
LARGE = 1.8  # mean square up to which noise that grows with the motion may be the reason
IMPLAUSIBLE = 0.8  # share of an effect's bound, beyond which it is probably a proxy
MOST_NOISE = 1.5  # largest variance of a row that a round takes for noise
FAR_OFF = 3.0  # mean square of the closest fit's rows, from which effects are fitted from the start too
LAGS = ("servo_lag", "transport_delay")
SWINGING = "servo_lag/second order"
MOST_SHAPE = 1.0  # of a servo that swings no more than usual, a damping ratio of 0.5
SHORTEST = 0.008  # s, of a lag whose swinging is within the band of a sweep


@dataclass(frozen=True, eq=False)
class Options:
    """Settings of a search. only, without: ids of effects; seed: of the bootstrap.

    progress(activity, share done 0..1); stop: True ends the search.
    """

    only: tuple[str, ...]
    without: tuple[str, ...]
    seed: int
    progress: Callable[[str, float], None]
    stop: Callable[[], bool]

    def within(self, low: float, high: float) -> Options:
        """The same for a part of the work, from the share low to the share high."""
        return replace(self, progress=lambda what, share: self.progress(what, low + (high - low) * share))


@dataclass(frozen=True)
class Misfit:
    """Mean square of one channel's residual rows, 1 at the noise floor.

    in_metric: with tolerances allowed for. plain: without, so it may be larger.
    """

    in_metric: float
    plain: float

    @property
    def level(self) -> float:
        """The larger of both, on the scale of `in_metric`."""
        return max(self.in_metric, self.plain * NOTABLE / NOTABLE_PLAIN)

    @property
    def notable(self) -> bool:
        """True where the residual is above the noise and must be explained."""
        return self.level > NOTABLE

    @property
    def large(self) -> bool:
        """True where it is more than noise that grows with the motion.

        Dry friction, for example, holds the body still where the steering is quiet and the noise is measured.
        """
        return self.level > LARGE


@dataclass(frozen=True, eq=False)
class Round:
    """A fitted model with the trials of every effect.

    problem, fitted: in the metric of the tolerances. closest: the fit without tolerances, which is nearest to
    the recordings. tolerances: signatures of what every rover has, in the metric. cannot_see: {effect: why}.
    """

    model: Model
    problem: Problem
    closest: Fitted
    fitted: Fitted
    trials: tuple[Trial, ...]
    null: NullDistribution
    tangent: Tangent
    tolerances: tuple[Signature, ...]
    cannot_see: Mapping[str, str]

    @cached_property
    def misfit(self) -> dict[str, Misfit]:
        """{channel: misfit of the round's model}.

        Plain, it is that of the closer fit of two: one in the metric may wander along what the metric hides.
        """
        found = self.misfit_of(self.fitted)
        nearest = {c: float(np.mean(self.problem.part(self.closest.rows, channel=c) ** 2)) for c in found}
        return {c: replace(m, plain=min(m.plain, nearest[c])) for c, m in found.items()}

    def misfit_of(self, fitted: Fitted) -> dict[str, Misfit]:
        """{channel: misfit of a fit in this round's problem}."""
        plain = self.problem.plain
        whole = plain.measured - plain.model(fitted.structure, fitted.x)
        out = {}
        for channel in ("r", "ay", "p"):
            part = self.problem.part(fitted.rows, channel=channel)
            if part.size:
                usual = self.problem.part(whole, channel=channel)
                out[channel] = Misfit(float(np.mean(part**2)), float(np.mean(usual**2)))
        return out

    def significant(self) -> list[Trial]:
        """Trials above their thresholds and their material sizes, the largest gain first."""
        return [t for t in self.trials if self.is_finding(t)]

    def is_finding(self, trial: Trial) -> bool:
        """True for a trial that is a finding: fitted, above its threshold and its material size."""
        if trial.fitted is self.fitted:
            return False  # a linear prediction only
        over = self.relative_variance(trial)
        return trial.gain > over * self.null.thresholds.get(trial.effect, 0.0) and matters(trial)

    def relative_variance(self, trial: Trial) -> float:
        """Variance of a row in the trial over that in the round's bootstrap, at least 1."""
        return max(1.0, trial.fitted.overdispersion / self.fitted.overdispersion)


def matters(trial: Trial) -> bool:
    """False where the fitted size is below the material size, or implausibly near its bound."""
    x, spread = trial.fitted.x, trial.model.spread
    effect = trial.law
    limits = {c.name: max(abs(c.low), abs(c.high)) for c in added_coordinates(effect)}
    if any(abs(x[name]) > IMPLAUSIBLE * limit for name, limit in limits.items() if not name.endswith(".t")):
        return False
    if effect.name == SWINGING and x["lag_shape"] > MOST_SHAPE and x["lag"] > SHORTEST:
        return True
    if trial.effect in LAGS:
        return x["lag"] + x["delay"] > spread.together
    if trial.effect == "clock_offset" and not trial.model.two_clocks:
        return x["delay"] < -EARLIER
    return exceeds_material_size(effect, x, spread, trial.model.rover.wheelbase)


def fit_with_floor(
    runs: Sequence[Experiment],
    model: Model,
    start: Mapping[str, float],
    near: bool = False,
    stop: Callable[[], bool] = never,
) -> tuple[Problem, Fitted]:
    """The model fitted with the noise floor of its own residual.

    start: {coordinate: value}. near: it comes from an earlier fit, so one pass is enough. stop: that of
    the problem.
    """
    x = {**{c.name: c.start for c in model.free}, **start}
    for _ in range(1 if near else 2):
        found = replace(with_floor_of(runs, model, x), stop=stop)
        fitted = fit(found, model.structure, model.free, x)
        x = dict(fitted.x)
    return found, fitted


def with_floor_of(runs: Sequence[Experiment], model: Model, x: Mapping[str, float]) -> Problem:
    """The problem of the runs with the noise floor of a model's residual. x: {coordinate: value}."""
    residuals = []
    for run in runs:
        model_log = logged(run, model.structure, x, Sensors.of(run))
        residuals.append({c: y - model_log[c] for c, y in centred(run).items()})
    return problem(runs, residuals)


def _at_start(metric: Problem, model: Model) -> Fitted:
    """The model at its start values, with its Jacobian, as if it were a fit."""
    x = {c.name: float(np.clip(c.start, c.low, c.high)) for c in model.free}
    rows = metric.measured - metric.model(model.structure, x)
    none = np.zeros((rows.size, 0))
    return sensitivities(metric, Fitted(model.structure, model.free, x, float(rows @ rows), rows, none))


def round_of(
    runs: Sequence[Experiment], model: Model, start: Mapping[str, float], options: Options, near: bool = False
) -> Round:
    """One round: fit the model in the metric of the tolerances and add each candidate to it.

    Where the search is stopped, a round that is near an earlier one raises `Stopped`; a first one fits its
    model and has fewer candidates.
    """
    options.progress("fitting the model", 0.0)
    plain, closest = fit_with_floor(runs, model, start, near, options.stop if near else never)
    options.progress("measuring what every rover has", 0.3)
    usual = signatures(plain, closest, model, possible(model, runs)[0], tolerances=True)
    usual += [*speed_drift(plain, closest), *model_error(plain, closest)]
    metric = plain.in_metric(columns(usual, plain.size))
    tolerances = tuple(replace(s, rows=metric.of(s.rows)) for s in usual)
    known = replace(closest, jacobian=metric.of(closest.jacobian))
    fitted = sensitivities(metric, fit(metric, model.structure, model.free, closest.x, known=known))
    effects, cannot_see = possible(model, runs, options.only, options.without)
    space = tangent(fitted)
    candidates = signatures(metric, fitted, model, effects, forms=True)
    # the residual may be the missing effect, so only a part of it counts as noise
    noise = min(fitted.overdispersion, MOST_NOISE)
    null = null_distribution(candidates, tolerances, space, noise, options.seed)
    needed = null.thresholds
    origin = None
    if not near and closest.overdispersion > FAR_OFF:
        origin = _at_start(metric, model)
    metric = replace(metric, stop=options.stop)
    testing = options.within(0.45, 0.85).progress
    trials = fit_candidates(metric, fitted, space, model, effects, needed, testing, origin)
    options.progress("fitting the best again", 0.85)
    trials = refit_candidates(metric, fitted, trials, needed)
    return Round(
        model=model,
        problem=metric,
        closest=closest,
        fitted=fitted,
        trials=tuple(trials),
        null=null,
        tangent=space,
        tolerances=tolerances,
        cannot_see=cannot_see,
    )
