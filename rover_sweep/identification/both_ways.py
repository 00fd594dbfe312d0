"""Tyres and steering of a rover driven forward and in reverse, side by side.

In reverse the trailing axle steers, so the yaw mode differs but the tyres should not. Each way is fitted
alone, with the structure of the fit to all runs. A difference reveals a rover that weaves one way only (a
linkage with play or caster, a servo that gives way, a load that moves).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.data.results import NORMAL_90, Quantity, ends_words, number
from rover_sweep.identification.bootstrap import with_intervals
from rover_sweep.identification.fit import FitResult, fit
from rover_sweep.identification.model_results import UNTIED, ModelResult, Work, fitted_result
from rover_sweep.identification.state_space import Matrices, ModelStructure, Parameter
from rover_sweep.identification.verify import RATE, simulated_outputs

GAIN = Parameter("gain", "-", 1.0, True, 0.2, 5.0, "road-wheel angle over that of the vehicle file")
TRIM = ("trim", "rad", "road-wheel angle that drives straight")
OF_MODES = ("yaw_frequency", "yaw_damping")
BLOCK = 5.0  # s, over which a mean turn is independent of the next
FEWEST_BLOCKS = 4


@dataclass(frozen=True)
class BothWays:
    """One quantity forward and in reverse.

    differs: the intervals do not overlap; None where one is missing. expected: it differs on a sound rover
    too, because the motion does.
    """

    forward: Quantity
    reverse: Quantity
    differs: bool | None
    expected: bool = False


def both_ways(model: ModelResult, work: Work) -> tuple[BothWays, ...]:
    """Compares free parameters, gain and trim of the steering, the yaw mode; () if driven one way only.

    model: with tyres, fitted to all runs; Cf and Cr are free here. The gain is that of each way with the
    tyres of all runs; the trim is from the mean yaw rate, in runs with a recorded standstill.
    """
    ways = [tuple(g for g in work.groups if (g.speed < 0) == backwards) for backwards in (False, True)]
    if not all(ways):
        return ()
    shared = model.variants.get(UNTIED, model.fit)
    fits = [_fitted(shared.structure, replace(work, groups=way)) for way in ways]
    gains = [_fitted(_with_gain(shared.structure), replace(work, groups=way)) for way in ways]
    trims = [
        _trim(found.structure, [run for g in way for run in g.runs])
        for found, way in zip(gains, ways, strict=True)
    ]
    rows = [tuple(found.parameters[p.name] for found in fits) for p in shared.structure.free]
    rows += [tuple(found.parameters[GAIN.name] for found in gains)]
    rows += [tuple(trim for trim in trims if trim is not None)]
    modes = [tuple(f.modes[n] for f in fits if n in f.modes) for n in OF_MODES]
    pairs = [_pair(*row) for row in rows if len(row) == 2]
    return (*pairs, *(replace(_pair(*row), expected=True) for row in modes if len(row) == 2))


def ways_compared(found: Sequence[BothWays]) -> tuple[str, ...]:
    """Sentences on agreement and differences of both ways; () without intervals."""
    judged = [pair for pair in found if pair.differs is not None and not pair.expected]
    apart = [pair for pair in judged if pair.differs]
    if not judged:
        return ()
    if not apart:
        same = ", ".join(pair.forward.name for pair in judged)
        return (f"forward and in reverse agree within their intervals in {same}",)
    told = "; ".join(
        f"{p.forward.name} {_words(p.forward)} forward, {_words(p.reverse)} in reverse" for p in apart
    )
    return (
        f"forward and in reverse differ by more than their intervals: {told}; the models fit both ways "
        "together, so identify each way alone",
    )


def _words(q: Quantity) -> str:
    return f"{number(q.value, 3)} {q.unit} ({ends_words(q.low, q.high)})".replace(" - (", " (")


def _pair(forward: Quantity, reverse: Quantity) -> BothWays:
    ends = [q.interval_90 for q in (forward, reverse)]
    differs = None
    if ends[0] and ends[1] and np.isfinite([*ends[0], *ends[1]]).all():
        differs = ends[0][1] < ends[1][0] or ends[1][1] < ends[0][0]
    return BothWays(_plain(forward), _plain(reverse), differs)


def _plain(q: Quantity) -> Quantity:
    return Quantity(q.name, q.unit, q.value, q.low, q.high, q.meaning)


def _fitted(structure: ModelStructure, work: Work) -> FitResult:
    """The fit to the runs of one way, with intervals where they were asked for."""
    found = fitted_result(fit(structure, work.conditions()), {}, replace(work, verify_on=()))
    made = with_intervals({structure.name: found}, work.groups, work.settings, work.geometry.friction)
    return made[structure.name].fit


def _with_gain(structure: ModelStructure) -> ModelStructure:
    """The structure with a gain of the steering; it and the delay are free, all else stays as fitted."""
    build = structure.build

    def steered(p: Mapping[str, Any]) -> Matrices:
        made = build(p)
        return replace(made, g=made.g * p[GAIN.name])

    found = replace(structure, parameters=(*structure.parameters, GAIN), build=steered)
    return found.with_free((GAIN.name, *(n for n in found.delays if n in {p.name for p in structure.free})))


def _trim(structure: ModelStructure, runs: Sequence[Recording]) -> Quantity | None:
    """The road-wheel angle that drives straight [rad], from what the model leaves of the mean yaw rate."""
    left: list[float] = []
    for run in runs:
        bias = run.bias("r")
        if bias is None:
            continue
        start, end = run.span
        grid = start + np.arange(int((end - start) * RATE) + 1) / RATE
        speed = run.mean_speed
        model = simulated_outputs(structure, speed, run["delta"].on(grid), RATE, run.filters)["r"]
        turned = run["r"].on(grid) - bias - model
        steady = structure.response(np.array([1e-3]), speed, "r")[0].real
        parts = np.array_split(turned, max(int((end - start) / BLOCK), 1))
        left += [-float(np.mean(part)) / steady for part in parts]
    if len(left) < FEWEST_BLOCKS:
        return None
    mean, error = float(np.mean(left)), NORMAL_90 * float(np.std(left, ddof=1)) / np.sqrt(len(left))
    name, unit, meaning = TRIM
    return Quantity(name, unit, mean, mean - error, mean + error, meaning)
