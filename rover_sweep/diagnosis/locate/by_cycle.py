"""Location by the cycles of a sweep's steering: harmonics, and the part of a run that differs from others.

Order analysis: the residual is resampled over the phase of the steering instead of time. What is caused at
the k-th harmonic of the steering frequency is then at order k, at any sweep rate. Windows of four cycles
resolve quarters of an order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.residual_maps import (
    LARGE,
    SIGMAS,
    Residual,
    channel_name,
    noise_ratio,
    ordinal,
    residuals_of,
    rms_over_noise,
    rounded_band,
)
from rover_sweep.diagnosis.problem.noise_floor import HARMONICS
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.diagnosis.simulation.candidates import same_speed
from rover_sweep.diagnosis.simulation.experiment import Experiment

CYCLES = 4  # of a window, and the fewest of a part of a run


def begins_of_cycles(run: Experiment) -> Array:
    """Times (n + 1,) [s] at which the n whole cycles of a sweep's steering begin, and the last one ends.

    They are between upward zero crossings, without the parts where the amplitude is below half.
    """
    x = run.steer - np.median(run.steer)
    k = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
    t = run.t[k] - x[k] * (run.t[k + 1] - run.t[k]) / (x[k + 1] - x[k])
    swing = [np.max(np.abs(x[a : b + 1])) for a, b in zip(k[:-1], k[1:], strict=True)]
    whole = np.flatnonzero(np.array(swing) > 0.5 * run.amplitude)
    return np.asarray(t[whole[0] : whole[-1] + 2] if whole.size else t[:0])


def by_order(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Harmonics from the second on that are above their background, half an order away, in the sweeps."""
    size = CYCLES * (HARMONICS + 1)
    power, count, low, high = np.zeros(size), np.zeros(size), np.full(size, np.inf), np.zeros(size)
    for e in residuals_of(problem, rows, channel):
        for w, power_of_window in _windows(e, size) if e.run.kind in ("sweep", "bias_sweep") else ():
            at = np.arange(size) * w / CYCLES
            inside = (at >= e.low) & (at <= e.high)
            power[inside] += power_of_window[inside]
            count[inside] += 1.0  # Hann windows that overlap by half are nearly independent
            low[inside], high[inside] = np.minimum(low, at)[inside], np.maximum(high, at)[inside]
    power /= np.maximum(count, 1.0)
    orders = [k for k in range(1, HARMONICS + 1) if count[CYCLES * k] > 0]
    sizes = tuple(float(np.sqrt(power[CYCLES * k])) for k in orders)
    profile = Profile("harmonic", "", tuple(map(float, orders)), sizes)
    for k in orders[1:]:
        peak, words = CYCLES * k, f"{ordinal(k)} harmonic"
        near = [j for j in (peak - CYCLES // 2, peak + CYCLES // 2) if j < size and count[j] > 0]
        background = max(1.0, *(float(power[j]) for j in near))
        sure = (power[peak] / background - 1) * np.sqrt(count[peak]) > SIGMAS
        if sure and power[peak] > max(LARGE**2 * background, 0.01 * power[CYCLES]):
            ratio = float(np.sqrt(power[peak]))
            sentence = (
                f"{channel_name(channel)} differs by {noise_ratio(ratio)} at the {words} of the steering "
                f"frequency and by {np.sqrt(background):.1f} next to it"
            )
            yield Mismatch(channel, rounded_band(low[peak], high[peak]), words, ratio, sentence, profile)


def _windows(e: Residual, size: int) -> Iterator[tuple[float, Array]]:
    """(steering frequency [rad/s], power over noise at quarter orders (size,)) of windows of four cycles."""
    begins, points = begins_of_cycles(e.run), 64  # of a cycle
    n = CYCLES * points
    window = np.hanning(n + 1)[:n]
    for k in range(0, begins.size - CYCLES, CYCLES // 2):
        t = np.interp(np.arange(n) / points, np.arange(CYCLES + 1), begins[k : k + CYCLES + 1])
        w = 2 * np.pi * CYCLES / (t[-1] - t[0]) * (n - 1) / n
        lines = np.abs(np.fft.rfft(np.interp(t, e.run.t, e.x) * window)[:size]) ** 2
        # noise of the one-sided density S has the power S/2 times the rate of the grid
        yield float(w), lines / (e.density / 2 * points * w / (2 * np.pi) * np.sum(window**2))


@dataclass(frozen=True, eq=False)
class _History:
    """The n cycles of a sweep: begins t (n + 1,) [s], frequency w (n,) [rad/s], power over noise (n,).

    count (n,): independent numbers in each cycle; a band of B rad/s over T s holds B T / pi of them.
    """

    residual: Residual
    t: Array
    w: Array
    power: Array
    count: Array

    @staticmethod
    def of(e: Residual) -> _History:
        t = begins_of_cycles(e.run)
        k = np.searchsorted(e.run.t, t)
        energy, noise = (np.concatenate(([0.0], np.cumsum(x))) for x in (e.x**2, e.noise))
        power = np.diff(energy[k]) / np.maximum(np.diff(noise[k]), 1e-12)
        count = np.maximum((e.high - e.low) / np.pi * np.diff(t), 1.0)
        return _History(e, t, 2 * np.pi / np.diff(t), power, count)

    def expected(self, others: list[_History]) -> Array:
        """Power (n,) of each cycle by other runs, in proportion to the steering amplitude."""
        found = []
        for o in others:
            grown = (self.residual.run.amplitude / o.residual.run.amplitude) ** 2
            order = np.argsort(o.w)
            above = np.maximum(o.power - 1.0, 0.0)[order]
            found.append(1.0 + grown * np.interp(np.log(self.w), np.log(o.w[order]), above))
        return np.asarray(np.mean(found, axis=0))


def by_time(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Parts of a run that differ from other runs at its speed and at the same frequencies."""
    sweeps = [_History.of(e) for e in residuals_of(problem, rows, channel) if e.run.kind == "sweep"]
    histories = [h for h in sweeps if h.power.size > 2 * CYCLES]
    for h in histories:
        others = [o for o in histories if o is not h and same_speed(o.residual.run, h.residual.run)]
        if others:
            yield from _part(h, np.log(np.maximum(h.power, 0.1) / h.expected(others)))


def _part(h: _History, excess: Array) -> Iterator[Mismatch]:
    """The part whose mean excess (n,), ln of the power over the expected one, is most above the rest's."""
    n, e = excess.size, h.residual
    total = np.concatenate(([0.0], np.cumsum(excess - excess.mean())))
    spans = ((i, j) for i in range(n) for j in range(i + CYCLES, min(n, n + i - CYCLES) + 1))
    a, b = max(spans, key=lambda s: (total[s[1]] - total[s[0]]) / np.sqrt((s[1] - s[0]) * (n - s[1] + s[0])))
    inside = (np.arange(n) >= a) & (np.arange(n) < b)
    apart = float(np.mean(excess[inside]) - np.mean(excess[~inside]))
    spread = float(np.hypot(np.std(excess[inside]), np.std(excess[~inside])))
    error = spread * np.sqrt(2.0 / inside.sum() + 2.0 / (~inside).sum())  # neighbours are correlated
    here, there = (rms_over_noise(h.power, h.count, m) for m in (inside, ~inside))
    if apart < max(np.log(4.0), SIGMAS * error) or here < LARGE * max(1.0, there):  # at least twice the rms
        return
    first, last = float(h.t[a]), float(h.t[b])
    when = f"until {last:.0f} s" if a == 0 else f"between {first:.0f} and {last:.0f} s"
    when = f"from {first:.0f} s on" if b == n else when
    sentence = (
        f"{channel_name(e.channel)} differs {when} in {e.run.name} by {noise_ratio(here)} ({there:.1f} in "
        "the rest of the run); other runs at this speed do not show it at the same frequency"
    )
    middle = tuple(map(float, 0.5 * (h.t[1:] + h.t[:-1])))
    profile = Profile("time", "s", middle, tuple(map(float, np.sqrt(h.power))))
    band = rounded_band(h.w[a:b].min(), h.w[a:b].max())
    yield Mismatch(e.channel, band, f"{e.run.name} {when}", here, sentence, profile)
