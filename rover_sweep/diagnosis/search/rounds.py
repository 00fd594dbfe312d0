"""One round of a diagnosis: a model fitted, and every effect tried beside it.

Every round has its own noise floor and its own metric, since both depend on the model of that round.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem, centred, problem
from rover_sweep.diagnosis.problem.signatures import Signature, columns, signatures
from rover_sweep.diagnosis.problem.speed_drift import wander
from rover_sweep.diagnosis.search.candidate_fits import Tangent, Trial, all_polished, all_tried, tangent
from rover_sweep.diagnosis.search.material import EARLIER, counts
from rover_sweep.diagnosis.search.threshold import Null, null
from rover_sweep.diagnosis.simulation.candidates import Model, own, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged

LOUD = 1.45  # mean square of a channel's rows, from which a residual is worth a question
LOUD_PLAIN = 3.0  # the same, of rows in which the little of everything is not allowed for
MUCH = 1.8  # as LOUD, up to which it may be noise that grows with the motion
SILLY = 0.8  # of the largest size of an effect that is looked for, beyond which it stands for something else
MOST_NOISE = 1.5  # variance of a row that a round takes for noise
LAGS = ("servo_lag", "transport_delay")


@dataclass(frozen=True, eq=False)
class Options:
    """Which candidates, where the bootstrap starts, and how to report and stop."""

    only: tuple[str, ...]
    without: tuple[str, ...]
    seed: int
    progress: Callable[[str, float], None]
    stop: Callable[[], bool]


@dataclass(frozen=True)
class Left:
    """Mean square of a channel's rows that a model leaves, 1 at the noise floor: in the metric of an ordinary
    rover, and without it, where more may be left: what no little of everything would make."""

    allowed: float
    plain: float

    @property
    def loudness(self) -> float:
        """The larger of both, as if in the metric."""
        return max(self.allowed, self.plain * LOUD / LOUD_PLAIN)

    @property
    def loud(self) -> bool:
        """Whether it is worth a question."""
        return self.loudness > LOUD

    @property
    def much(self) -> bool:
        """Whether it is more than the noise may grow by where the rover is driven: dry friction, say, holds
        the body still in a quiet stretch, where the noise is taken from."""
        return self.loudness > MUCH


@dataclass(frozen=True, eq=False)
class Round:
    """A model fitted in the metric of an ordinary rover, and every effect tried beside it.

    closest: the fit that comes closest to the recordings, in which nothing else is allowed for.
    """

    model: Model
    problem: Problem
    closest: Fitted
    fitted: Fitted
    trials: tuple[Trial, ...]
    thresholds: Null
    tangent: Tangent
    tiny: tuple[Signature, ...]
    unseen: Mapping[str, str]

    @cached_property
    def left(self) -> dict[str, Left]:
        """{channel: what the model leaves}."""
        return self.left_by(self.fitted)

    def left_by(self, fitted: Fitted) -> dict[str, Left]:
        """{channel: what a fit in this round leaves}."""
        plain = self.problem.plain
        whole = plain.measured - plain.model(fitted.structure, fitted.x)
        out = {}
        for channel in ("r", "ay", "p"):
            part = self.problem.part(fitted.rows, channel=channel)
            if part.size:
                usual = self.problem.part(whole, channel=channel)
                out[channel] = Left(float(np.mean(part**2)), float(np.mean(usual**2)))
        return out

    def significant(self) -> list[Trial]:
        """Trials beyond their thresholds and their material size, the best first."""
        return [t for t in self.trials if self.passes(t)]

    def passes(self, trial: Trial) -> bool:
        """True for a trial that is a finding."""
        if trial.fitted is self.fitted:
            return False  # a promise, and no fit
        over = self.after(trial)
        return trial.gain > over * self.thresholds.thresholds.get(trial.effect, 0.0) and material(trial)

    def after(self, trial: Trial) -> float:
        """Variance of a row that the trial leaves over that of the round's own bootstrap, at least 1."""
        return max(1.0, trial.fitted.overdispersion / self.fitted.overdispersion)


def material(trial: Trial) -> bool:
    """False where the effect came out below the size from which it is a finding, or at a silly one."""
    x, spread = trial.fitted.x, trial.model.spread
    effect = library()[trial.effect]
    limits = {c.name: max(abs(c.low), abs(c.high)) for c in own(effect)}
    if any(abs(x[name]) > SILLY * limit for name, limit in limits.items() if not name.endswith(".t")):
        return False
    if trial.effect in LAGS:
        return x["lag"] + x["delay"] > spread.together
    if trial.effect == "clock_offset" and not trial.model.two_clocks:
        return x["delay"] < -EARLIER
    return counts(effect, x, spread)


def begun(
    runs: Sequence[Experiment], model: Model, start: Mapping[str, float], near: bool = False
) -> tuple[Problem, Fitted]:
    """The model fitted with the noise floor of its own residual. near: the start is that of a fit before."""
    x = {**{c.name: c.start for c in model.free}, **start}
    for _ in range(1 if near else 2):
        found = with_floor_of(runs, model, x)
        fitted = fit(found, model.structure, model.free, x)
        x = dict(fitted.x)
    return found, fitted


def with_floor_of(runs: Sequence[Experiment], model: Model, x: Mapping[str, float]) -> Problem:
    """The problem of the runs with the noise floor of what a model leaves."""
    residuals = []
    for run in runs:
        model_log = logged(run, model.structure, x, Sensors.of(run))
        residuals.append({c: y - model_log[c] for c, y in centred(run).items()})
    return problem(runs, residuals)


def round_of(
    runs: Sequence[Experiment], model: Model, start: Mapping[str, float], options: Options, near: bool = False
) -> Round:
    """One round: the model fitted, in the metric of what every rover has, and each candidate tried."""
    options.progress("fitting the model", 0.0)
    plain, closest = begun(runs, model, start, near)
    tiny = signatures(plain, closest, model, possible(model, runs)[0], tiny=True) + wander(plain, closest)
    metric = plain.in_metric(columns(tiny, plain.size))
    known = replace(closest, jacobian=metric.of(closest.jacobian))
    fitted = sensitivities(metric, fit(metric, model.structure, model.free, closest.x, known=known))
    effects, unseen = possible(model, runs, options.only, options.without)
    tang = tangent(fitted)
    seen = signatures(metric, fitted, model, effects)
    in_metric = [replace(s, rows=metric.of(s.rows)) for s in tiny]
    # what is left may be the effect that is looked for, so a large residual is no large noise
    thresholds = null(seen, in_metric, tang, min(fitted.overdispersion, MOST_NOISE), options.seed)
    needed = thresholds.thresholds
    trials = all_tried(metric, fitted, tang, model, effects, needed, options.progress, options.stop)
    trials = all_polished(metric, fitted, trials, needed, options.stop)
    return Round(model, metric, closest, fitted, tuple(trials), thresholds, tang, tuple(in_metric), unseen)
