"""The steering amplitude that the next run needs, octave by octave, from the noise of the run just driven.

The share g2 (the coherence) of an output's power follows the steering, so the signal-to-noise ratio is
g2/(1 - g2). Signal power grows with the square of the amplitude; the noise of sensors, road and motor does
not. This gives the coherence at any other amplitude, for a linear rover: it does not hold with play in the
steering, tyres near their limit or a changing speed.

A coherence estimated from n independent averages is too high by about (1 - g2)/n (Bendat and Piersol 2010,
section 9.2.3); this bias is removed first. The normalised random error of a response is
C sqrt(1 - g2)/(|g| sqrt(2 n_d)) (Tischler and Remple 2012, chapter 7).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.spectra.response import COHERENCE_GOOD, RISING, FrequencyResponse
from rover_sweep.spectra.windowed import OVERLAP_CONSTANT

WANTED_COHERENCE = 0.8  # a margin above the .6 that is usable
WANTED_ERROR = 0.10  # normalised random error of |h|
LEAST, MOST = 0.05, 8.0  # of the driven amplitude: range of the forecast from one run
ENOUGH = 1.1  # of the driven amplitude: a smaller increase is not worth another run
RISING_FROM = 4.0  # of the lowest frequency: p and V_y' are judged from there (the paper: p from 2)


@dataclass(frozen=True)
class Limit:
    """Largest allowed amplitude us (n,) at w (n,) [rad/s]. words: its cause, such as "the servo's rate"."""

    words: str
    w: Array
    us: Array

    def within(self, low: float, high: float) -> float:
        """The smallest value between two frequencies [rad/s], infinite where there is none."""
        inside = (self.w >= low) & (self.w <= high)
        return float(np.min(self.us[inside], initial=np.inf))


@dataclass(frozen=True)
class BandAmplitude:
    """The amplitude for a band of about an octave, low..high [rad/s]. response: needs the largest amplitude.

    coherence: median in the band, as estimated; noise_to_signal: power ratio at the driven amplitude, free
    of bias. wanted [us]: for a median coherence of .8 and a random error of 10 %. amplitude [us]: the
    wanted one within the limits; cap: the limit that applies, '' for none; reached: expected median coherence
    at `amplitude`. drowned: the response was lost in the noise, so wanted is a lower bound.
    """

    low: float
    high: float
    response: str
    coherence: float
    noise_to_signal: float
    wanted: float
    amplitude: float
    reached: float
    cap: str = ""
    drowned: bool = False


@dataclass(frozen=True)
class AmplitudeProposal:
    """Amplitudes for the next run of this manoeuvre. driven: in this run [us or unit of the limits].

    amplitude: for the whole range, or up to w_max; None when the driven one is enough or cannot be raised.
    w_max [rad/s]: the limits allow a usable coherence up to here; None for everywhere or nowhere. sentence:
    the result in words, '' without bands.
    """

    driven: float
    bands: tuple[BandAmplitude, ...]
    amplitude: float | None
    w_max: float | None
    sentence: str


def octaves(low: float, high: float) -> Array:
    """Edges [rad/s] of bands of about an octave."""
    return np.geomspace(low, high, max(round(np.log2(high / low)), 1) + 1)


def averages(f: FrequencyResponse) -> Array:
    """Number of averages n_d (n_w,), from the coherence and the random error of the response."""
    g2 = np.clip(f.coherence, 1e-6, 1 - 1e-6)
    return np.asarray(OVERLAP_CONSTANT**2 * (1 - g2) / (2 * g2 * f.random_error**2))


def signal_to_noise(f: FrequencyResponse) -> Array:
    """Power ratio (n_w,) of the part that follows the steering to the rest, free of bias."""
    independent = np.maximum(averages(f) / OVERLAP_CONSTANT**2, 1.5)
    g2 = np.clip((independent * f.coherence - 1) / (independent - 1), 0.0, 1 - 1e-9)
    return np.asarray(g2 / (1 - g2))


def judged_from(f: FrequencyResponse) -> float:
    """Lowest frequency [rad/s] that is judged: responses that rise with w are lost in noise at the low end.

    For them, 4 times the lowest frequency, or the upper half of a narrow range.
    """
    return float(min(RISING_FROM * f.w[0], np.sqrt(f.w[0] * f.w[-1])) if f.output in RISING else f.w[0])


def wanted_factor(f: FrequencyResponse, low: float, high: float) -> tuple[float, float, float] | None:
    """(factor of the amplitude, noise to signal as driven, wanted signal to noise) in low..high [rad/s].

    Ratios of power. None where the response is not judged: p and V_y' at the low end.
    """
    inside = (f.w >= max(low, judged_from(f)) * (1 - 1e-9)) & (f.w <= high * (1 + 1e-9))
    if np.sum(inside) < 2:
        return None
    ratio = float(np.median(signal_to_noise(f)[inside]))
    error = OVERLAP_CONSTANT**2 / (2 * float(np.median(averages(f)[inside])) * WANTED_ERROR**2)
    wanted = max(WANTED_COHERENCE / (1 - WANTED_COHERENCE), error)
    factor = np.sqrt(wanted / ratio) if ratio > 0 else np.inf
    return float(np.clip(factor, LEAST, MOST)), 1 / ratio if ratio > 0 else np.inf, wanted


def propose_amplitude(
    found: Mapping[str, FrequencyResponse],
    driven: float,
    limits: tuple[Limit, ...] = (),
    least: float = 0.0,
    unit: str = "us",
) -> AmplitudeProposal:
    """The proposal from the judged responses {output: response} of a run.

    driven: amplitude of the run; least: smallest amplitude that is proposed; unit of both and of the limits:
    "us" of the servo output or "rad" of the road wheels.
    """
    if not found:
        return AmplitudeProposal(driven, (), None, None, "")
    w = next(iter(found.values())).w
    edges = octaves(float(w[0]), float(w[-1]))
    bands = tuple(
        band
        for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        if (band := _band(found, low, high, driven, limits, least)) is not None
    )
    return _proposal(driven, bands, limits, unit)


def _band(
    found: Mapping[str, FrequencyResponse],
    low: float,
    high: float,
    driven: float,
    limits: tuple[Limit, ...],
    least: float,
) -> BandAmplitude | None:
    needs = {o: need for o, f in found.items() if (need := wanted_factor(f, low, high)) is not None}
    if not needs:
        return None
    response = max(needs, key=lambda o: needs[o][0])
    factor, noise, _ = needs[response]
    f = found[response]
    coherence = float(np.median(f.coherence[(f.w >= low) & (f.w <= high)]))
    wanted = max(factor * driven, min(least, driven))
    tightest = min(limits, key=lambda limit: limit.within(low, high), default=None)
    most = tightest.within(low, high) if tightest else np.inf
    amplitude = min(wanted, most)
    return BandAmplitude(
        low,
        high,
        response,
        coherence,
        noise,
        wanted,
        amplitude,
        _reached(noise, driven, amplitude),
        cap=tightest.words if tightest and wanted > most else "",
        drowned=factor >= MOST,
    )


def _proposal(
    driven: float, bands: tuple[BandAmplitude, ...], limits: tuple[Limit, ...], unit: str
) -> AmplitudeProposal:
    if not bands:
        return AmplitudeProposal(driven, (), None, None, "")
    neediest = max(bands, key=lambda b: b.wanted)
    # The wave has one amplitude, so it must be within the limits of every band.
    first, last = bands[0].low, bands[-1].high
    tightest = min(limits, key=lambda limit: limit.within(first, last), default=None)
    most = tightest.within(first, last) if tightest else np.inf
    if neediest.wanted <= ENOUGH * driven:
        sentence = f"{_with_unit(driven, unit)} is enough"
        if tightest and driven > ENOUGH * most:
            sentence += f", but {tightest.words} allows {_with_unit(most, unit)}"
        if neediest.wanted < driven / ENOUGH**2:
            sentence += f"; {_with_unit(neediest.wanted, unit)} would also be enough"
        return AmplitudeProposal(driven, bands, None, None, sentence)
    neighbours = [b for b in bands if b.response == neediest.response and b.wanted > 0.9 * neediest.wanted]
    where = f"at {neighbours[0].low:.2g}-{neighbours[-1].high:.3g} rad/s"
    asked = f"{'at least ' if neediest.drowned else ''}{_with_unit(neediest.wanted, unit)}"
    if tightest is None or neediest.wanted <= most:
        sentence = f"{asked}: needed for {neediest.response} {where}"
        return AmplitudeProposal(driven, bands, neediest.wanted, None, sentence + _less(driven, bands, unit))
    sentence = (
        f"{neediest.response} needs {asked} {where}, but {tightest.words} allows {_with_unit(most, unit)}"
    )
    count, amplitude = _usable(driven, bands, limits)
    return AmplitudeProposal(
        driven,
        bands,
        amplitude if amplitude > ENOUGH * driven else None,
        bands[count - 1].high if 0 < count < len(bands) else None,
        sentence + _less(driven, bands, unit),
    )


def _usable(driven: float, bands: tuple[BandAmplitude, ...], limits: tuple[Limit, ...]) -> tuple[int, float]:
    """(number of bands from the lowest, amplitude): most bands with a usable coherence within the limits."""
    for count in range(len(bands), 0, -1):
        some = bands[:count]
        most = min(limit.within(some[0].low, some[-1].high) for limit in limits)
        amplitude = min(max(band.wanted for band in some), most)
        if all(_reached(band.noise_to_signal, driven, amplitude) >= COHERENCE_GOOD for band in some):
            return count, amplitude
    return 0, min(limit.within(bands[0].low, bands[-1].high) for limit in limits)


def _reached(noise: float, driven: float, amplitude: float) -> float:
    """Expected coherence at another amplitude. noise: noise to signal as driven."""
    return 1 / (1 + noise * (driven / amplitude) ** 2)


def _less(driven: float, bands: tuple[BandAmplitude, ...], unit: str) -> str:
    """A clause on the low bands for which a smaller amplitude is enough, '' for none."""
    spare = []
    for band in bands:
        if band.wanted > driven / 1.5:
            break
        spare.append(band)
    if not spare:
        return ""
    return f"; below {spare[-1].high:.2g} rad/s {_with_unit(max(b.wanted for b in spare), unit)} is enough"


def _with_unit(amplitude: float, unit: str) -> str:
    return f"{amplitude:.0f} us" if unit == "us" else f"{amplitude:.2g} {unit}"
