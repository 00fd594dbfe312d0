"""How long the core takes: four responses of a 55 s, 400 Hz record with five windows, three models, start-up.

    python tests/benchmarks/speed.py

The other side of each ratio runs in the same process: the responses against a Welch estimate by
scipy.signal.csd at the same five window lengths (no composite, no irregular stamps), the fits against
the same fits with a Jacobian by finite differences.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import csd, welch

sys.path.insert(0, str(Path(__file__).parents[1] / "identification"))
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.identification.fit import Condition, fit, residuals
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.models import bicycle, lumped, roll_yaw
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.coherence import responses

REPEATS = 5
WINDOWS = (5.0, 7.5, 11.0, 17.0, 25.0)


def median_time(work: Callable[[], object]) -> float:
    """Median of REPEATS runs after one to warm up, s."""
    work()
    taken = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def welch_responses(run: Recording) -> list[np.ndarray]:
    """Plain Welch estimates of the four responses at the five window lengths, on the even grid."""
    t, x = run.uniform(400.0)
    out = []
    for name in ("r", "ay", "vy", "p"):
        for length in WINDOWS:
            n = int(length * 400)
            spectra = csd(x["delta"], x[name], 400.0, nperseg=n, noverlap=int(0.8 * n))[1]
            out.append(spectra / welch(x["delta"], 400.0, nperseg=n, noverlap=int(0.8 * n))[1])
    return out


def three_models(condition: Condition, geometry: Geometry) -> None:
    """Bicycle, roll-yaw and lumped with their Cramer-Rao bounds and insensitivities."""
    fit(bicycle(geometry), [condition])
    best = fit(roll_yaw(geometry), [condition])
    fit(lumped(geometry, best.structure, condition.speed), [condition])


def by_differences(structure: ModelStructure, condition: Condition) -> None:
    """The roll-yaw fit with scipy's finite differences in place of the analytic Jacobian."""
    names = [p.name for p in structure.free]
    start = np.array([p.value for p in structure.free])

    def error(x: np.ndarray) -> np.ndarray:
        moved = structure.with_values(dict(zip(names, x * start, strict=True)))
        return np.concatenate(list(residuals(moved, condition).values()))

    least_squares(error, np.ones(start.size), x_scale="jac", xtol=1e-9, ftol=1e-9)


def started(*arguments: str) -> float:
    """Median wall time of a fresh Python process, s."""
    return median_time(lambda: subprocess.run([sys.executable, *arguments], check=True, capture_output=True))


def main() -> None:
    truth = roll_yaw(GEOMETRY).with_values(TRUE)
    run = driven(truth, Sweep(t_rec=55.0, straight=0.0, fade=0.0, dwell=0.0), noise=0.002, log_rate=500.0)
    print(f"record: {run.span[1]:.0f} s, {run['r'].rate:.0f} Hz, {run['r'].t.size} samples a channel")
    found = responses([run], windows=WINDOWS)
    condition = Group(run.mean_speed, (run,), found).condition(("r", "ay", "p"))
    ours, plain = (
        median_time(lambda: responses([run], windows=WINDOWS)),
        median_time(lambda: welch_responses(run)),
    )
    print(f"four responses, composite: {ours:.3f} s ({ours / plain:.2f} x plain Welch, {plain:.3f} s)")
    models = median_time(lambda: three_models(condition, GEOMETRY))
    print(f"three models with CR and insensitivity: {models:.3f} s")
    analytic = median_time(lambda: fit(roll_yaw(GEOMETRY), [condition]))
    numeric = median_time(lambda: by_differences(roll_yaw(GEOMETRY), condition))
    print(f"roll-yaw fit: {analytic:.4f} s ({analytic / numeric:.2f} x finite differences, {numeric:.4f} s)")
    print(f"responses and models together: {ours + models:.3f} s (wanted: under 1 s)")
    bare = started("-c", "pass")
    for what, arguments in {
        "import rover_sweep": ("-c", "import rover_sweep"),
        "rover-sweep --help": ("-m", "rover_sweep", "--help"),
        "rover-sweep identify --help": ("-m", "rover_sweep", "identify", "--help"),
    }.items():
        print(f"{what}: {started(*arguments):.3f} s (bare python {bare:.3f} s; wanted: under 0.5 s)")


if __name__ == "__main__":
    main()
