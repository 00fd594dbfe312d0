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
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "identification"))

from coverage_draws import Draw, clean_runs, drawn
from synthetic import TRUE

NORMAL_90 = 1.645


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
        100 * float(np.std(error)),
        100 * float(np.mean(error)),
        100 * float(np.mean([i.low <= truth <= i.high for i in intervals])),
        100 * float(np.mean([i.sd for i in intervals])) / truth,
        100 * float(np.mean(np.abs(error) <= NORMAL_90 * bound)),
        100 * float(np.mean(bound)),
        100 * float(np.mean(np.abs(error) <= NORMAL_90 * plain)),
        100 * float(np.mean(plain)),
    )


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
