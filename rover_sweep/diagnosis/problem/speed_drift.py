"""The slow error of the measured speed, a nuisance of every recording.

The model is driven by the speed that an EKF estimates from GPS and accelerometer. The error of that speed,
1 or 2 cm/s, drifts within seconds and multiplies the yaw rate. The residual that it causes grows with the
amplitude and would look like an effect.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem, whitened
from rover_sweep.diagnosis.problem.signatures import Signature
from rover_sweep.diagnosis.simulation.experiment import SPEED_ERROR
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.spectra.side_by_side import side_by_side

FASTEST = 0.3  # Hz; over shorter times the accelerometer determines the estimate


def speed_drift(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Signatures of the speed error: each run's cosines and sines up to `FASTEST`, one standard deviation."""
    return [one for run in range(len(problem.runs)) for one in _of_run(problem, fitted, run)]


def _of_run(problem: Problem, fitted: Fitted, index: int) -> Iterator[Signature]:
    run, sensors = problem.runs[index], problem.sensors[index]
    rows = tuple(r for r in problem.rows if r.run == index)
    now = logged(run, fitted.structure, fitted.x, sensors)
    length = float(run.t[-1])
    waves = int(FASTEST * length)

    def signature(wave: tuple[int, float]) -> Signature:
        number, phase = wave
        error = SPEED_ERROR / np.sqrt(waves) * np.cos(2 * np.pi * number * run.t / length + phase)
        moved = logged(replace(run, speed=run.speed + error), fitted.structure, fitted.x, sensors)
        change = {c: moved[c] - now[c] for c in moved}
        logs = [change if r == index else {} for r in range(len(problem.runs))]
        parts, start, column = whitened(rows, problem.runs, logs), 0, np.zeros(problem.size)
        for r in rows:
            column[r.start : r.start + r.size] = parts[start : start + r.size]
            start += r.size
        return Signature("speed", f"{run.name} {number}", SPEED_ERROR, True, column)

    return side_by_side(signature, [(n, p) for n in range(1, waves + 1) for p in (0.0, 0.5 * np.pi)])
