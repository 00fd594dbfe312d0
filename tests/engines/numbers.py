"""`python -m tests.engines.numbers`: the rover's numbers by `identify`, on rovers of several engines.

Healthy rovers of the bench: three sweeps of each, a vehicle file with its owner's errors. For each number:
bias and rms of the error, how often it is within 5 %, how often the printed 90 % interval holds the truth,
and the median width of that interval. An engine's stiffness is that at zero slip, tau is its servo's lags
and delay.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import rover_sweep as rs
from tests.engines.draw import driven_runs
from tests.engines.engine import MODULES, EngineRover, drawn_rover, engine
from tests.foreign.recorded import drives

Row = dict[str, tuple[float, float, float, float]]


def identified(name: str, seed: int) -> tuple[str, Row]:
    """(recommended model or why there are no numbers, {number: true, value, low, high})."""
    used = engine(name)
    rng = np.random.default_rng([list(MODULES).index(name), seed, 4242])
    rover = drawn_rover(rng, used.sizes[int(rng.integers(len(used.sizes)))])
    found = rs.identify(driven_runs(used, rover, drives(rng, rover)[:3], rng)[0])
    if not found.numbers:
        return found.summary[-1], {}
    true = true_numbers(rover)
    known = [n for n in found.numbers if n.name in true and n.interval_90]
    return found.recommended or "", {n.name: (true[n.name], n.value, *n.interval_90) for n in known}


def true_numbers(rover: EngineRover) -> dict[str, float]:
    """The engine's own numbers, SI units."""
    n = rover.numbers
    tau = rover.delay + 1 / n.gain + n.motor_lag
    return {"Cf": n.Cf, "Cr": n.Cr, "Izz": n.Izz, "k_phi": n.kphi, "b_phi": n.bphi, "tau": tau}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.engines.numbers", description=__doc__)
    parser.add_argument("--engine", choices=[*MODULES, "all"], default="all")
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    for name in MODULES if args.engine == "all" else (args.engine,):
        found = list(_results(name, range(args.seed, args.seed + args.sets), args.jobs))
        rows = [row for _, row in found if row]
        print(f"{name}: numbers of {len(rows)} of {len(found)} rovers", flush=True)
        for why in sorted({why for why, row in found if not row}):
            print(f"  none: {why[:150]}")
        for number in rows[0] if rows else ():
            print("  " + _line(number, np.array([row[number] for row in rows if number in row])), flush=True)


def _results(name: str, seeds: range, jobs: int) -> Iterator[tuple[str, Row]]:
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(identified, [name] * len(seeds), seeds)


def _line(name: str, rows: np.ndarray) -> str:
    true, value, low, high = rows.T
    error = value / true - 1
    return (
        f"{name}: bias {100 * error.mean():+.1f} %, rms {100 * np.sqrt(np.mean(error**2)):.1f} %, within 5 % "
        f"{np.sum(np.abs(error) <= 0.05)} of {len(rows)}, holds {np.sum((low <= true) & (true <= high))} of "
        f"{len(rows)}, width {100 * np.median((high - low) / true):.0f} %"
    )


if __name__ == "__main__":
    main()
