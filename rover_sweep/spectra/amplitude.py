"""Which steering amplitude the next run needs, octave by octave, from the noise of the run just driven.

Of an output's power the share g2 (the coherence) follows the steering, so that its signal-to-noise ratio
is g2/(1 - g2). Signal power grows with the square of the amplitude and noise of sensors, road and engine
does not, which gives the coherence at any other amplitude. What is not noise (a steering with play, tyres
near their limit, a speed that changes) does not obey this: the forecast is for a rover that is linear.

A coherence estimated from few averages is too high: by about (1 - g2)/n for n independent ones (Bendat and
Piersol, Random Data, 4th edition, section 9.2.3), which is taken off before it is used. The normalised
random error of a response is C sqrt(1 - g2)/(|g| sqrt(2 n_d)) (Tischler and Remple 2012).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.spectra.response import COHERENCE_GOOD, RISING, FrequencyResponse
from rover_sweep.spectra.spectra import OVERLAP_CONSTANT

WANTED_COHERENCE = 0.8  # a margin above the .6 that is usable
WANTED_ERROR = 0.10  # normalised random error of |h|
LEAST, MOST = 0.05, 8.0  # of the driven amplitude: beyond, one run does not tell
ENOUGH = 1.1  # of the driven amplitude: less more than that is not worth a repetition
RISING_FROM = 4.0  # of the lowest frequency, where p and V_y' are asked for an answer (the paper: p from 2)


@dataclass(frozen=True)
class Limit:
    """A largest amplitude (us) at each frequency, and what sets it in words. us: (n,) at w (n,) rad/s."""

    words: str
    w: Array
    us: Array

    def within(self, low: float, high: float) -> float:
        """The smallest between two frequencies [rad/s]."""
        inside = (self.w >= low) & (self.w <= high)
        return float(np.min(self.us[inside], initial=np.inf))


@dataclass(frozen=True)
class BandAmplitude:
    """What a band of about an octave, low..high [rad/s], needs. response: the one that needs most.

    coherence: its median there (as estimated); noise_to_signal: power ratio at the driven amplitude, its
    bias taken off. wanted [us]: makes the median coherence .8 and the random error 10 %. amplitude [us]:
    that, as far as the limits allow; cap: the limit that bites, '' where none does; reached: the median
    coherence to expect with it. drowned: nothing of the answer could be told from noise, so that wanted
    is a lower bound.
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
    """Amplitudes for the next run like this one. driven [us] or the unit that the limits have.

    amplitude: for the whole range, or up to w_max [rad/s]; None where the one that was driven will do, or
    no more can be had. w_max: up to where the limits allow a usable coherence, None where that is everywhere
    or nowhere. sentence: all that in words, '' for no bands.
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
    """n_d (n_w,), as the random error of the response tells it."""
    g2 = np.clip(f.coherence, 1e-6, 1 - 1e-6)
    return np.asarray(OVERLAP_CONSTANT**2 * (1 - g2) / (2 * g2 * f.random_error**2))


def signal_to_noise(f: FrequencyResponse) -> Array:
    """Power ratio (n_w,) of what follows the steering to what does not, the estimate's bias taken off."""
    independent = np.maximum(averages(f) / OVERLAP_CONSTANT**2, 1.5)
    g2 = np.clip((independent * f.coherence - 1) / (independent - 1), 0.0, 1 - 1e-9)
    return np.asarray(g2 / (1 - g2))


def wanted_factor(f: FrequencyResponse, low: float, high: float) -> tuple[float, float, float] | None:
    """(ratio of amplitudes, noise to signal now, wanted signal to noise) of low..high [rad/s].

    None where the response is not asked for an answer: p and V_y' at the low end.
    """
    start = min(RISING_FROM * f.w[0], np.sqrt(f.w[0] * f.w[-1])) if f.output in RISING else f.w[0]
    inside = (f.w >= max(low, start) * (1 - 1e-9)) & (f.w <= high * (1 + 1e-9))
    if np.sum(inside) < 2:
        return None
    ratio = float(np.median(signal_to_noise(f)[inside]))
    error = OVERLAP_CONSTANT**2 / (2 * float(np.median(averages(f)[inside])) * WANTED_ERROR**2)
    wanted = max(WANTED_COHERENCE / (1 - WANTED_COHERENCE), error)
    factor = np.sqrt(wanted / ratio) if ratio > 0 else np.inf
    return float(np.clip(factor, LEAST, MOST)), 1 / ratio if ratio > 0 else np.inf, wanted


