"""Detectable sizes of this very plan: where an effect is found in half of 100 bootstrap sets.

The tool is asked, on runs of the same rover, plan and noise in which nothing is hidden: at which size does
what an effect adds, with the noise and the little of everything drawn 100 times, pass the threshold in half
of the draws, and its material size. An effect that takes more than `MOST` times its estimate in sizes.toml
has none in this plan. Where the material size alone decides (it is a parameter of the nominal model within),
the estimate of sizes.toml stands.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_sweep.api.read import read
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.effects import Effect, library
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.residuals import Array, Problem
from rover_sweep.diagnosis.problem.signatures import Signature, columns, signatures
from rover_sweep.diagnosis.problem.speed_drift import speed_drift
from rover_sweep.diagnosis.search.candidate_fits import Tangent, tangent
from rover_sweep.diagnosis.search.material import material_sizes
from rover_sweep.diagnosis.search.threshold import null_distribution
from rover_sweep.diagnosis.simulation.candidates import Model, possible
from rover_sweep.diagnosis.simulation.experiment import experiment
from tests.concealed.effects import table

SETS = 100
MOST = 3.0
STEPS = np.geomspace(1 / 16, 4.0, 9)  # of the plain size
CALLED = {("cross_slope", "b_cos"): "b"}
ESTIMATED = ("speed_variation", "tyre_slip", "roll_dof")

Sizes = dict[str, dict[str, float]]


def sizes(folder: Path, seed: int) -> Sizes:
    """{effect: {parameter: physical size}} for the runs 1 to 3 of a set that hides nothing."""
    runs = read(*(folder / f"run{k}.BIN" for k in (1, 2, 3)), vehicle=folder / "rover.toml")
    driven = [experiment(run) for run in runs]
    model = Model("roll-yaw", geometry_of(runs.vehicle), Tolerances())
    plain, fitted = fit_with_floor(driven, model, {})
    effects = possible(model, driven)[0]
    little = signatures(plain, fitted, model, effects, tolerances=True) + speed_drift(plain, fitted)
    problem = plain.in_metric(columns(little, plain.size))
    fitted = sensitivities(problem, fit(problem, model.structure, model.free, fitted.x))
    tiny = [replace(s, rows=problem.of(s.rows)) for s in little]
    seen = tangent(fitted)
    found = signatures(problem, fitted, model, effects)
    thresholds = null_distribution(found, tiny, seen, min(fitted.overdispersion, 1.5), 1).thresholds
    nuisance = seen.outside(columns(tiny, problem.size))
    out: Sizes = {name: dict(table()[name]["parameters"]) for name in ESTIMATED}
    for effect in effects:
        entry = table()[effect.id]["parameters"]
        own = dict(entry)
        for p in effect.parameters:
            name = CALLED.get((effect.id, p.name), p.name)
            if p.nominal or name not in entry:
                continue
            rows = _grown(problem, fitted, model, effect, p.name, seen)
            least = material_sizes(effect, model.spread).get(p.name, 0.0)
            draws = _Draws(nuisance, tiny, fitted.overdispersion, seed)
            size = max(_half(rows, thresholds.get(effect.id, 9.0), draws), least)
            if size <= MOST * abs(p.coordinate(entry[name])):
                own[name] = p.value(size)
            else:
                del own[name]
        if own:
            out[effect.id] = own
    return out


class _Draws:
    """What noise and the tiny effects of 100 rovers add along a direction."""

    def __init__(self, nuisance: Array, tiny: list[Signature], overdispersion: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        amounts = random.standard_normal((SETS, len(tiny)))
        self._amounts = np.where([s.signed for s in tiny], amounts, np.abs(amounts))
        self._noise = random.standard_normal(SETS) * np.sqrt(overdispersion)
        self._nuisance = nuisance

    def along(self, direction: Array) -> Array:
        """(SETS,) projections on a unit direction."""
        return self._noise + self._amounts @ (self._nuisance.T @ direction)


def _grown(
    problem: Problem, base: Fitted, model: Model, effect: Effect, parameter: str, seen: Tangent
) -> list[tuple[float, Array]]:
    """(coordinate, rows outside of the nominal model's reach) at growing sizes."""
    p = next(p for p in effect.parameters if p.name == parameter)
    out = []
    for step in STEPS:
        at = {effect.key(parameter): step * p.size}
        grown = signatures(problem, base, model, [replace(effect, parameters=(p,))], at)
        out.append((float(step * p.size), seen.outside(grown[0].rows)))
    return out


def _half(rows: list[tuple[float, Array]], threshold: float, draws: _Draws) -> float:
    """Coordinate at which half of the draws pass, between the sizes by the square root of the gain."""
    before = 0.0, 0.0
    for size, row in rows:
        length = float(np.linalg.norm(row))
        if length > 0:
            passed = float(np.median((length + draws.along(row / length)) ** 2)) ** 0.5
            wanted = threshold**0.5
            if passed >= wanted and length**2 >= 0.5 * threshold:
                share = (wanted - before[1]) / max(passed - before[1], 1e-9)
                return before[0] + float(np.clip(share, 0.0, 1.0)) * (size - before[0])
            before = size, min(passed, wanted)
    return float("inf")


def effects_of(found: Sizes) -> tuple[str, ...]:
    """The effects that have a size, in the order of the library."""
    return tuple(e for e in library() if e in found)
