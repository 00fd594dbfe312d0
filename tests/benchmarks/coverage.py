"""Do the intervals hold the truth as often as they say? Monte Carlo over noise on a known roll-yaw rover.

    PYTHONPATH=. python tests/benchmarks/coverage.py [--draws 200] [--replicates 200] [--runs 1] [--scale 1]

The rover is driven once by the sweep; every draw adds new coloured noise (gyro and accelerometer noise
behind ArduPilot's 20 Hz filters at the levels of the recordings), identifies by the whole pipeline and
asks for intervals. Three kinds are counted: the bootstrap's; the estimate -+ 1.645 Cramer-Rao bounds, as
equation (13) prints them; and -+ 1.645 standard errors of least squares, which take the 20 points of each
response for independent.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1] / "identify"))

from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.identify.bootstrap import Bootstrap, Intervals
from rover_sweep.identify.fit import Condition, FitResult, fit
from rover_sweep.identify.grouping import Settings, grouped
from rover_sweep.identify.models.roll_yaw import roll_yaw
from rover_sweep.identify.recording import LowPass, Recording
from rover_sweep.identify.sweep import Sweep

RMS = {"r": 0.014, "p": 0.03, "ay": 0.14}  # rad/s, rad/s, m/s^2 on the recordings, behind 20 Hz filters
FILTERS = {name: LowPass(20.0) for name in RMS}
FITTED = ("r", "ay", "p")
TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)
NORMAL_90 = 1.645


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
    intervals: tuple[Intervals, ...]
    variance: float


def drawn(runs: list[Recording], scale: float, replicates: int, seed: int) -> Draw:
    """Noise, pipeline, fit and bootstrap of one draw."""
    rng = np.random.default_rng(seed)
    groups = grouped([disturbed(run, scale, rng) for run in runs], Settings())
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


@dataclass(frozen=True)
class Coverage:
    """Of one parameter, in percent of the truth where a unit is due."""

    name: str
    scatter: float
    bias: float
    bootstrap: float
    bootstrap_sd: float
    cramer_rao: float
    cramer_rao_bound: float
    least_squares: float
    standard_error: float


def coverage(draws: list[Draw]) -> list[Coverage]:
    """How often each kind of 90 % interval held the truth."""
    return [_coverage(draws, k, name) for k, name in enumerate(TRUE)]


def _coverage(draws: list[Draw], k: int, name: str) -> Coverage:
    truth = TRUE[name]
    error = np.array([d.fit[name].value for d in draws]) / truth - 1
    intervals = [d.intervals[k] for d in draws]
    assert all(i.name == name for i in intervals)
    bound = np.array([d.fit[name].cr_percent * d.fit[name].value / truth / 100 for d in draws])
    plain = bound / np.sqrt(2) * np.sqrt([d.variance for d in draws])
    return Coverage(
        name,
        100 * float(np.std(error)), 100 * float(np.mean(error)),
        100 * float(np.mean([i.low <= truth <= i.high for i in intervals])),
        100 * float(np.mean([i.sd for i in intervals])) / truth,
        100 * float(np.mean(np.abs(error) <= NORMAL_90 * bound)), 100 * float(np.mean(bound)),
        100 * float(np.mean(np.abs(error) <= NORMAL_90 * plain)), 100 * float(np.mean(plain)),
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--replicates", type=int, default=200)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--scale", type=float, default=1.0, help="noise, in the recordings' own level")
    asked = parser.parse_args()
    runs, started = clean_runs(asked.runs), time.perf_counter()
    draws = [drawn(runs, asked.scale, asked.replicates, seed) for seed in range(asked.draws)]
    took = time.perf_counter() - started
    failed = sum(d.intervals[0].failed for d in draws)
    print(
        f"{asked.draws} draws x {asked.replicates} replicates, {asked.runs} run(s) of 66 s, noise x "
        f"{asked.scale:g}: {took:.0f} s, {failed} replicates failed. Coverage of 90 % intervals:"
    )
    show(coverage(draws))


def show(rows: list[Coverage]) -> None:
    """The table, all in percent but the ratios to the scatter."""
    print(
        f"{'':7}{'scatter':>9}{'bias':>8}  | {'bootstrap':>9}{'sd':>7}{'/scatter':>9}"
        f"  | {'CR':>6}{'bound':>8}{'/scatter':>9}  | {'lsq':>6}{'s.e.':>7}{'/scatter':>9}"
    )
    for c in rows:
        print(
            f"{c.name:7}{c.scatter:9.2f}{c.bias:8.2f}"
            f"  | {c.bootstrap:9.1f}{c.bootstrap_sd:7.2f}{c.bootstrap_sd / c.scatter:9.2f}"
            f"  | {c.cramer_rao:6.1f}{c.cramer_rao_bound:8.2f}{c.cramer_rao_bound / c.scatter:9.2f}"
            f"  | {c.least_squares:6.1f}{c.standard_error:7.2f}{c.standard_error / c.scatter:9.2f}"
        )


if __name__ == "__main__":
    main()
