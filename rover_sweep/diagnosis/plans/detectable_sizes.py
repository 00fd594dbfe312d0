"""Detectable sizes: found in half of repeats by a diagnosis of these runs, with the bounds' mathematics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isfinite, sqrt

from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.plans.joint_problem import Expected
from rover_sweep.diagnosis.plans.plan_result import DetectableSize
from rover_sweep.diagnosis.posterior.upper_bounds import reported_value
from rover_sweep.diagnosis.search.material import EARLIER, LAGS, material_sizes
from rover_sweep.diagnosis.search.needed_size import Side, sides


def detectable(runs: Expected, asked: Sequence[str]) -> dict[str, DetectableSize]:
    """{effect: detectable size} of the asked effects, by ids; of the first parameter that has one."""
    out = {}
    for effect in (runs.signals.model.law(e) for e in asked):
        found = next((s for s in _sizes(runs, effect) if isfinite(s[1])), None)
        if found:
            out[effect.id] = _shown(effect, *found, runs)
    return out


def _sizes(runs: Expected, effect: Effect) -> Iterator[tuple[EffectParameter, float]]:
    """(parameter, its detectable coordinate without sign), infinite where no size is detectable.

    Both signs must be found, in each form. A change in one run is in the run that shows it best.
    """
    model, problem = runs.signals.model, runs.signals.problem
    both: dict[str, dict[tuple[str, float], float]] = {}
    for side in sides(effect, model, tuple(r.name for r in problem.runs)):
        ways, way = both.setdefault(side.parameter.name, {}), (side.effect.name, side.way)
        ways[way] = min(ways.get(way, inf), _found_from(runs, side))
    least = material_sizes(effect, model.spread, model.rover.wheelbase)
    for p in effect.parameters:
        if p.name in both:
            yield p, max(*both[p.name].values(), least.get(p.name, 0.0))


def _found_from(runs: Expected, side: Side) -> float:
    """The size of this sign, as a coordinate without sign, that half of repeats find."""
    needed = sqrt(runs.thresholds.get(side.effect.id, 0.0))
    growth = runs.signals.growth(side, needed)
    if growth is None:
        return inf
    size = abs(growth.coordinate_of(needed))
    if side.effect.id in LAGS:  # a finding only where both lags together are above the normal tolerance
        other = "delay" if side.effect.id == "servo_lag" else "lag"
        size = max(size, runs.signals.model.spread.together - runs.signals.fitted.x[other])
    return size


def _shown(effect: Effect, parameter: EffectParameter, size: float, runs: Expected) -> DetectableSize:
    model = runs.signals.model
    material = material_sizes(effect, model.spread, model.rover.wheelbase).get(parameter.name)
    way = -1.0 if effect.id == "clock_offset" else 1.0
    name, unit, value = reported_value(effect, parameter, way * size)
    if effect.id == "clock_offset":
        material = EARLIER
    matters = None if material is None else reported_value(effect, parameter, way * material)[2]
    return DetectableSize(name, unit, value, matters)
