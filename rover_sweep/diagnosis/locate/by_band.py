"""Location by frequency, amplitude and speed: bands of a channel's residual, compared between runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.place_sentences import band_text, channel_name, noise_ratio
from rover_sweep.diagnosis.locate.residual_maps import EDGES, SIGMAS, above_noise, floor_error, spectrum
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import THROUGHOUT, Mismatch, Profile
from rover_sweep.diagnosis.simulation.candidates import SAME_SPEED
from rover_sweep.diagnosis.simulation.experiment import Experiment

HALF_POWER = 0.5  # share of the peak's power above the floor at which a band ends (-3 dB)
FEWEST = 8  # rows of a band
LINEAR = 4.0  # growth of the power when the motion doubles, for a residual in proportion to it
ODD = 1.6  # factor on `LINEAR` from which another growth is reported
HARDLY = 2.0  # growth up to which the residual "hardly grows"
SPEEDIER = 2.0  # ratio of the powers relative to the motion from which a speed is reported
SAME_AMPLITUDE = 1.6  # ratio up to which two runs have the same amplitude


@dataclass(frozen=True, eq=False)
class Band:
    """The band [rad/s] in which a channel's residual is above the noise; ratio: rms over noise there."""

    channel: str
    band: tuple[float, float]
    ratio: float
    profile: Profile


def worst_band(problem: Problem, rows: Array, channel: str) -> Band | None:
    """The band around a channel's highest peak, None where nothing is above the noise.

    rows (size,): whitened residual.
    """
    power, count = spectrum(problem, rows, channel, EDGES)
    error = floor_error(problem, EDGES)
    known = np.flatnonzero(count >= FEWEST)
    above = [k for k in known if above_noise(power[k], count[k], error[k])]
    if not above:
        return None
    peak = max(above, key=lambda k: power[k])
    lowest = 1.0 + HALF_POWER * (power[peak] - 1.0)
    low = high = peak
    while low - 1 in known and power[low - 1] > lowest:
        low -= 1
    while high + 1 in known and power[high + 1] > lowest:
        high += 1
    chosen = np.arange(low, high + 1)
    size = float(np.sqrt(np.sum((power * count)[chosen]) / np.sum(count[chosen])))
    middles = np.sqrt(EDGES[1:] * EDGES[:-1])[known]
    sizes = tuple(map(float, np.sqrt(power[known])))
    profile = Profile("frequency", "rad/s", tuple(map(float, middles)), sizes)
    band = float(f"{EDGES[low]:.2g}"), float(f"{EDGES[high + 1]:.2g}")
    return Band(channel, band, size, profile)


def by_frequency(p: Band) -> Mismatch:
    """The band as a mismatch."""
    sentence = f"{channel_name(p.channel)} differs {band_text(p.band)} by {noise_ratio(p.ratio)}"
    return Mismatch(p.channel, p.band, THROUGHOUT, p.ratio, sentence, p.profile)


