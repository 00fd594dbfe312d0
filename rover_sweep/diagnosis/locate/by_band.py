"""Where by frequency, amplitude and speed: bands of a channel's residual, compared between runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.place_sentences import between, called, times
from rover_sweep.diagnosis.locate.residual_maps import EDGES, SURE, clear, floor_error, spectrum
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import THROUGHOUT, Mismatch, Profile
from rover_sweep.diagnosis.simulation.candidates import SAME_SPEED
from rover_sweep.diagnosis.simulation.experiment import Experiment

WITHIN = 0.5  # of the power above the floor at the peak, down to which a band reaches: -3 dB
FEWEST = 8  # rows of a band
LINEAR = 4.0  # growth of the power when the motion doubles, of an effect in proportion to it
ODD = 1.6  # factor from there, beyond which the growth is worth telling
HARDLY = 2.0  # growth up to which it is called that
SPEEDIER = 2.0  # factor in power relative to the motion, beyond which a speed is worth telling
SAME_AMPLITUDE = 1.6


@dataclass(frozen=True, eq=False)
class Place:
    """The band [rad/s] in which a channel's residual stands out, and its size in noise."""

    channel: str
    band: tuple[float, float]
    ratio: float
    profile: Profile


def place(problem: Problem, rows: Array, channel: str) -> Place | None:
    """The worst band of a channel, None where nothing is above the noise."""
    power, count = spectrum(problem, rows, channel, EDGES)
    error = floor_error(problem, EDGES)
    known = np.flatnonzero(count >= FEWEST)
    told = [k for k in known if clear(power[k], count[k], error[k])]
    if not told:
        return None
    peak = max(told, key=lambda k: power[k])
    least = 1.0 + WITHIN * (power[peak] - 1.0)
    low = high = peak
    while low - 1 in known and power[low - 1] > least:
        low -= 1
    while high + 1 in known and power[high + 1] > least:
        high += 1
    chosen = np.arange(low, high + 1)
    size = float(np.sqrt(np.sum((power * count)[chosen]) / np.sum(count[chosen])))
    middles = np.sqrt(EDGES[1:] * EDGES[:-1])[known]
    sizes = tuple(map(float, np.sqrt(power[known])))
    profile = Profile("frequency", "rad/s", tuple(map(float, middles)), sizes)
    band = float(f"{EDGES[low]:.2g}"), float(f"{EDGES[high + 1]:.2g}")
    return Place(channel, band, size, profile)


def by_frequency(p: Place) -> Mismatch:
    """The band as a mismatch."""
    sentence = f"{called(p.channel)} differs {between(p.band)} by {times(p.ratio)}"
    return Mismatch(p.channel, p.band, THROUGHOUT, p.ratio, sentence, p.profile)


