"""What a model is worth on runs that neither its fit nor its choice used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.diagnosis.candidates import Model
from rover_sweep.diagnosis.experiment import RATE, Experiment
from rover_sweep.diagnosis.floor import Floor
from rover_sweep.diagnosis.problem import Problem, centred, with_floors
from rover_sweep.diagnosis.result import Fit, HeldOut, Overlay
from rover_sweep.diagnosis.simulate import Sensors, logged
from rover_sweep.identify.recording import Array

UNITS = {"r": 180 / np.pi, "ay": 1 / 0.3048, "p": 180 / np.pi}  # deg/s, ft/s^2, deg/s: those of J_rms
SHOWN = 4  # of the simulation's samples that one of an overlay stands for
EXPLAINABLE = 1.05  # rows' mean square before, above which there is something to remove


@dataclass(frozen=True, eq=False)
class Modelled:
    """A model with its fitted coordinates."""

    model: Model
    x: Mapping[str, float]

    def log(self, run: Experiment) -> dict[str, Array]:
        """What the run's log would hold, {channel: (n,)}."""
        return logged(run, self.model.structure, self.x, Sensors.of(run))


def held_out(run: Experiment, before: Modelled, after: Modelled, floor: Floor, level: float) -> HeldOut:
    """Both models on one fresh run. level: mean square of a row where a model is right, 1 by definition."""
    problem = with_floors([run], [floor])
    costs = [_cost(problem, m) for m in (before, after)]
    noise = level * problem.size
    explainable = costs[0] - noise
    share = (costs[0] - costs[1]) / explainable if costs[0] > EXPLAINABLE * noise else None
    return HeldOut(run.name, _fit(run, before), _fit(run, after), share)


def _cost(problem: Problem, m: Modelled) -> float:
    rows = problem.measured - problem.model(m.model.structure, m.x)
    return float(rows @ rows)


def _fit(run: Experiment, m: Modelled) -> Fit:
    """J_rms and TIC, equations (15) and (16) of the paper, biases of the outputs taken out."""
    log, data = m.log(run), centred(run)
    errors, measured, model = [], [], []
    for c, factor in UNITS.items():
        if c in data:
            y, s = factor * data[c], factor * log[c]
            bias = np.mean(y - s)
            errors.append(np.mean((y - s - bias) ** 2))
            measured.append(np.mean(y**2))
            model.append(np.mean((s + bias) ** 2))
    rms = float(np.sqrt(np.mean(errors)))
    return Fit(rms, float(rms / (np.sqrt(np.mean(measured)) + np.sqrt(np.mean(model)))))


def overlays(
    runs: Sequence[Experiment], fresh: bool, before: Modelled, after: Modelled, floor: Floor
) -> tuple[Overlay, ...]:
    """Measured against both models for the pictures of some runs."""
    out = []
    for run in runs:
        one, two, data = before.log(run), after.log(run), centred(run)
        for c, y in data.items():
            w, left_before = _spectrum(y - one[c], run, floor, c)
            _, left_after = _spectrum(y - two[c], run, floor, c)
            k = slice(None, None, SHOWN)
            noise = floor.rms(c, 0.1, min(12.0, 0.4 * run.rates[c]))
            mean1, mean2 = np.mean(y - one[c]), np.mean(y - two[c])
            out.append(
                Overlay(run.name, c, fresh, run.begin + run.t[k], y[k], one[c][k] + mean1, two[c][k] + mean2,
                        noise, w, left_before, left_after)
            )  # fmt: skip
    return tuple(out)


def _spectrum(error: Array, run: Experiment, floor: Floor, channel: str) -> tuple[Array, Array]:
    """Power of a residual over that of the noise in 24 bands, with their frequencies [rad/s]."""
    f = np.fft.rfftfreq(error.size, 1 / RATE)
    power = np.abs(np.fft.rfft((error - error.mean()) * run.taper)) ** 2
    power *= 2 / (RATE * np.sum(run.taper**2))
    edges = np.geomspace(0.08, min(12.0, 0.4 * run.rates[channel]), 25)
    w, ratio = [], []
    for low, high in zip(edges, edges[1:], strict=False):
        inside = (f >= low) & (f < high)
        if inside.sum() >= 2:
            w.append(2 * np.pi * float(np.sqrt(low * high)))
            ratio.append(float(np.mean(power[inside] / floor.at(channel, f[inside]))))
    return np.array(w), np.array(ratio)
