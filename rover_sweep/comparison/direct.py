"""Response against response: the difference of pairs of runs in sizes of both noise floors together.

The steering and the speed of both sides differ a little, by their noise and the time stamps of each log. So
one model, the same for both, takes out what follows from that: compared are D - f(u_D) and S - f(u_S).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.comparison.answer import Agreement
from rover_sweep.comparison.common_model import FittedSide
from rover_sweep.comparison.pairing import Pair
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.noise_floor import Floor, level_of
from rover_sweep.diagnosis.problem.residuals import Problem, centred, whitened, with_floor
from rover_sweep.diagnosis.problem.signatures import columns
from rover_sweep.diagnosis.problem.speed_drift import speed_drift
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged

CHANNELS = ("r", "ay", "p", "vy")
Signals = dict[str, Array]


@dataclass(frozen=True, eq=False)
class Direct:
    """Pairs with their difference.

    problem: of the recorded runs, with the noise floor of both sides. rows (n,): whitened difference,
    recorded minus simulated. allowed (n,): the same with the errors of both speeds allowed for.
    """

    pairs: tuple[Pair, ...]
    problem: Problem
    rows: Array
    allowed: Array

    def agreement(self, held_out: bool) -> tuple[Agreement, ...]:
        """Each run against its simulation."""
        return tuple(self._of_run(k, held_out) for k in range(len(self.pairs)))

    def _of_run(self, k: int, held_out: bool) -> Agreement:
        parts = {c: self.problem.part(self.allowed, k, c) for c in CHANNELS}
        levels = {c: _rms(part) for c, part in parts.items() if part.size}
        pair = self.pairs[k]
        whole = _rms(self.problem.part(self.allowed, k))
        return Agreement(pair.recorded.name, pair.simulated.name, held_out, whole, levels)


def direct(
    pairs: Sequence[Pair], recordings: FittedSide, simulation: FittedSide, unused: bool = False
) -> Direct:
    """The difference of pairs with the noise floors of both sides; `recordings` has the model to take out.

    unused: the runs are no part of the sides, so the floors are scaled to the runs' own noise.
    """
    left = [(_residual(p.recorded, recordings), _residual(p.simulated, recordings)) for p in pairs]
    one, two = recordings.plain.floor, simulation.plain.floor
    if unused:
        one = _scaled(one, [p.recorded for p in pairs], [d for d, _ in left])
        two = _scaled(two, [p.simulated for p in pairs], [s for _, s in left])
    runs = [p.recorded for p in pairs]
    problem = with_floor(runs, sum_of(one, two))
    gaps = [_gap(p, d, s) for p, (d, s) in zip(pairs, left, strict=True)]
    rows = whitened(problem.rows, runs, gaps)
    metric = problem.in_metric(np.sqrt(2.0) * columns(speed_drift(problem, recordings.fitted), problem.size))
    return Direct(tuple(pairs), problem, rows, metric.of(rows))


def sum_of(one: Floor, two: Floor) -> Floor:
    """The noise of a difference: both densities together."""
    shared = [c for c in one.density if c in two.density]
    density = {c: one.density[c] + two.at(c, one.f) for c in shared}
    tops = {c: min(f.top.get(c, np.inf) for f in (one, two)) for c in shared}
    return Floor(one.f, density, {c: top for c, top in tops.items() if np.isfinite(top)})


def _residual(run: Experiment, side: FittedSide) -> Signals:
    model = logged(run, side.fitted.structure, side.fitted.x, Sensors.of(run))
    return {c: y - model[c] for c, y in centred(run).items()}


def _gap(pair: Pair, recorded: Signals, simulated: Signals) -> Signals:
    """Recorded minus simulated residual on the recorded run's grid."""
    t = pair.recorded.t + pair.late
    at = pair.simulated.t
    return {
        c: y - np.interp(t, at, simulated[c]) if c in simulated else np.zeros(y.size)
        for c, y in recorded.items()
    }


def _scaled(floor: Floor, runs: Sequence[Experiment], residuals: Sequence[Mapping[str, Array]]) -> Floor:
    """The floor at the mean noise level of other runs, channel by channel."""
    levels = [level_of(run, dict(left), floor) for run, left in zip(runs, residuals, strict=True)]
    factor = {c: float(np.mean([level.get(c, 1.0) for level in levels])) for c in floor.density}
    return Floor(floor.f, {c: d * factor[c] for c, d in floor.density.items()}, floor.top)


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(rows**2))) if rows.size else 0.0