def by_run(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Amplitude and speed, where a channel's residual does not simply follow the motion."""
    pairs = list(combinations([r.run for r in problem.rows if r.channel == channel], 2))
    speeds = [run.mean_speed for run in problem.runs]
    sizes = [run.amplitude for run in problem.runs]
    alike = [ab for ab in pairs if same_speed(*(problem.runs[k] for k in ab))]
    if alike:
        a, b = max(alike, key=lambda ab: abs(np.log(sizes[ab[1]] / sizes[ab[0]])))
        yield from _by_amplitude(problem, rows, channel, *((a, b) if sizes[a] < sizes[b] else (b, a)))
    apart = [ab for ab in pairs if ab not in alike]
    if apart:
        a, b = min(apart, key=lambda ab: abs(np.log(sizes[ab[1]] / sizes[ab[0]])))
        if abs(np.log(sizes[b] / sizes[a])) < np.log(SAME_AMPLITUDE):
            yield from _by_speed(problem, rows, channel, *((a, b) if speeds[a] < speeds[b] else (b, a)))


def same_speed(a: Experiment, b: Experiment) -> bool:
    """True for runs whose mean speeds are within 12 %."""
    low, high = sorted((a.mean_speed, b.mean_speed))
    return high < (1 + SAME_SPEED) * low


@dataclass(frozen=True, eq=False)
class _Pair:
    """Power above the floor of the residual (k, 2), and of the motion, in the half octaves of two runs."""

    residual: Array
    motion: Array
    ratio: tuple[float, float]
    band: tuple[float, float]

    def where(self, chosen: NDArray[np.bool_]) -> _Pair:
        """Only some of the half octaves."""
        return replace(self, residual=self.residual[chosen], motion=self.motion[chosen])

    def spread_of(self, x: Array) -> tuple[float, float]:
        """(mean, its standard error) of a quantity (k,) of each half octave, weighted by the residual."""
        weight = self.residual.sum(axis=1)
        weight = weight / weight.sum()
        mean = float(weight @ x)
        free = 1.0 - float(weight @ weight)
        return mean, float(np.sqrt(weight @ (x - mean) ** 2 * (weight @ weight) / max(free, 1e-9)))


def _pair(problem: Problem, rows: Array, channel: str, a: int, b: int) -> _Pair | None:
    """The two runs over all half octaves in which the residuals of both are above the noise."""
    found = [spectrum(problem, rows, channel, EDGES, run) for run in (a, b)]
    error = floor_error(problem, EDGES)
    moved = [spectrum(problem, problem.measured, channel, EDGES, run)[0] for run in (a, b)]
    sure = [
        k
        for k in range(EDGES.size - 1)
        if all(count[k] >= FEWEST and clear(power[k], count[k], error[k]) for power, count in found)
    ]
    if len(sure) < 2:
        return None
    ratio = [float(np.sqrt(np.sum((p * n)[sure]) / np.sum(n[sure]))) for p, n in found]
    band = float(f"{EDGES[sure[0]]:.2g}"), float(f"{EDGES[sure[-1] + 1]:.2g}")
    residual = np.array([p[sure] - 1.0 for p, _ in found]).T
    return _Pair(residual, np.array([m[sure] for m in moved]).T, (ratio[0], ratio[1]), band)


def _by_amplitude(problem: Problem, rows: Array, channel: str, small: int, large: int) -> Iterator[Mismatch]:
    """The growth of the residual when the motion doubles, where it is not in proportion."""
    pair = _pair(problem, rows, channel, small, large)
    if pair is None:
        return
    pair = pair.where(pair.motion[:, 1] > 2 * pair.motion[:, 0])
    if pair.residual.shape[0] < 2:
        return
    doublings = 0.5 * np.log2(pair.motion[:, 1] / pair.motion[:, 0])
    grown, error = pair.spread_of(np.log(pair.residual[:, 1] / pair.residual[:, 0]) / doublings)
    off = grown - np.log(LINEAR)
    if abs(off) < max(np.log(ODD), SURE * error):
        return
    runs = problem.runs[small], problem.runs[large]
    angles = tuple(float(np.degrees(run.amplitude)) for run in runs)
    grows = "grows more than in proportion to" if off > 0 else "grows less than in proportion to"
    if np.exp(grown) < HARDLY:
        grows = "hardly grows with"
    sentence = (
        f"{called(channel)} differs by {times(pair.ratio[1])} at {angles[1]:.1f} deg of "
        f"steering and {pair.ratio[0]:.1f} at {angles[0]:.1f} deg: it {grows} the motion (power "
        f"{np.exp(grown):.2g} times when that doubles; 4 times would be in proportion)"
    )
    profile = Profile("amplitude", "deg", angles, pair.ratio)
    yield Mismatch(channel, pair.band, f"{grows} amplitude", max(pair.ratio), sentence, profile)


def _by_speed(problem: Problem, rows: Array, channel: str, slow: int, fast: int) -> Iterator[Mismatch]:
    """The speed at which more of the motion is left, where it clearly is."""
    pair = _pair(problem, rows, channel, slow, fast)
    if pair is None:
        return
    share = pair.residual / pair.motion
    grown, error = pair.spread_of(np.log(share[:, 1] / share[:, 0]))
    if abs(grown) < max(np.log(SPEEDIER), SURE * error):
        return
    worse = int(grown > 0)
    speeds = problem.runs[slow].mean_speed, problem.runs[fast].mean_speed
    off = 100 * np.sqrt(pair.residual.sum(axis=0) / pair.motion.sum(axis=0))
    sentence = (
        f"{called(channel)} differs more at {speeds[worse]:.2f} m/s: by "
        f"{times(pair.ratio[worse])} there, {off[worse]:.0f} % of the motion, against "
        f"{off[1 - worse]:.0f} % at {speeds[1 - worse]:.2f} m/s"
    )
    profile = Profile("speed", "m/s", speeds, pair.ratio)
    yield Mismatch(channel, pair.band, f"{speeds[worse]:.2f} m/s", pair.ratio[worse], sentence, profile)
