"""Location by time: a part of one sweep whose residual differs from other sweeps at the same frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.by_band import same_speed
from rover_sweep.diagnosis.locate.by_harmonic import Cycles
from rover_sweep.diagnosis.locate.place_sentences import channel_name, noise_ratio
from rover_sweep.diagnosis.locate.residual_maps import LARGE, SIGMAS, Residual, residuals_of
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import Mismatch, Profile

FEWEST = 4  # cycles of a stretch
OTHERWISE = 4.0  # ratio of the power to that of other runs from which a stretch is reported


@dataclass(frozen=True, eq=False)
class _History:
    """The n cycles of a sweep: begins t (n + 1,) [s], frequency w (n,) [rad/s], power over noise (n,).

    count (n,): independent numbers in each cycle.
    """

    residual: Residual
    t: Array
    w: Array
    power: Array
    count: Array


def by_time(problem: Problem, rows: Array, channel: str) -> Mismatch | None:
    """The stretch of a run that differs most from other runs at its speed, None where none does."""
    sweeps = [e for e in residuals_of(problem, rows, channel) if e.run.kind == "sweep"]
    histories = [h for e in sweeps if (h := _history(e)).power.size > 2 * FEWEST]
    found = []
    for h in histories:
        others = [o for o in histories if o is not h and same_speed(o.residual.run, h.residual.run)]
        found += [m] if others and (m := _stretch(h, others)) is not None else []
    return max(found, key=lambda m: m.residual_over_noise, default=None)


def _history(e: Residual) -> _History:
    cycles = Cycles.of(e.run)
    k = np.searchsorted(e.run.t, cycles.t)
    energy, noise = (np.concatenate(([0.0], np.cumsum(x))) for x in (e.x**2, e.noise))
    power = np.diff(energy[k]) / np.maximum(np.diff(noise[k]), 1e-12)
    # a band of B rad/s over T s holds B T / pi independent numbers
    count = np.maximum((e.high - e.low) / np.pi * np.diff(cycles.t), 1.0)
    return _History(e, cycles.t, cycles.w, power, count)


def _expected(h: _History, others: list[_History]) -> Array:
    """Power (n,) of each cycle expected from the other runs, in proportion to the steering amplitude."""
    expected = []
    for o in others:
        grown = (h.residual.run.amplitude / o.residual.run.amplitude) ** 2
        above = np.maximum(o.power - 1.0, 0.0)
        order = np.argsort(o.w)
        expected.append(1.0 + grown * np.interp(np.log(h.w), np.log(o.w[order]), above[order]))
    return np.asarray(np.mean(expected, axis=0))


def _stretch(h: _History, others: list[_History]) -> Mismatch | None:
    """The stretch of cycles whose power is farthest above its expected value, where that is clear."""
    ratio = np.log(np.maximum(h.power, 0.1) / _expected(h, others))
    a, b = _steepest(ratio)
    inside = np.zeros(ratio.size, bool)
    inside[a:b] = True
    apart = float(np.mean(ratio[inside]) - np.mean(ratio[~inside]))
    spread = float(np.hypot(np.std(ratio[inside]), np.std(ratio[~inside])))
    error = spread * np.sqrt(2.0 / inside.sum() + 2.0 / (~inside).sum())  # neighbours are correlated
    here, there = (
        float(np.sqrt(np.sum((h.power * h.count)[m]) / np.sum(h.count[m]))) for m in (inside, ~inside)
    )
    if apart < np.log(OTHERWISE) or apart < SIGMAS * error or here < LARGE * max(1.0, there):
        return None
    return _mismatch(h, a, b, here, there)


def _steepest(x: Array) -> tuple[int, int]:
    """(first, last + 1) of the stretch whose mean is most significantly above the mean of the rest."""
    total = np.concatenate(([0.0], np.cumsum(x - x.mean())))
    n = x.size

    def score(ends: tuple[int, int]) -> float:
        inside = ends[1] - ends[0]
        return float((total[ends[1]] - total[ends[0]]) / np.sqrt(inside * (n - inside)))

    spans = ((i, j) for i in range(n) for j in range(i + FEWEST, min(n, n + i - FEWEST) + 1))
    return max(spans, key=score)


def _mismatch(h: _History, a: int, b: int, here: float, there: float) -> Mismatch:
    e = h.residual
    first, last = float(h.t[a]), float(h.t[b])
    if b == h.power.size:
        when = f"from {first:.0f} s on"
    elif a == 0:
        when = f"until {last:.0f} s"
    else:
        when = f"between {first:.0f} and {last:.0f} s"
    sentence = (
        f"{channel_name(e.channel)} differs {when} in {e.run.name} by {noise_ratio(here)} ({there:.1f} in "
        "the rest of the run); other runs at this speed do not show it at the same frequency"
    )
    middle = tuple(map(float, 0.5 * (h.t[1:] + h.t[:-1])))
    profile = Profile("time", "s", middle, tuple(map(float, np.sqrt(h.power))))
    band = float(f"{h.w[a:b].min():.2g}"), float(f"{h.w[a:b].max():.2g}")
    return Mismatch(e.channel, band, f"{e.run.name} {when}", here, sentence, profile)