def by_run(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Amplitude and speed, where a channel's residual is not in proportion to the motion."""
    pairs = list(combinations([r.run for r in problem.rows if r.channel == channel], 2))
    speeds = [run.mean_speed for run in problem.runs]
    sizes = [run.amplitude for run in problem.runs]
    same_speeds = [ab for ab in pairs if same_speed(*(problem.runs[k] for k in ab))]
    if same_speeds:
        a, b = max(same_speeds, key=lambda ab: abs(np.log(sizes[ab[1]] / sizes[ab[0]])))
        yield from _by_amplitude(problem, rows, channel, *((a, b) if sizes[a] < sizes[b] else (b, a)))
    other_speeds = [ab for ab in pairs if ab not in same_speeds]
    if other_speeds:
        a, b = min(other_speeds, key=lambda ab: abs(np.log(sizes[ab[1]] / sizes[ab[0]])))
        if abs(np.log(sizes[b] / sizes[a])) < np.log(SAME_AMPLITUDE):
            yield from _by_speed(problem, rows, channel, *((a, b) if speeds[a] < speeds[b] else (b, a)))


def same_speed(a: Experiment, b: Experiment) -> bool:
    """True for runs whose mean speeds are within 12 %."""
    low, high = sorted((a.mean_speed, b.mean_speed))
    return high < (1 + SAME_SPEED) * low


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two runs in k half octaves.

    residual (k, 2): power above the floor, in noise; motion (k, 2): power of the measured rows; ratio: rms
    over noise of each run; band [rad/s].
    """

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
    """Runs a and b in all half octaves in which the residuals of both are above the noise."""
    found = [spectrum(problem, rows, channel, EDGES, run) for run in (a, b)]
    error = floor_error(problem, EDGES)
    moved = [spectrum(problem, problem.measured, channel, EDGES, run)[0] for run in (a, b)]
    sure = [
        k
        for k in range(EDGES.size - 1)
        if all(count[k] >= FEWEST and above_noise(power[k], count[k], error[k]) for power, count in found)
    ]
    if len(sure) < 2:
        return None
    ratio = [float(np.sqrt(np.sum((p * n)[sure]) / np.sum(n[sure]))) for p, n in found]
    band = float(f"{EDGES[sure[0]]:.2g}"), float(f"{EDGES[sure[-1] + 1]:.2g}")
    residual = np.array([p[sure] - 1.0 for p, _ in found]).T
    return _Pair(residual, np.array([m[sure] for m in moved]).T, (ratio[0], ratio[1]), band)


def _by_amplitude(problem: Problem, rows: Array, channel: str, small: int, large: int) -> Iterator[Mismatch]:
    """The growth of the residual's power when the motion doubles, where it is not in proportion."""
    pair = _pair(problem, rows, channel, small, large)
    if pair is None:
        return
    pair = pair.where(pair.motion[:, 1] > 2 * pair.motion[:, 0])
    if pair.residual.shape[0] < 2:
        return
    doublings = 0.5 * np.log2(pair.motion[:, 1] / pair.motion[:, 0])
    grown, error = pair.spread_of(np.log(pair.residual[:, 1] / pair.residual[:, 0]) / doublings)
    off = grown - np.log(LINEAR)
    if abs(off) < max(np.log(ODD), SIGMAS * error):
        return
    runs = problem.runs[small], problem.runs[large]
    angles = tuple(float(np.degrees(run.amplitude)) for run in runs)
    grows = "grows more than in proportion to" if off > 0 else "grows less than in proportion to"
    if np.exp(grown) < HARDLY:
        grows = "hardly grows with"
    sentence = (
        f"{channel_name(channel)} differs by {noise_ratio(pair.ratio[1])} at {angles[1]:.1f} deg of "
        f"steering and by {pair.ratio[0]:.1f} at {angles[0]:.1f} deg: it {grows} the motion (its power is "
        f"{np.exp(grown):.2g} times as large when the motion doubles; 4 times would be in proportion)"
    )
    profile = Profile("amplitude", "deg", angles, pair.ratio)
    yield Mismatch(channel, pair.band, f"{grows} amplitude", max(pair.ratio), sentence, profile)


def _by_speed(problem: Problem, rows: Array, channel: str, slow: int, fast: int) -> Iterator[Mismatch]:
    """The speed at which the residual is a larger share of the motion, where the difference is clear."""
    pair = _pair(problem, rows, channel, slow, fast)
    if pair is None:
        return
    share = pair.residual / pair.motion
    grown, error = pair.spread_of(np.log(share[:, 1] / share[:, 0]))
    if abs(grown) < max(np.log(SPEEDIER), SIGMAS * error):
        return
    worse = int(grown > 0)
    speeds = problem.runs[slow].mean_speed, problem.runs[fast].mean_speed
    off = 100 * np.sqrt(pair.residual.sum(axis=0) / pair.motion.sum(axis=0))
    sentence = (
        f"{channel_name(channel)} differs more at {speeds[worse]:.2f} m/s: by "
        f"{noise_ratio(pair.ratio[worse])} there, {off[worse]:.0f} % of the motion, against "
        f"{off[1 - worse]:.0f} % at {speeds[1 - worse]:.2f} m/s"
    )
    profile = Profile("speed", "m/s", speeds, pair.ratio)
    yield Mismatch(channel, pair.band, f"{speeds[worse]:.2f} m/s", pair.ratio[worse], sentence, profile)
