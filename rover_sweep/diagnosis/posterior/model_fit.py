"""A model fitted to runs in the metric of what every rover has, with its noise floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.diagnosis.effects.kinds import SpeedGripEffect, VehicleEffect
from rover_sweep.diagnosis.posterior.model_error import structural_error
from rover_sweep.diagnosis.problem.least_squares import COARSE, Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem, centred, problem
from rover_sweep.diagnosis.problem.signatures import columns, signatures
from rover_sweep.diagnosis.problem.speed_drift import speed_drift
from rover_sweep.diagnosis.simulation.candidates import Model, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A model fitted twice, each time with its Jacobian at the fit.

    problem, fitted: in the metric of the tolerances. closest: the fit without tolerances, which is nearest to
    the recordings. cannot_see: {effect: why}.
    """

    model: Model
    problem: Problem
    closest: Fitted
    fitted: Fitted
    cannot_see: Mapping[str, str]

    @property
    def misfit(self) -> dict[str, float]:
        """{channel: mean square of its residual rows with tolerances allowed for, 1 at the noise floor}."""
        parts = {c: self.problem.part(self.fitted.rows, channel=c) for c in ("r", "ay", "p", "vy")}
        return {c: float(np.mean(part**2)) for c, part in parts.items() if part.size}

    def with_explanation(self, model: Model, fitted: Fitted) -> ModelFit:
        """Another model that was fitted in the same metric, with its closest fit."""
        plain = self.problem.plain
        near = fit(plain, model.structure, model.free, fitted.x)
        return replace(self, model=model, closest=near, fitted=fitted)


def model_fit(
    runs: Sequence[Experiment],
    model: Model,
    start: Mapping[str, float],
    only: Sequence[str] = (),
    without: Sequence[str] = (),
) -> ModelFit:
    """The model fitted to runs. start: {coordinate: value}; only, without: ids, for `cannot_see`."""
    plain, closest = fit_with_floor(runs, model, start)
    metric = in_metric_of(plain, closest, model)
    known = replace(closest, jacobian=metric.of(closest.jacobian))
    fitted = sensitivities(metric, fit(metric, model.structure, model.free, closest.x, known=known))
    return ModelFit(model, metric, closest, fitted, possible(model, runs, only, without)[1])


def in_metric_of(plain: Problem, fitted: Fitted, model: Model) -> Problem:
    """The problem in the metric of what every rover has: tolerances, errors of speed and structure."""
    effects = possible(model, plain.runs)[0]
    given, plain = plain, plain.steadied(fitted.structure, fitted.x)
    known = signatures(plain, fitted, model, effects, tolerances=True)
    inexact = {e.id for e in effects if isinstance(e, VehicleEffect | SpeedGripEffect)}
    usual = [*(s for s in known if s.effect in inexact), *speed_drift(plain, fitted)]
    usual += structural_error(plain, fitted)
    measured = [s for s in known if s.effect not in inexact]
    # what people know of a part counts in full, as a prior does; equations and estimator are as inexact
    # as the rows
    both = columns(usual, plain.size), columns(measured, plain.size) / np.sqrt(COARSE)
    return given.in_metric(np.column_stack(both))


def fit_with_floor(
    runs: Sequence[Experiment], model: Model, start: Mapping[str, float], near: bool = False
) -> tuple[Problem, Fitted]:
    """The model fitted with the noise floor of its own residual.

    start: {coordinate: value}. near: it comes from an earlier fit, so one pass is enough.
    """
    x = {**{c.name: c.start for c in model.free}, **start}
    for _ in range(1 if near else 2):
        found = with_floor_of(runs, model, x)
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
