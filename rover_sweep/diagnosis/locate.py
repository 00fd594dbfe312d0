"""Where a model and the recordings differ, in multiples of the noise floor.

A place is reported where the residual is both large and significantly above the noise. A condition is
reported where it also exceeds a reference: other runs, the other turn, the orders next to a harmonic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.residual_maps import (
    EDGES,
    LARGE,
    SIGMAS,
    above_noise,
    by_heading,
    by_order,
    by_time,
    by_turn,
    channel_name,
    floor_error,
    noise_ratio,
    rms_over_noise,
    rounded_band,
    spectrum,
    steady,
)
from rover_sweep.diagnosis.result import THROUGHOUT, Mismatch, Profile
from rover_sweep.diagnosis.simulation.candidates import same_speed


def mismatches(problem: Problem, rows: Array) -> tuple[Mismatch, ...]:
    """At most eight places, the largest first: each channel's worst band, the clearest of each condition.

    problem: without tolerances; rows (size,): whitened residual, measured minus model.
    """
    channels = list(dict.fromkeys(r.channel for r in problem.rows))
    found = [m for c in channels if (m := worst_band(problem, rows, c)) is not None]
    compared = [m for place in found for m in by_run(problem, rows, place.channel)]
    conditions = [
        [m for m in compared if m.profile and m.profile.over == over] for over in ("amplitude", "speed")
    ]
    finders: tuple[Callable[[Problem, Array, str], Iterable[Mismatch]], ...] = (
        *(steady, by_turn, by_heading, by_time, by_order),
    )
    conditions += [[m for c in channels for m in finder(problem, rows, c)] for finder in finders]
    # other channels usually show the same condition
    found += [max(places, key=lambda m: m.residual_over_noise) for places in conditions if places]
    return tuple(sorted(found, key=lambda m: -m.residual_over_noise)[:8])


def worst_band(problem: Problem, rows: Array, channel: str) -> Mismatch | None:
    """The band around a channel's highest peak, to half of its power; None: nothing is above the noise."""
    power, count = spectrum(problem, rows, channel)
    error = floor_error(problem)
    known = np.flatnonzero(count)
    above = [k for k in known if above_noise(power[k], count[k], error[k])]
    if not above:
        return None
    peak = max(above, key=lambda k: power[k])
    lowest = 1.0 + 0.5 * (power[peak] - 1.0)
    low = high = peak
    while low - 1 in known and power[low - 1] > lowest:
        low -= 1
    while high + 1 in known and power[high + 1] > lowest:
        high += 1
    band, ratio = (
        rounded_band(EDGES[low], EDGES[high + 1]),
        rms_over_noise(power, count, slice(low, high + 1)),
    )
    middles = np.sqrt(EDGES[1:] * EDGES[:-1])[known]
    profile = Profile(
        "frequency", "rad/s", tuple(map(float, middles)), tuple(map(float, np.sqrt(power[known])))
    )
    where = f"between {band[0]:.3g} and {band[1]:.3g} rad/s"
    sentence = f"{channel_name(channel)} differs {where} by {noise_ratio(ratio)}"
    return Mismatch(channel, band, THROUGHOUT, ratio, sentence, profile)


