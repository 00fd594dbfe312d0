"""From runs to models: responses, fits, what the instruments did to them, verification, verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rover_sweep.identify.fit import Condition, FitResult, costs, evaluated, fit, sampled
from rover_sweep.identify.geometry import GRAVITY, Geometry
from rover_sweep.identify.models.bicycle import bicycle
from rover_sweep.identify.models.kinematic import kinematic
from rover_sweep.identify.models.lumped import lumped
from rover_sweep.identify.models.roll_yaw import roll_yaw
from rover_sweep.identify.quality import CoherenceVerdict, assess, responses, sign_is_wrong
from rover_sweep.identify.recording import Recording
from rover_sweep.identify.reduction import ReductionStep, reduce
from rover_sweep.identify.response import Band, FrequencyResponse
from rover_sweep.identify.structure import ModelStructure
from rover_sweep.identify.verdicts import ModelVerdict, judge_model, kinematic_suffices
from rover_sweep.identify.verify import Verification, verify

MODELS = ("bicycle", "roll-yaw", "lumped")
FITTED = ("r", "ay", "p")
VYDOT_FROM = 3.0  # rad/s: below it the EKF's lateral velocity is GPS correction (paper: 3-25 rad/s)
SAME_SPEED = 0.10  # runs within 10 % share their responses


@dataclass(frozen=True)
class Settings:
    """How to identify. models of MODELS; fitted responses; tied: one C for both axles.

    band [rad/s]: swept range; bands: usable band per response; windows [s]: all found from the data
    when None. ignore_filters: fit as if the sensors had no low-pass.
    """

    models: tuple[str, ...] = MODELS
    fitted: tuple[str, ...] = FITTED
    tied: bool = True
    band: Band | None = None
    bands: Mapping[str, Band] = field(default_factory=dict)
    windows: tuple[float, ...] | None = None


@dataclass(frozen=True, eq=False)
class Group:
    """Runs at one speed [m/s] and their composite responses."""

    speed: float
    runs: tuple[Recording, ...]
    responses: Mapping[str, FrequencyResponse]

    def condition(self, outputs: Sequence[str], filtered: bool = True) -> Condition:
        """What the cost sees of these responses (those with a usable band)."""
        data = tuple(
            sampled(f, band) for f in (self.responses.get(o) for o in outputs) if f and (band := _band(f))
        )
        return Condition(self.speed, data, self.runs[0].filters if filtered else {})


def _band(f: FrequencyResponse) -> Band | None:
    return f.band


@dataclass(frozen=True, eq=False)
class ModelResult:
    """One model: its fit, costs of all four responses at it, variants of the fit, verification, verdict.

    variants: "filters ignored", "four responses", "Cf and Cr free", as far as they say something.
    """

    fit: FitResult
    costs: Mapping[str, float]
    variants: Mapping[str, FitResult]
    verification: tuple[Verification, ...]
    verdict: ModelVerdict
    reduction: tuple[ReductionStep, ...] = ()

    @property
    def average_all(self) -> float:
        """J_ave over all responses of the model, fitted or not."""
        return float(np.mean(list(self.costs.values())))


@dataclass(frozen=True, eq=False)
class Identification:
    """Everything that was found. recommended: the model to use, with `summary` saying why."""

    geometry: Geometry
    settings: Settings
    groups: tuple[Group, ...]
    coherence: tuple[CoherenceVerdict, ...]
    models: Mapping[str, ModelResult]
    refused: Mapping[str, str]
    recommended: str | None
    summary: tuple[str, ...]

    @property
    def speed(self) -> float:
        """Speed of the first group, m/s."""
        return self.groups[0].speed


def identify(
    runs: Sequence[Recording],
    geometry: Geometry,
    verify_on: Sequence[Recording] = (),
    settings: Settings | None = None,
) -> Identification:
    """Identifies the asked models from runs that have `delta`, and verifies them on other runs.

    A run that cannot carry a model gives a verdict with the reason, not an exception.
    """
    wanted = settings or Settings()
    groups = tuple(_group(g, wanted) for g in _by_speed(runs))
    quality = tuple(assess(run) for run in runs)
    stop = _why_not(groups[0])
    if stop:
        return Identification(
            geometry, wanted, groups, quality, {}, dict.fromkeys(wanted.models, stop), None, (stop,)
        )
    return _identified(groups, geometry, verify_on, wanted, quality)


def _by_speed(runs: Sequence[Recording]) -> list[list[Recording]]:
    """Runs in groups whose mean speeds lie within 10 % of the first of the group."""
    groups: list[list[Recording]] = []
    for run in runs:
        near = [g for g in groups if abs(run.mean_speed / g[0].mean_speed - 1) <= SAME_SPEED]
        if near:
            near[0].append(run)
        else:
            groups.append([run])
    return groups


def _group(runs: Sequence[Recording], settings: Settings) -> Group:
    found = responses(runs, band=settings.band, windows=settings.windows, bands=settings.bands)
    if "vydot" in found and "vydot" not in settings.bands:
        found["vydot"] = _above(found["vydot"], VYDOT_FROM)
    lengths = [run.span[1] - run.span[0] for run in runs]
    speed = float(np.average([run.mean_speed for run in runs], weights=lengths))
    return Group(speed, tuple(runs), found)


def _above(f: FrequencyResponse, low: float) -> FrequencyResponse:
    from dataclasses import replace

    if f.band is None or f.band[1] < 2 * low:
        return replace(f, band=None)
    return replace(f, band=(max(f.band[0], low), f.band[1]))


def _why_not(group: Group) -> str | None:
    """The reason why nothing can be identified, or None."""
    r = group.responses.get("r")
    if r is None or r.band is None:
        best = "no yaw rate was recorded" if r is None else f"highest coherence {np.max(r.coherence):.2f}"
        return f"nothing can be identified: no band where the yaw rate follows the steering ({best})"
    if sign_is_wrong(r):
        return (
            "the rover turns against the recorded steering angle: the sign of rad_per_us in the vehicle "
            "file is wrong for this linkage (a larger PWM turns it left), so give it the other sign"
        )
    return None


def _identified(
    groups: tuple[Group, ...], geometry: Geometry, verify_on: Sequence[Recording], settings: Settings,
    quality: tuple[CoherenceVerdict, ...],
) -> Identification:  # fmt: skip
    plain = _plain_result(kinematic(geometry), groups, verify_on, settings)
    models: dict[str, ModelResult] = {"kinematic": plain}
    refused: dict[str, str] = {}
    for name in settings.models:
        try:
            result = _model(name, groups, geometry, verify_on, settings)
        except _NotPossible as reason:
            refused[name] = str(reason)
        else:
            models[name] = result
    too_much = kinematic_suffices(models)
    if too_much:
        models = {n: (m if n == "kinematic" else _doubted(m, too_much)) for n, m in models.items()}
    best, words = _recommendation(models, too_much)
    return Identification(geometry, settings, groups, quality, models, refused, best, words)


class _NotPossible(Exception):
    """A model that these runs or this vehicle file cannot carry."""


def _model(
    name: str, groups: tuple[Group, ...], geometry: Geometry, verify_on: Sequence[Recording], settings: Settings
) -> ModelResult:
    if name == "bicycle":
        return _plain_result(bicycle(geometry, settings.tied), groups, verify_on, settings, geometry)
    _needs_roll(name, groups[0], geometry)
    structure = _freed(roll_yaw(geometry, settings.tied), geometry)
    if name == "roll-yaw":
        return _plain_result(structure, groups, verify_on, settings, geometry)
    if name == "lumped":
        return _lumped_result(structure, groups[:1], verify_on, settings, geometry)
    raise ValueError(f"no model {name!r}; there are {', '.join(MODELS)}")


def _needs_roll(name: str, group: Group, geometry: Geometry) -> None:
    if None in (geometry.sprung_mass, geometry.h, geometry.roll_inertia):
        raise _NotPossible(
            f"the {name} model needs sprung_mass, cg_height_above_roll_centre and roll_inertia in the vehicle file"
        )
    p = group.responses.get("p")
    if p is None or p.band is None:
        best = "it was not recorded" if p is None else f"its highest coherence is {np.max(p.coherence):.2f}"
        raise _NotPossible(f"the {name} model cannot be identified: the roll rate does not follow the steering ({best})")


def _freed(structure: ModelStructure, geometry: Geometry) -> ModelStructure:
    return structure.with_free([*(p.name for p in structure.free), *geometry.free])


def _starts(structure: ModelStructure) -> list[dict[str, float]]:
    """Further starting points: stiffness and inertia several times lower and higher."""
    values = structure.values
    out = []
    for stiffness, inertia in ((0.4, 0.6), (4.0, 1.5), (12.0, 1.0)):
        out.append(
            {n: values[n] * stiffness for n in ("C", "Cf", "Cr") if n in values}
            | ({"Izz": values["Izz"] * inertia} if "Izz" in values else {})
        )
    return [s for s in out if s]


def _plain_result(
    structure: ModelStructure, groups: tuple[Group, ...], verify_on: Sequence[Recording], settings: Settings,
    geometry: Geometry | None = None,
) -> ModelResult:  # fmt: skip
    starts = _starts(structure)
    best = fit(structure, [g.condition(settings.fitted) for g in groups], starts)
    near = best.structure
    variants = {}
    if any(g.runs[0].filters for g in groups):
        variants["filters ignored"] = fit(near, [g.condition(settings.fitted, False) for g in groups], starts)
    if "vydot" in structure.outputs and all(_has(g, "vydot") for g in groups):
        variants["four responses"] = fit(near, [g.condition(structure.outputs) for g in groups])
    if "C" in near.values and geometry is not None:
        maker = bicycle if structure.name == "bicycle" else roll_yaw
        loose = maker(geometry, False).with_values({**near.values, "Cf": near.values["C"], "Cr": near.values["C"]})
        variants["Cf and Cr free"] = fit(loose, [g.condition(settings.fitted) for g in groups])
    return _result(best, variants, groups, verify_on)


def _has(group: Group, output: str) -> bool:
    return output in group.responses and group.responses[output].band is not None


def _lumped_result(
    start: ModelStructure, groups: tuple[Group, ...], verify_on: Sequence[Recording], settings: Settings,
    geometry: Geometry,
) -> ModelResult:  # fmt: skip
    """The lumped model from the roll-yaw fit's derivatives, reduced; at the first speed only."""
    group = groups[0]
    outputs = (*settings.fitted, *(("vydot",) if _has(group, "vydot") else ()))
    first = fit(start, [group.condition(settings.fitted)], _starts(start)).structure
    conditions = [group.condition(settings.fitted)]
    full = fit(lumped(geometry, first, group.speed), conditions)
    best, steps = reduce(full, conditions)
    variants = {"before reduction": full}
    if "vydot" in outputs:
        variants["four responses"] = fit(best.structure, [group.condition(outputs)])
    return _result(best, variants, groups, verify_on, steps)


