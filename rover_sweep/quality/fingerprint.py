"""The responses of a rover in a few bands, to check whether two runs are of the same rover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Recording

STEP = 0.02  # s, of the common clock
EDGES = np.geomspace(1.5, 15.0, 9)  # rad/s
CLEAR = 0.8  # smallest coherence of a usable band
FEWEST = 4  # usable bands needed for a comparison
LOW = 3  # lowest bands, in which the yaw rate depends on the wheelbase and hardly on the tyres
WINDOW = 1.5  # equivalent bins of a Hann window, by which fewer averages are independent
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Bands:
    """A response h (n_bands,) and its relative random error (n_bands,), NaN where the coherence is low."""

    h: Complex
    error: Array


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """yaw: r per steering and speed, which is the curvature of the path per steering; lean: p per a_y,
    independent of tyres, surface, speed and steering.

    speed [m/s]; amplitude of the steering, in its unit.
    """

    yaw: Bands
    lean: Bands
    speed: float
    amplitude: float


@dataclass(frozen=True)
class AnswerDifference:
    """Median relative difference of two responses, and its random error."""

    difference: float
    error: float


def fingerprint(run: Recording, input: str) -> Fingerprint:
    """The fingerprint of a run with the steering channel `input`; known low-passes are corrected."""
    t = np.arange(run.span[0], run.span[1], STEP)
    w: Array = np.asarray(2 * np.pi * np.fft.rfftfreq(t.size, STEP), np.float64)
    spectra = {c: _spectrum(run, c, t, w) for c in (input, "r", "ay", "p") if c in run}
    unknown = np.full(EDGES.size - 1, np.nan)
    lean = Bands(unknown + 0j, unknown)
    if {"p", "ay"} <= set(spectra):
        lean = _answer(w, spectra["p"], spectra["ay"])
    amplitude = float(np.ptp(run.manoeuvre(input).x)) / 2
    spectra["r"] /= run.mean_speed
    return Fingerprint(_answer(w, spectra["r"], spectra[input]), lean, run.mean_speed, amplitude)


def _spectrum(run: Recording, channel: str, t: Array, w: Array) -> Complex:
    x = run[channel].on(t)
    found = np.fft.rfft((x - x.mean()) * np.hanning(t.size))
    known = run.filters.get(channel)
    return np.asarray(found / known.response(w) if known else found)


def _answer(w: Array, output: Complex, input: Complex) -> Bands:
    h, error = np.full(EDGES.size - 1, np.nan + 0j), np.full(EDGES.size - 1, np.nan)
    for k in range(h.size):
        inside = (w >= EDGES[k]) & (w < EDGES[k + 1])
        x, y = input[inside], output[inside]
        power = float(np.sum(np.abs(x) ** 2))
        cross = complex(np.sum(x.conj() * y))
        coherence = abs(cross) ** 2 / max(power * float(np.sum(np.abs(y) ** 2)), 1e-300)
        if inside.sum() > 2 and coherence > CLEAR:
            h[k] = cross / power
            error[k] = np.sqrt((1 - min(coherence, 1.0)) * WINDOW / (2 * coherence * inside.sum()))
    return Bands(h, error)


def difference_of(one: Bands, two: Bands) -> AnswerDifference | None:
    """Median difference of two responses in magnitude and phase, None with too few usable bands."""
    clear = np.isfinite(one.error) & np.isfinite(two.error)
    if clear.sum() < FEWEST:
        return None
    off = np.abs(np.log(one.h[clear] / two.h[clear]))
    return AnswerDifference(
        float(np.median(off)), float(np.median(np.hypot(one.error[clear], two.error[clear])))
    )


def gain_ratio(one: Bands, two: Bands) -> AnswerDifference | None:
    """|ln| of the ratio of two responses' magnitudes in the lowest bands, None where not usable."""
    if not np.all(np.isfinite(one.error[:LOW]) & np.isfinite(two.error[:LOW])):
        return None
    off = np.log(np.abs(one.h[:LOW]) / np.abs(two.h[:LOW]))
    return AnswerDifference(
        abs(float(np.median(off))), float(np.median(np.hypot(one.error[:LOW], two.error[:LOW])))
    )