def by_run(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Amplitudes and speeds where the residual is a different share of the motion."""
    runs = problem.runs
    pairs = list(combinations([r.run for r in problem.rows if r.channel == channel], 2))
    apart = {(a, b): abs(np.log(runs[b].amplitude / runs[a].amplitude)) for a, b in pairs}
    equal = [(a, b) for a, b in pairs if same_speed(runs[a], runs[b])]
    if equal:
        a, b = sorted(max((apart[ab], ab) for ab in equal)[1], key=lambda k: runs[k].amplitude)
        yield from _by_amplitude(problem, rows, channel, a, b)
    other = [ab for ab in pairs if ab not in equal]
    if other and min(apart[ab] for ab in other) < np.log(LARGE):
        a, b = sorted(min((apart[ab], ab) for ab in other)[1], key=lambda k: runs[k].mean_speed)
        yield from _by_speed(problem, rows, channel, a, b)


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two runs in the k half octaves where both residuals are above the noise.

    residual (k, 2): power above the floor, in noise; motion (k, 2): power of the measured rows; ratio: rms
    over noise of each run; band [rad/s].
    """

    residual: Array
    motion: Array
    ratio: tuple[float, float]
    band: tuple[float, float]

    @staticmethod
    def of(problem: Problem, rows: Array, channel: str, a: int, b: int) -> _Pair | None:
        """Runs a and b; None for less than two half octaves."""
        found = [spectrum(problem, rows, channel, run) for run in (a, b)]
        moved = [spectrum(problem, problem.measured, channel, run)[0] for run in (a, b)]
        error = floor_error(problem)
        sure = [
            k
            for k in range(error.size)
            if all(above_noise(power[k], count[k], error[k]) for power, count in found)
        ]
        if len(sure) < 2:
            return None
        one, two = (rms_over_noise(power, count, sure) for power, count in found)
        residual = np.array([power[sure] - 1.0 for power, _ in found]).T
        band = rounded_band(EDGES[sure[0]], EDGES[sure[-1] + 1])
        return _Pair(residual, np.array([m[sure] for m in moved]).T, (one, two), band)

    def mean(self, x: Array, chosen: NDArray[np.bool_]) -> tuple[float, float]:
        """(mean, its standard error) of a quantity (k,) of the chosen half octaves, by the residual."""
        weight = self.residual.sum(axis=1) * chosen
        weight = weight / weight.sum()
        mean = float(weight @ x)
        free = 1.0 - float(weight @ weight)
        return mean, float(np.sqrt(weight @ (x - mean) ** 2 * (weight @ weight) / max(free, 1e-9)))


def _by_amplitude(problem: Problem, rows: Array, channel: str, small: int, large: int) -> Iterator[Mismatch]:
    """Power ratio of the residual when the motion doubles, if it is not proportional."""
    pair = _Pair.of(problem, rows, channel, small, large)
    if pair is None:
        return
    doublings = 0.5 * np.log2(pair.motion[:, 1] / pair.motion[:, 0])
    grew = doublings > 0.5
    if np.count_nonzero(grew) < 2:
        return
    growth = np.log(pair.residual[:, 1] / pair.residual[:, 0]) / np.where(grew, doublings, np.inf)
    grown, error = pair.mean(growth, grew)
    off = grown - np.log(4.0)  # the power of a residual in proportion to the motion
    if abs(off) < max(np.log(LARGE), SIGMAS * error):
        return
    angles = tuple(float(np.degrees(problem.runs[k].amplitude)) for k in (small, large))
    grows = "grows more than in proportion to" if off > 0 else "grows less than in proportion to"
    if grown < np.log(LARGE**2):
        grows = "hardly grows with"
    sentence = (
        f"{channel_name(channel)} differs by {noise_ratio(pair.ratio[1])} at {angles[1]:.1f} deg of "
        f"steering and by {pair.ratio[0]:.1f} at {angles[0]:.1f} deg: it {grows} the motion (its power is "
        f"{np.exp(grown):.2g} times as large when the motion doubles; 4 times would be in proportion)"
    )
    profile = Profile("amplitude", "deg", angles, pair.ratio)
    yield Mismatch(channel, pair.band, f"{grows} amplitude", max(pair.ratio), sentence, profile)


def _by_speed(problem: Problem, rows: Array, channel: str, slow: int, fast: int) -> Iterator[Mismatch]:
    """The speed at which the residual is a larger share of the motion, if that is clear."""
    pair = _Pair.of(problem, rows, channel, slow, fast)
    if pair is None:
        return
    share = pair.residual / pair.motion
    grown, error = pair.mean(np.log(share[:, 1] / share[:, 0]), np.ones(share.shape[0], bool))
    if abs(grown) < max(np.log(LARGE**2), SIGMAS * error):
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
