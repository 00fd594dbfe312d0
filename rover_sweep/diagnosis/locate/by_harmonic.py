"""Where by harmonic: orders of a sweep's own instantaneous frequency (order analysis).

The residual is laid over the phase of the steering instead of time, so that what the steering's k-th
harmonic makes stands at order k, however fast the sweep runs. Windows of four cycles tell quarters of an
order apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.place_sentences import called, ordinal, times
from rover_sweep.diagnosis.locate.residual_maps import PLAIN, SURE, Residual, residuals_of
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.diagnosis.simulation.experiment import Experiment

CYCLES = 4  # of a window
POINTS = 64  # of a cycle
HIGHEST = 5  # order
SWEPT = ("sweep", "bias_sweep")
BESIDE = 2  # quarters of an order, either side of a harmonic, where its background stands
DISTORTED = 0.01  # of the power at the first harmonic, below which a higher one is no news


@dataclass(frozen=True, eq=False)
class Cycles:
    """Times (n + 1,) s at which the steering of a sweep has gone through whole cycles."""

    t: Array

    @staticmethod
    def of(run: Experiment) -> Cycles:
        """Those between the zero crossings to the side that the sweep begins with."""
        x = run.steer - np.median(run.steer)
        k = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
        t = run.t[k] - x[k] * (run.t[k + 1] - run.t[k]) / (x[k + 1] - x[k])
        swing = [np.max(np.abs(x[a : b + 1])) for a, b in zip(k[:-1], k[1:], strict=True)]
        whole = np.flatnonzero(np.array(swing) > 0.5 * run.amplitude)
        return Cycles(t[whole[0] : whole[-1] + 2] if whole.size else t[:0])

    @property
    def w(self) -> Array:
        """Frequency (n,) of each cycle, rad/s."""
        return 2 * np.pi / np.diff(self.t)


def by_order(problem: Problem, rows: Array, channel: str) -> list[Mismatch]:
    """Harmonics from the second on that stand out of what is beside them, in the sweeps."""
    power, count, band = _orders(problem, rows, channel)
    if power is None:
        return []
    told = []
    orders = [k for k in range(1, HIGHEST + 1) if count[4 * k] > 0]
    sizes = tuple(float(np.sqrt(power[4 * k])) for k in orders)
    profile = Profile("harmonic", "", tuple(float(k) for k in orders), sizes)
    for k in orders[1:]:
        at, size = 4 * k, float(np.sqrt(power[4 * k]))
        near = [j for j in (at - BESIDE, at + BESIDE) if j < power.size and count[j] > 0]
        beside = max(1.0, max((power[j] for j in near), default=1.0))
        sure = (power[at] / beside - 1) * np.sqrt(count[at]) > SURE
        if sure and power[at] > max(PLAIN**2 * beside, DISTORTED * power[4]):
            words = f"{ordinal(k)} harmonic"
            sentence = (
                f"{called(channel)} differs by {times(size)} at the {words} of the steering frequency, by "
                f"{np.sqrt(beside):.1f} beside it"
            )
            told.append(Mismatch(channel, band[k], words, size, sentence, profile))
    return told


def _orders(
    problem: Problem, rows: Array, channel: str
) -> tuple[Array | None, Array, dict[int, tuple[float, float]]]:
    """Power over noise and number of averages (quarter orders,), {order: its band, rad/s}."""
    size = 4 * (HIGHEST + 1)
    power, count = np.zeros(size), np.zeros(size)
    low, high = np.full(size, np.inf), np.zeros(size)
    for e in residuals_of(problem, rows, channel):
        if e.run.kind not in SWEPT:
            continue
        for w, tile in _tiles(e):
            at = 0.25 * np.arange(size) * w
            inside = (at >= e.low) & (at <= e.high)
            power[inside] += tile[inside]
            count[inside] += 1.0
            low[inside], high[inside] = np.minimum(low, at)[inside], np.maximum(high, at)[inside]
    if not count.any():
        return None, count, {}
    band = {k: (float(f"{low[4 * k]:.2g}"), float(f"{high[4 * k]:.2g}")) for k in range(HIGHEST + 1)}
    # windows overlap by half: a Hann window leaves them all but independent
    return power / np.maximum(count, 1.0), count, band


def _tiles(e: Residual) -> list[tuple[float, Array]]:
    """(steering frequency [rad/s], power over noise at quarter orders) of windows of four cycles."""
    cycles = Cycles.of(e.run)
    if cycles.t.size <= CYCLES:
        return []
    n = CYCLES * POINTS
    window = np.hanning(n + 1)[:n]
    out = []
    for k in range(0, cycles.t.size - CYCLES, CYCLES // 2):
        t = np.interp(np.arange(n) / POINTS, np.arange(CYCLES + 1), cycles.t[k : k + CYCLES + 1])
        x = np.interp(t, e.run.t, e.x)
        w = 2 * np.pi * CYCLES / (t[-1] - t[0]) * (n - 1) / n
        lines = np.abs(np.fft.rfft(x * window)[: 4 * (HIGHEST + 1)]) ** 2
        # one-sided noise of density S on a grid of POINTS a cycle: S/2 times the rate of the grid
        noise = e.density / 2 * POINTS * w / (2 * np.pi) * np.sum(window**2)
        out.append((float(w), lines / noise))
    return out