def propose(
    found: Mapping[str, FrequencyResponse],
    driven: float,
    limits: tuple[Limit, ...] = (),
    little: float = 0.0,
    unit: str = "us",
) -> AmplitudeProposal:
    """The proposal from a run's responses {output: response}, those that are to be answered for.

    driven: amplitude of the run, in the unit of the limits; little: no cut below it is ever proposed;
    unit: of all these, "us" of a servo output or "rad" of the wheels' angle.
    """
    if not found:
        return AmplitudeProposal(driven, (), None, None, "")
    w = next(iter(found.values())).w
    edges = octaves(float(w[0]), float(w[-1]))
    bands = tuple(
        band
        for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        if (band := _band(found, low, high, driven, limits, little)) is not None
    )
    return _proposal(driven, bands, limits, unit)


def _band(
    found: Mapping[str, FrequencyResponse],
    low: float,
    high: float,
    driven: float,
    limits: tuple[Limit, ...],
    little: float,
) -> BandAmplitude | None:
    needs = {o: need for o, f in found.items() if (need := wanted_factor(f, low, high)) is not None}
    if not needs:
        return None
    response = max(needs, key=lambda o: needs[o][0])
    factor, noise, _ = needs[response]
    f = found[response]
    coherence = float(np.median(f.coherence[(f.w >= low) & (f.w <= high)]))
    wanted = max(factor * driven, min(little, driven))
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
    needy = max(bands, key=lambda b: b.wanted)
    # The wave has one amplitude, so that of the whole range must keep within the limits of every band.
    first, last = bands[0].low, bands[-1].high
    tightest = min(limits, key=lambda limit: limit.within(first, last), default=None)
    most = tightest.within(first, last) if tightest else np.inf
    if needy.wanted <= ENOUGH * driven:
        spare = f"; {_said(needy.wanted, unit)} would do" if needy.wanted < driven / ENOUGH**2 else ""
        past = (
            f", but {tightest.words} allows {_said(most, unit)}"
            if tightest and driven > ENOUGH * most
            else ""
        )
        return AmplitudeProposal(driven, bands, None, None, f"{_said(driven, unit)} is enough{past}{spare}")
    alike = [b for b in bands if b.response == needy.response and b.wanted > 0.9 * needy.wanted]
    where = f"at {alike[0].low:.2g}-{alike[-1].high:.3g} rad/s"
    asked = f"{'at least ' if needy.drowned else ''}{_said(needy.wanted, unit)}"
    if tightest is None or needy.wanted <= most:
        said = f"{asked}: {needy.response} needs it {where}"
        return AmplitudeProposal(driven, bands, needy.wanted, None, said + _less(driven, bands, unit))
    said = f"{needy.response} asks for {asked} {where}, but {tightest.words} allows {_said(most, unit)}"
    count, amplitude = _usable(driven, bands, limits)
    return AmplitudeProposal(
        driven,
        bands,
        amplitude if amplitude > ENOUGH * driven else None,
        bands[count - 1].high if 0 < count < len(bands) else None,
        said + _less(driven, bands, unit),
    )


def _usable(driven: float, bands: tuple[BandAmplitude, ...], limits: tuple[Limit, ...]) -> tuple[int, float]:
    """Up to how many of the bands one amplitude within the limits gives a usable coherence; and it."""
    for count in range(len(bands), 0, -1):
        some = bands[:count]
        most = min(limit.within(some[0].low, some[-1].high) for limit in limits)
        amplitude = min(max(band.wanted for band in some), most)
        if all(_reached(band.noise_to_signal, driven, amplitude) >= COHERENCE_GOOD for band in some):
            return count, amplitude
    return 0, min(limit.within(bands[0].low, bands[-1].high) for limit in limits)


def _reached(noise: float, driven: float, amplitude: float) -> float:
    """Coherence at another amplitude. noise: noise to signal as it was driven."""
    return 1 / (1 + noise * (driven / amplitude) ** 2)


def _less(driven: float, bands: tuple[BandAmplitude, ...], unit: str) -> str:
    """Up to where less would do than was driven, '' where nowhere."""
    spare = []
    for band in bands:
        if band.wanted > driven / 1.5:
            break
        spare.append(band)
    if not spare:
        return ""
    return f"; below {spare[-1].high:.2g} rad/s {_said(max(b.wanted for b in spare), unit)} would do"


def _said(amplitude: float, unit: str) -> str:
    return f"{amplitude:.0f} us" if unit == "us" else f"{amplitude:.2g} {unit}"
