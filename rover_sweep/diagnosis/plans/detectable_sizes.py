"""Detectable sizes from signatures at two sizes: the signature of a limit grows steeply with its size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import log

import numpy as np

from rover_sweep.diagnosis.effects import Effect, EffectParameter, library
from rover_sweep.diagnosis.plans.plan_result import DetectableSize
from rover_sweep.diagnosis.plans.set_result import Size, Stacked
from rover_sweep.diagnosis.search.material import EARLIER, material_sizes

STEEPNESS = (0.5, 4.0)  # bounds of the exponent of a signature's length in its size


def detectable(
    first: Stacked, again: Callable[[Mapping[str, float]], Stacked], asked: Sequence[str]
) -> dict[str, DetectableSize]:
    """{effect: detectable size} of the asked effects, by ids.

    first: the runs with signatures at plain sizes. again: gives the same runs with signatures at the sizes
    {coordinate: size}.
    """
    sizes = {e: next(iter(first.sizes[e].values())) for e in asked if e in first.sizes}
    at = {library()[e].key(size.parameter.name): _own(size, e) for e, size in sizes.items()}
    second = again({name: size for name, size in at.items() if size})
    out = {}
    for effect, size in sizes.items():
        coordinate = size.coordinate
        if _own(size, effect):
            coordinate = _steep(first, second, size)
        out[effect] = _detectable_size(library()[effect], size.parameter, coordinate, first)
    return out


def _own(size: Size, effect: str) -> float:
    """The coordinate if the effect adds it, 0 if the nominal model has it."""
    return 0.0 if size.parameter.nominal else size.coordinate


def _steep(first: Stacked, second: Stacked, size: Size) -> float:
    """The size with a signature of the needed length, by a power law through the lengths at two sizes."""
    k, effect = size.column, first.found[size.column].effect
    sizes = [abs(s.found[k].size) for s in (first, second)]
    lengths = [float(np.linalg.norm(s.judged.outside(s.held(effect))[:, k])) for s in (first, second)]
    needed = float(np.sqrt(first.thresholds[effect]))
    if abs(log(sizes[1] / sizes[0])) < 0.05 or min(lengths) < 1e-6:
        return size.coordinate
    power = log(lengths[1] / lengths[0]) / log(sizes[1] / sizes[0])
    power = float(np.clip(power, *STEEPNESS))
    least = material_sizes(library()[effect], first.model.spread).get(size.parameter.name, 0.0)
    return max(sizes[1] * (needed / lengths[1]) ** (1.0 / power), least)


def _detectable_size(
    effect: Effect, parameter: EffectParameter, coordinate: float, stacked: Stacked
) -> DetectableSize:
    material = material_sizes(effect, stacked.model.spread).get(parameter.name)
    name, unit, value = _reported(effect, parameter, coordinate)
    if effect.id == "clock_offset":
        material = EARLIER
    matters = None if material is None else _reported(effect, parameter, material)[2]
    return DetectableSize(name, unit, value, matters)


def _reported(effect: Effect, parameter: EffectParameter, coordinate: float) -> tuple[str, str, float]:
    """(name, unit, value) of one parameter as a user reads it."""
    if not effect.report_values:
        return parameter.name, parameter.unit, float(parameter.value(coordinate))
    way = -1.0 if effect.id == "clock_offset" else 1.0
    values = {p.name: p.value(0.0) for p in effect.parameters}
    shown = effect.report_values(values | {parameter.name: parameter.value(way * coordinate)})
    name = next(iter(shown))
    return name, shown[name][1], float(shown[name][0])
