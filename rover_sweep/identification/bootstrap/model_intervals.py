"""Bootstrap intervals of all models that were identified from the same runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

from rover_sweep.identification.bootstrap.bootstrap import Bootstrap
from rover_sweep.identification.bootstrap.replicates import Known
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.grouping import Group, Settings
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.structural_error import stiffness_loss, with_structural_error
from rover_sweep.spectra.side_by_side import side_by_side


def with_intervals(
    models: Mapping[str, ModelResult],
    groups: Sequence[Group],
    settings: Settings,
    friction: float | None = None,
) -> dict[str, ModelResult]:
    """The models with intervals of their free parameters, from `settings.bootstrap` replicates.

    Those of the bicycle and roll-yaw model also hold what their structure leaves out, except as in the paper:
    see `with_structural_error`. friction: of the tyres, see `stiffness_loss`.

    Unchanged for 0 replicates, and where responses are conditioned on another input, because the replicates
    are driven by the steering alone. A lumped model uses the first speed only.
    """
    if not settings.bootstrap or any(g.others for g in groups):
        return dict(models)

    known: Known = {}
    loss = 0.0 if settings.as_paper else stiffness_loss([run for g in groups for run in g.runs], friction)

    @cache
    def bootstrap_of(outputs: tuple[str, ...], count: int) -> Bootstrap:
        return Bootstrap(groups[:count], [g.condition(outputs) for g in groups[:count]], known)

    def of(model: ModelResult) -> Bootstrap:
        return bootstrap_of(
            tuple(model.fit.costs), 1 if model.fit.structure.name == "lumped" else len(groups)
        )

    def bootstrapped(model: ModelResult) -> ModelResult:
        found = _with_bootstrap(model.fit, of(model), settings.bootstrap)
        if not settings.as_paper:
            conditions = [g.condition(tuple(found.costs)) for g in groups]
            found = with_structural_error(found, conditions, loss)
        return replace(model, fit=found)

    for model in models.values():  # before the threads, which would build the same one twice
        of(model)
    return dict(zip(models, side_by_side(bootstrapped, list(models.values())), strict=True))


def _with_bootstrap(fit: FitResult, bootstrap: Bootstrap, replicates: int) -> FitResult:
    found = {i.name: i for i in bootstrap.intervals(fit, replicates)}
    return replace(fit, estimates=tuple(replace(e, interval=found.get(e.name)) for e in fit.estimates))