def _result(
    best: FitResult, variants: Mapping[str, FitResult], groups: Sequence[Group], verify_on: Sequence[Recording],
    steps: tuple[ReductionStep, ...] = (),
) -> ModelResult:  # fmt: skip
    structure = best.structure
    all_costs = costs(structure, [_only(g.condition(structure.outputs), structure) for g in groups])
    verification = tuple(verify(structure, run) for run in verify_on)
    return ModelResult(best, all_costs, variants, verification, judge_model(best, structure.name != "lumped"), steps)


def _only(condition: Condition, structure: ModelStructure) -> Condition:
    return Condition(
        condition.speed, tuple(d for d in condition.data if d.output in structure.outputs), condition.filters
    )


def _doubted(result: ModelResult, why: str) -> ModelResult:
    from dataclasses import replace

    return replace(result, verdict=ModelVerdict("not identifiable", (why, *result.verdict.sentences)))


Recommendation = tuple[str | None, tuple[str, ...]]


def _recommendation(models: Mapping[str, ModelResult], too_much: str | None) -> Recommendation:
    if too_much:
        return "kinematic", (f"use the kinematic model: {too_much}",)
    usable = {n: m for n, m in models.items() if m.verdict.level in ("good", "acceptable") and n != "kinematic"}
    if not usable:
        return None, ("no model fits these runs: see the verdict of each",)
    order = [n for n in ("roll-yaw", "bicycle", "lumped") if n in usable]
    best = order[0]
    return best, (f"use the {best} model: {usable[best].verdict.sentences[0]}",)


__all__ = ["GRAVITY", "Identification", "Literal", "ModelResult", "Settings", "evaluated", "identify"]
