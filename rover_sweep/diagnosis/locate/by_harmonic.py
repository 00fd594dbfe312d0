"""Location by harmonic: order analysis of a sweep.

The residual is resampled over the phase of the steering instead of time. What is caused at the k-th harmonic
of the steering frequency is then at order k, at any sweep rate. Windows of four cycles resolve quarters of an
order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.place_sentences import channel_name, noise_ratio, ordinal
from rover_sweep.diagnosis.locate.residual_maps import LARGE, SIGMAS, Residual, residuals_of
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.diagnosis.simulation.experiment import Experiment

CYCLES = 4  # of a window
POINTS = 64  # of a cycle
HIGHEST = 5  # order
SWEPT = ("sweep", "bias_sweep")
NEIGHBOUR = 2  # quarters of an order from a harmonic to its background, on both sides
DISTORTED = 0.01  # share of the first harmonic's power below which a higher one is not reported


@dataclass(frozen=True, eq=False)
class Cycles:
    """Times (n + 1,) [s] at which the n whole cycles of a sweep's steering begin, and the last one ends."""

    t: Array

    @staticmethod
    def of(run: Experiment) -> Cycles:
        """The cycles between upward zero crossings, without parts where the amplitude is below half."""
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
    """Harmonics from the second on that are above their background, in the sweeps."""
    power, count, band = _orders(problem, rows, channel)
    if power is None:
        return []
    out = []
    orders = [k for k in range(1, HIGHEST + 1) if count[4 * k] > 0]
    sizes = tuple(float(np.sqrt(power[4 * k])) for k in orders)
    profile = Profile("harmonic", "", tuple(float(k) for k in orders), sizes)
    for k in orders[1:]:
        at, size = 4 * k, float(np.sqrt(power[4 * k]))
        near = [j for j in (at - NEIGHBOUR, at + NEIGHBOUR) if j < power.size and count[j] > 0]
        background = max(1.0, max((power[j] for j in near), default=1.0))
        sure = (power[at] / background - 1) * np.sqrt(count[at]) > SIGMAS
        if sure and power[at] > max(LARGE**2 * background, DISTORTED * power[4]):
            words = f"{ordinal(k)} harmonic"
            sentence = (
                f"{channel_name(channel)} differs by {noise_ratio(size)} at the {words} of the steering "
                f"frequency and by {np.sqrt(background):.1f} next to it"
            )
            out.append(Mismatch(channel, band[k], words, size, sentence, profile))
    return out


def _orders(
    problem: Problem, rows: Array, channel: str
) -> tuple[Array | None, Array, dict[int, tuple[float, float]]]:
    """(power over noise, number of averages) at quarter orders (24,), {order: its band [rad/s]}."""
    size = 4 * (HIGHEST + 1)
    power, count = np.zeros(size), np.zeros(size)
    low, high = np.full(size, np.inf), np.zeros(size)
    for e in residuals_of(problem, rows, channel):
        if e.run.kind not in SWEPT:
            continue
        for w, power_of_window in _windows(e):
            at = 0.25 * np.arange(size) * w
            inside = (at >= e.low) & (at <= e.high)
            power[inside] += power_of_window[inside]
            count[inside] += 1.0
            low[inside], high[inside] = np.minimum(low, at)[inside], np.maximum(high, at)[inside]
    if not count.any():
        return None, count, {}
    band = {k: (float(f"{low[4 * k]:.2g}"), float(f"{high[4 * k]:.2g}")) for k in range(HIGHEST + 1)}
    # Hann windows that overlap by half are nearly independent
    return power / np.maximum(count, 1.0), count, band


def _windows(e: Residual) -> list[tuple[float, Array]]:
    """(steering frequency [rad/s], power over noise at quarter orders (24,)) of windows of four cycles."""
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
        # noise of the one-sided density S has the power S/2 times the rate of the grid, POINTS per cycle
        noise = e.density / 2 * POINTS * w / (2 * np.pi) * np.sum(window**2)
        out.append((float(w), lines / noise))
    return out
