"""Sizes that show plainly: what a law changes, beyond what nominal parameters can take up, over the noise.

Undisturbed runs with and without the law are compared up to 6 Hz in r, a_y and p (V_y for the laws of the
velocity). The part that tyre stiffness, inertia, springs, steering gain, delay and constants could imitate is
projected out; what remains of the most affected channel, in rms over the rms of the noise, is the visibility.
At .4 three sweeps hold a chi-squared of several hundred.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import exp, isfinite, log

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from tests.foreign.drive import Drive
from tests.foreign.law import Extras, Law
from tests.foreign.motion import DT
from tests.foreign.recorded import driven
from tests.foreign.rover import Rover

Array = NDArray[np.float64]
CHANNELS = ("r", "ay", "p", "vy")
EVERY = 20  # steps between two samples
BAND_HZ = 6.0
LEAST, LOW, HIGH = 0.35, 0.4, 2.5  # visibility: at least, and the range from which it is drawn
WILD = 1.8  # of the nominal peak of a_y: no such rover is driven


@dataclass(frozen=True)
class Scale:
    """Nominal runs (channels, samples) over the noise, rms noise (channels,), and what parameters change."""

    plan: tuple[Drive, ...]
    nominal: Array
    noise: Array
    imitations: tuple[Array, ...]

    def visibility(self, changed: Array, law: Law) -> float:
        """Of the runs of a rover with the law; inf if it is out of control."""
        limit = WILD * np.max(np.abs(self.nominal), axis=1)
        if not np.all(np.isfinite(changed)) or np.any(np.max(np.abs(changed), axis=1)[:3] > limit[:3] + 6.0):
            return float("inf")
        rows = slice(3, 4) if law.place == "ekf" else slice(0, 3)
        difference = (changed - self.nominal)[rows]
        if not law.absolute:
            difference = _unimitated(difference, [one[rows] for one in self.imitations])
        return float(np.max(np.sqrt(np.mean(difference**2, axis=1))))


def scale_of(rover: Rover, plan: Sequence[Drive], rng: Generator) -> Scale:
    """Runs of the plan's sweeps by the rover as it is."""
    sweeps = tuple(drive for drive in plan if drive.kind == "sweep")
    ones = np.ones(len(CHANNELS))
    nominal = runs(rover, sweeps, ones)
    noisy = runs(rover, sweeps[:1], ones, rng)
    gap = noisy - nominal[:, : noisy.shape[1]]
    noise = np.std(gap, axis=1)
    nominal = nominal / noise[:, None]
    n = rover.numbers
    others = (
        rover.of(Cf=1.05 * n.Cf, Cr=1.05 * n.Cr),
        rover.of(Izz=1.05 * n.Izz),
        rover.of(kphi=1.05 * n.kphi),
        rover.of(bphi=1.1 * n.bphi),
        replace(rover, rad_per_us=1.02 * rover.rad_per_us),
        replace(rover, delay=rover.delay + 0.004),
    )
    return Scale(sweeps, nominal, noise, tuple(runs(one, sweeps, noise) - nominal for one in others))


def runs(rover: Rover, plan: Sequence[Drive], noise: Array, rng: Generator | None = None) -> Array:
    """(channels, samples) of the manoeuvres, one after the other, over the noise, up to BAND_HZ.

    rng: of the road and the sensors; None for undisturbed runs.
    """
    low_pass = butter(4, BAND_HZ * 2 * DT * EVERY, output="sos")
    parts = []
    for drive in plan:
        found = driven(rover, drive, rng or np.random.default_rng(0), noise=rng is not None)[2]
        inside = slice(round(drive.begin / DT), round(drive.end / DT), EVERY)
        if not all(np.all(np.isfinite(found[name])) for name in CHANNELS):
            return np.full((len(CHANNELS), 1), np.nan)
        parts.append(sosfiltfilt(low_pass, np.array([found[name][inside] for name in CHANNELS]), axis=1))
    return np.concatenate(parts, axis=1) / noise[:, None]


def _unimitated(difference: Array, imitations: Sequence[Array]) -> Array:
    """The difference (channels, samples) without its best fit by parameters and a constant a channel."""
    rows, samples = difference.shape
    constants = [np.kron(np.eye(rows)[k], np.ones(samples)) for k in range(rows)]
    basis = np.column_stack([*(one.ravel() for one in imitations), *constants])
    basis = basis / np.maximum(np.linalg.norm(basis, axis=0), 1e-12)
    weights = np.linalg.lstsq(basis, difference.ravel(), rcond=None)[0]
    return np.asarray(difference.ravel() - basis @ weights).reshape(rows, samples)


def sized(rover: Rover, law: Law, extras: Extras, scale: Scale, rng: Generator) -> tuple[float, float] | None:
    """(size, visibility) that shows plainly; None if even the largest size does not."""

    def seen(size: float) -> float:
        return scale.visibility(runs(law.apply(rover, size, extras), scale.plan, scale.noise), law)

    return chosen(seen, law, rng, searches=6, near=0.15)


def chosen(
    seen: Callable[[float], float], law: Law, rng: Generator, searches: int, near: float
) -> tuple[float, float] | None:
    """(size, visibility) of a drawn visibility, None if even the largest size does not show.

    seen: the visibility of a size. By false position on logarithms, from the largest size down, at most
    `searches` times and until it is within `near` (logarithm).
    """
    if law.absolute:
        size = exp(rng.uniform(log(law.low), log(law.high)))
        visibility = seen(size)
        return (size, visibility) if isfinite(visibility) and visibility >= LEAST else None
    wanted = exp(rng.uniform(log(LOW), log(HIGH)))
    high = (law.high, seen(law.high))
    if high[1] < LEAST:
        return None
    if high[1] <= wanted:
        return high
    low = (law.low, seen(law.low))
    if low[1] >= wanted or not isfinite(low[1]):
        return low if isfinite(low[1]) else None
    for _ in range(searches):
        known = isfinite(high[1]) and low[1] > 0
        share = log(wanted / low[1]) / log(high[1] / low[1]) if known else 0.5
        middle = exp(log(low[0]) + min(0.85, max(0.15, share)) * log(high[0] / low[0]))
        found = (middle, seen(middle))
        if abs(log(max(found[1], 1e-9) / wanted)) < near:
            return found
        low, high = (found, high) if found[1] < wanted else (low, found)
    return low if low[1] >= LEAST else high if isfinite(high[1]) else None
