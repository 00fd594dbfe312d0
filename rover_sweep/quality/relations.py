"""Kinematic relations between recorded channels, valid for any rover, as ratios.

psi' = r and phi' = p (small angles, level ground). At low frequencies a_y = V r: the effects of sideslip and
of the IMU's position on a_y grow with frequency; roll adds g phi.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, LowPass, Recording

STEP = 0.02  # s, of the common clock
LOWEST, HIGHEST = 0.5, 8.0  # rad/s, band of the comparison
PERIODS = 2.0  # of the lowest frequency, in the run
SHORTEST = 4.0  # s, of a run
SLOWEST = 4.0  # Hz, of a channel
Spectrum = NDArray[np.complex128]


@dataclass(frozen=True)
class Relation:
    """Ratio of one quantity to another, 1 when both are correct. coherence: of the two, 0..1."""

    ratio: float
    coherence: float


@dataclass(frozen=True)
class Relations:
    """heading: psi' over r; roll: phi' over p; force: a_y over V r; lean: p over a_y' [rad s^2/m].

    None when not recorded or not coherent; lean only without a roll angle.
    """

    heading: Relation | None
    roll: Relation | None
    force: Relation | None
    lean: Relation | None


CLEAR = 0.8  # coherence of an angle and its rate
CLEAR_FORCE = 0.6  # of a_y and V r, which sideslip makes differ
FORCE_RANGE = 0.55, 1.8  # accepted a_y over V r: correct recordings have .87 to 1.28
USUAL_FORCE = 1.055  # the middle of those
IN_PHASE = 0.6  # smallest real part of the cross-spectrum over its magnitude
CLEAR_LEAN = 0.35  # of p and a_y': a stiff rover on rough ground has .4


def relations(run: Recording) -> Relations:
    """The relations within the manoeuvre of a run."""
    return Relations(
        _rate_relation(run, "psi", "r"),
        _rate_relation(run, "phi", "p"),
        _force_relation(run),
        _lean_relation(run),
    )


def _rate_relation(run: Recording, angle: str, rate: str) -> Relation | None:
    if not _recorded(run, angle, rate):
        return None
    t = _clock(run)
    slope = np.gradient(run[angle].on(t), t)
    return _clear(_relation(t, slope, run[rate].on(t), run.filters.get(rate)), CLEAR)


def _force_relation(run: Recording) -> Relation | None:
    if not _recorded(run, "ay", "r", "speed"):
        return None
    t = _clock(run)
    return _clear(_relation(t, run["ay"].on(t), run["speed"].on(t) * run["r"].on(t)), CLEAR_FORCE)


def _lean_relation(run: Recording) -> Relation | None:
    if "phi" in run or not _recorded(run, "p", "ay"):
        return None
    t = _clock(run)
    return _clear(_relation(t, run["p"].on(t), np.gradient(run["ay"].on(t), t)), CLEAR_LEAN)


def _clear(found: Relation | None, least: float) -> Relation | None:
    return found if found is not None and found.coherence >= least else None


def _recorded(run: Recording, *channels: str) -> bool:
    return run.span[1] - run.span[0] >= SHORTEST and all(
        c in run and run.manoeuvre(c).t.size > 1 and run.manoeuvre(c).rate >= SLOWEST for c in channels
    )


def _clock(run: Recording) -> Array:
    return np.arange(run.span[0], run.span[1], STEP)


def _relation(t: Array, y: Array, x: Array, filter: LowPass | None = None) -> Relation | None:
    """y over x by least squares between LOWEST and HIGHEST; filter: low-pass in x but not in y."""
    w = 2 * np.pi * np.fft.rfftfreq(t.size, STEP)
    inside = (w >= max(LOWEST, PERIODS * 2 * np.pi / (t[-1] - t[0]))) & (w <= HIGHEST)
    top, bottom = _spectrum(y)[inside], _spectrum(x)[inside]
    if filter is not None:
        top = top * filter.response(w[inside])
    powers = float(np.sum(np.abs(top) ** 2)), float(np.sum(np.abs(bottom) ** 2))
    cross = complex(np.sum(bottom.conj() * top))
    if min(powers) <= 0 or abs(cross.real) < IN_PHASE * abs(cross):
        return None
    return Relation(cross.real / powers[1], abs(cross) ** 2 / (powers[0] * powers[1]))


def _spectrum(x: Array) -> Spectrum:
    return np.asarray(np.fft.rfft((x - x.mean()) * np.hanning(x.size)))
