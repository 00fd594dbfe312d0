"""Residual of the fitted baseline in yaw and lateral acceleration, and signals that may explain it.

The errors e = measured - simulated of r, V_y and a_y follow e' = A e + d, with the matrix A of the fitted
single-track model; d is the discrepancy (Kaheman et al. 2019, arXiv 1909.08574). Known low-passes of the
channels are divided out, which is possible below BAND_HZ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, rfft

from rover_sweep.data.recording import Array
from rover_sweep.data.vehicle_geometry import geometry_of, tolerances_of
from rover_sweep.diagnosis.held_out import FittedModel
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.problem.residuals import centred
from rover_sweep.diagnosis.simulation.candidates import SAME_SPEED, Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, experiment, in_order
from rover_sweep.diagnosis.simulation.simulator import motion, vehicle_numbers
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.model_results import determined_model
from tests.engines.draw import BenchSet

BAND_HZ = 4.0
EVERY = 5  # samples of the grid: 20 Hz
STRAIGHT = 0.02  # of the amplitude: below it the rover drives straight
SETTLED = 1.0  # s after the last deflection
WHOLE = 0.99  # taper of the samples that are used
EQUATIONS = ("yaw", "lateral")


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """One run. left: residual {"yaw": r' (k,) [rad/s^2], "lateral": a_y (k,) [m/s^2]} of the baseline.

    noise: {equation: its rms in straight driving of runs of about the same speed}. signals: {name: (k,)} of
    the simulated motion.
    """

    left: Mapping[str, Array]
    noise: Mapping[str, float]
    signals: Mapping[str, Array]


def discrepancies(drawn: BenchSet) -> tuple[list[Discrepancy], list[Discrepancy]]:
    """(those of the used runs, those of the held-out runs) by a baseline that is fitted to the used runs."""
    assert drawn.runs.vehicle is not None
    rover = geometry_of(drawn.runs.vehicle)
    every = in_order([experiment(run) for run in (*drawn.runs, *drawn.held_out)])
    used = every[: len(drawn.runs)]
    baseline = determined_model(grouped(drawn.runs, Settings()), rover)[0]
    model = Model(baseline, rover, tolerances_of(drawn.runs.vehicle))
    closest = fit_with_floor(used, model, {})[1]  # the first half of `model_fit`
    fitted = FittedModel(model, closest.x)
    lacking = [_left(run, fitted) for run in every]
    found = []
    for run, left in zip(every, lacking, strict=True):
        alike = [
            k for k, other in enumerate(every) if abs(other.mean_speed / run.mean_speed - 1) < SAME_SPEED
        ]
        noise = {
            e: float(np.sqrt(np.mean(np.concatenate([_quiet(every[k], lacking[k][e]) for k in alike]) ** 2)))
            for e in EQUATIONS
        }
        kept = np.flatnonzero(run.taper > WHOLE)[::EVERY]
        moved = {name: y[kept] for name, y in _signals(motion(run, model.structure, closest.x)).items()}
        found.append(Discrepancy({e: y[kept] for e, y in left.items()}, noise, moved))
    return found[: len(used)], found[len(used) :]


def _left(run: Experiment, fitted: FittedModel) -> dict[str, Array]:
    """{equation: (n,)} that the model lacks."""
    log, data = fitted.log(run), centred(run)
    f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
    inside = 1.0 / (1.0 + (f / BAND_HZ) ** 8)
    paths = {c: run.filters[c].response(2 * np.pi * f) if c in run.filters else 1.0 for c in data}
    lines = {c: rfft((y - log[c]) * run.taper) * inside / paths[c] for c, y in data.items()}
    error = {c: irfft(line, run.t.size) for c, line in lines.items()}
    r_dot = irfft(2j * np.pi * f * lines["r"], run.t.size)
    rates = _rates(run, fitted)
    sideways = error.get("vy", np.zeros(run.t.size))
    # a heading that is a little wrong shifts V_y, which would look like a constant side force
    sideways = sideways - np.mean(np.concatenate(_straight(run, sideways)))
    return {
        "yaw": r_dot - rates[0] * error["r"] - rates[1] * sideways,
        "lateral": error["ay"] - rates[2] * error["r"] - rates[3] * sideways,
    }


def _straight(run: Experiment, y: Array) -> list[Array]:
    """y (n,) of straight driving before the first and after the last deflection."""
    steered = np.flatnonzero(np.abs(run.steer - np.median(run.steer)) > STRAIGHT * run.amplitude)
    before, after = np.zeros(y.size, bool), np.zeros(y.size, bool)
    before[: steered[0]] = True
    after[steered[-1] + int(SETTLED * RATE) :] = True
    whole = run.taper > WHOLE
    return [y[part & whole] for part in (before, after) if np.any(part & whole)]


def _quiet(run: Experiment, left: Array) -> Array:
    """Samples of straight driving, less the mean of each stretch."""
    return np.concatenate([part - np.mean(part) for part in _straight(run, left)])


def _rates(run: Experiment, fitted: FittedModel) -> tuple[Array, Array, Array, Array]:
    """r' for an error of r and of v, a_y for an error of r and of v, of the single track; (n,) each."""
    q, zero = vehicle_numbers(fitted.model.structure, fitted.x), np.zeros(run.t.size)
    if not fitted.model.slip:
        return zero, zero, zero, zero
    across, moment = q.Cf + q.Cr, q.a * q.Cf - q.b * q.Cr
    turning = q.a**2 * q.Cf + q.b**2 * q.Cr
    speed = run.speed
    return (
        -turning / (q.Izz * speed),
        -moment / (q.Izz * speed),
        -moment / (q.m * speed),
        -across / (q.m * speed),
    )


def _signals(moved: Mapping[str, Array]) -> dict[str, Array]:
    """delta, its rate, V, v, r, r', p, p', phi, a_y, and the heading psi."""
    names = {"delta": "delta", "V": "V", "v": "v", "r": "r", "r'": "r_dot", "p": "p", "p'": "p_dot"}
    names |= {"phi": "phi", "a_y": "across", "psi": "psi"}
    found = {name: moved[key] for name, key in names.items()}
    return found | {"delta'": np.gradient(moved["delta"], 1 / RATE)}
