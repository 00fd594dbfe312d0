"""Coherence between throttle and speed: whether the throttle caused the speed that was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.data.throttle_run import ThrottleRun
from rover_sweep.identification.speed.speed_fit import PERIOD, grid_of

GOOD = 0.6  # Tischler & Remple 2012
WINDOWS = 5  # lengths of the sweep in a run, for the averages


@dataclass(frozen=True, eq=False)
class ThrottleCoherence:
    """w (n,) [rad/s]; coherence (n,); gain (n,) [m/s per full throttle], phase (n,) [rad] as measured; band:
    usable (lowest, highest) [rad/s], None without one."""

    w: Array
    coherence: Array
    gain: Array
    phase: Array
    band: tuple[float, float] | None


def throttle_coherence(runs: Sequence[ThrottleRun]) -> ThrottleCoherence:
    """By Welch's averages over all runs, in the swept range."""
    from scipy.signal import csd, welch

    length = min(int(grid_of(run).size) for run in runs) // WINDOWS * 2
    u_u = v_v = u_v = np.zeros(length // 2 + 1)
    f = np.zeros(length // 2 + 1)
    for run in runs:
        t = grid_of(run)
        u, v = run.drive(t), run.speed.on(t)
        options = {"fs": 1 / PERIOD, "nperseg": length, "noverlap": length * 3 // 4, "detrend": "linear"}
        f, power = welch(u, **options)
        u_u = u_u + power
        v_v = v_v + welch(v, **options)[1]
        u_v = u_v + csd(u, v, **options)[1]
    low, high = (min(r.swept[0] for r in runs), max(r.swept[1] for r in runs))
    w = 2 * np.pi * f
    used = (w >= max(low, w[1])) & (w <= high)
    response = u_v[used] / u_u[used]
    coherence = np.abs(u_v[used]) ** 2 / (u_u[used] * v_v[used])
    return ThrottleCoherence(
        w[used], coherence, np.abs(response), np.unwrap(np.angle(response)), _band(w[used], coherence)
    )


def _band(w: Array, coherence: Array) -> tuple[float, float] | None:
    """The longest stretch in log frequency above `GOOD`."""
    ok = np.concatenate(([False], coherence >= GOOD, [False]))
    edges = np.flatnonzero(np.diff(ok.astype(int))).reshape(-1, 2)
    stretches = [(float(w[a]), float(w[b - 1])) for a, b in edges if b - a > 1]
    return max(stretches, key=lambda s: s[1] / s[0]) if stretches else None
