"""Draws of noise on a known roll-yaw rover, identified by the whole pipeline, with bootstrap intervals."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.data.recording import LowPass, Recording
from rover_sweep.data.results import ByName
from rover_sweep.identification.bootstrap import Bootstrap
from rover_sweep.identification.fit import Condition, Estimate, FitResult, fit
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.models import roll_yaw
from rover_sweep.manoeuvre.sweep import Sweep

RMS = {"r": 0.014, "p": 0.03, "ay": 0.14}  # rad/s, rad/s, m/s^2 on the recordings, behind 20 Hz filters
FILTERS = {name: LowPass(20.0) for name in RMS}
FITTED = ("r", "ay", "p")
TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)


def coloured(n: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """White noise behind ArduPilot's second-order low-pass at 20 Hz, of unit variance on average."""
    ohm = np.tan(np.pi * 20.0 / rate)
    c = 1 + np.sqrt(2) * ohm + ohm**2
    b, a = np.array([1, 2, 1]) * ohm**2 / c, [1, 2 * (ohm**2 - 1) / c, (1 - np.sqrt(2) * ohm + ohm**2) / c]
    gain = lfilter(b, a, np.eye(1, int(rate))[0])
    return lfilter(b, a, rng.standard_normal(n + 200))[200:] / np.sqrt(np.sum(gain**2))


def disturbed(run: Recording, scale: float, rng: np.random.Generator) -> Recording:
    """The run with noise of `scale` times the recordings' level on r, p and ay."""
    noisy = {}
    for name, rms in RMS.items():
        s = run[name]
        noisy[name] = replace(s, x=s.x + scale * rms * coloured(s.x.size, s.rate, rng))
    return replace(run, channels={**run.channels, **noisy})


@dataclass(frozen=True)
class Draw:
    """One draw: the fit, its bootstrap intervals, the mean squared residual of the fit."""

    fit: FitResult
    intervals: ByName[Estimate]
    variance: float


def drawn(
    runs: list[Recording], scale: float, replicates: int, seed: int, settings: Settings | None = None
) -> Draw:
    """Noise, pipeline, fit and bootstrap of one draw."""
    rng = np.random.default_rng(seed)
    groups = grouped([disturbed(run, scale, rng) for run in runs], settings or Settings())
    conditions = [g.condition(FITTED) for g in groups]
    best = fit(roll_yaw(GEOMETRY), conditions)
    made = Bootstrap(groups, conditions).intervals(best, replicates, seed=seed)
    return Draw(best, made, _variance(best, conditions))


def _variance(best: FitResult, conditions: list[Condition]) -> float:
    points = sum(2 * d.w.size for c in conditions for d in c.data)
    return sum(best.costs.values()) * len(conditions) / (points - len(best.structure.free))


def clean_runs(count: int) -> list[Recording]:
    """`count` sweeps of 120 us at 2.4 m/s without noise, sampled at 200 Hz."""
    return [driven(TRUTH, Sweep(amplitude=120), filters=FILTERS)] * count
