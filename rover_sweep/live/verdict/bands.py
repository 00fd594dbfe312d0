"""The coherence of a run by response and octave, each with a word or two."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from rover_sweep.live.snapshot import CoherenceBand
from rover_sweep.quality.coherence import RISING_FROM, VYDOT_FROM
from rover_sweep.spectra.amplitude import octaves
from rover_sweep.spectra.response import COHERENCE_GOOD, RISING, FrequencyResponse

GOOD, WEAK = 0.8, 0.3


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
