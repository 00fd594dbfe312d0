"""Bootstrap intervals of all models that were identified from the same runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

from rover_sweep.identification.bootstrap.bootstrap import Bootstrap
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.grouping import Group, Settings
from rover_sweep.identification.model_results import ModelResult


def with_intervals(
    models: Mapping[str, ModelResult], groups: Sequence[Group], settings: Settings
) -> dict[str, ModelResult]:
    """The models with intervals of their free parameters, as many replicates as the settings ask for.

    Without any where responses are conditioned on another input: the replicates are driven by the
    steering alone. A lumped model belongs to the first speed.
    """
    if not settings.bootstrap or any(g.others for g in groups):
        return dict(models)

    @cache
    def maker(outputs: tuple[str, ...], count: int) -> Bootstrap:
        return Bootstrap(groups[:count], [g.condition(outputs) for g in groups[:count]])

    def told(model: ModelResult) -> ModelResult:
        count = 1 if model.fit.structure.name == "lumped" else len(groups)
        return replace(model, fit=_told(model.fit, maker(tuple(model.fit.costs), count), settings.bootstrap))

    return {name: told(model) for name, model in models.items()}


def _told(fit: FitResult, maker: Bootstrap, replicates: int) -> FitResult:
    found = {i.name: i for i in maker.intervals(fit, replicates)}
    return replace(fit, estimates=tuple(replace(e, interval=found.get(e.name)) for e in fit.estimates))
