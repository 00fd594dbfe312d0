"""The coherence of a run by response and octave, each with a word or two."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from rover_sweep.live.snapshot import CoherenceBand, ResponseCurve
from rover_sweep.quality.coherence import RISING_FROM, VYDOT_FROM
from rover_sweep.spectra.amplitude import octaves
from rover_sweep.spectra.response import COHERENCE_GOOD, RISING, FrequencyResponse
from rover_sweep.spectra.unwrapped import unwrapped_phase

GOOD, WEAK = 0.8, 0.3
POINTS = 80  # of a curve: more than a terminal has columns for


def coherence_bands(found: Mapping[str, FrequencyResponse]) -> tuple[CoherenceBand, ...]:
    """Median coherence of each response in bands of about an octave [rad/s]."""
    return tuple(band for f in found.values() for band in _bands(f))


def _bands(f: FrequencyResponse) -> Iterator[CoherenceBand]:
    edges = octaves(float(f.w[0]), float(f.w[-1])).tolist()
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = (f.w >= low * (1 - 1e-9)) & (f.w <= high * (1 + 1e-9))
        if inside.any():
            coherence = float(np.median(f.coherence[inside]))
            yield CoherenceBand(f.output, low, high, coherence, _words(f, low, high, coherence))


def _words(f: FrequencyResponse, low: float, high: float, coherence: float) -> str:
    if coherence >= GOOD:
        return "good"
    if coherence >= COHERENCE_GOOD:
        return "usable"
    middle = np.sqrt(low * high)
    if f.output == "vydot" and middle < VYDOT_FROM:
        return "weak: the GPS bends the speed"
    if f.output in RISING and middle < RISING_FROM * f.w[0]:
        return "weak: too slow for an answer"
    return "weak" if coherence >= WEAK else "lost in noise"


def response_curves(
    found: Mapping[str, FrequencyResponse], rad_per_us: float | None = None
) -> tuple[ResponseCurve, ...]:
    """At most `POINTS` points of each response, per rad of the road wheels where rad_per_us is known."""
    return tuple(_curve(f if rad_per_us is None else per_rad(f, rad_per_us)) for f in found.values())


def per_rad(f: FrequencyResponse, rad_per_us: float) -> FrequencyResponse:
    """The response to the road-wheel angle; in ArduPilot a larger PWM turns right."""
    return f if f.input == "delta" else replace(f, h=f.h / -rad_per_us, input="delta")


def _curve(f: FrequencyResponse) -> ResponseCurve:
    places = np.unique(np.linspace(0, f.w.size - 1, POINTS).round().astype(int))
    gain = 20.0 * np.log10(np.maximum(np.abs(f.h), 1e-12))
    phase = unwrapped_phase(f.h, f)
    w, db, deg, coherence = (
        tuple(float(f"{value:.4g}") for value in x[places]) for x in (f.w, gain, phase, f.coherence)
    )
    return ResponseCurve(f.output, w, db, deg, coherence, "rad" if f.input == "delta" else "us")


def spoken(found: tuple[CoherenceBand, ...]) -> dict[str, str]:
    """One line per response: where it is good, usable, weak."""
    lines: dict[str, list[tuple[str, float, float]]] = {}
    for band in found:
        parts = lines.setdefault(band.response, [])
        if parts and parts[-1][0] == band.words:
            parts[-1] = (band.words, parts[-1][1], band.high)
        else:
            parts.append((band.words, band.low, band.high))
    return {
        response: ", ".join(_stretch(parts, k) for k in range(len(parts)))
        for response, parts in lines.items()
    }


def _stretch(parts: list[tuple[str, float, float]], k: int) -> str:
    words, low, high = parts[k]
    word, _, reason = words.partition(": ")
    if len(parts) == 1:
        where = ""
    elif k == 0:
        where = f" below {high:.2g} rad/s"
    elif k == len(parts) - 1:
        where = f" above {low:.2g} rad/s"
    else:
        where = f" {low:.2g}-{high:.2g} rad/s"
    return f"{word}{where}{': ' + reason if reason else ''}"
