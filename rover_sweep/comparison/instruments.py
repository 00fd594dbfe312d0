"""Differences of the measurement that the logs show by themselves: filters, rates, noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rover_sweep.comparison.answer import Instrument
from rover_sweep.comparison.pairing import Pair
from rover_sweep.diagnosis.problem.noise_floor import Floor

OTHER_FILTER, OTHER_RATE = 1.05, 1.5  # ratios from which cut-offs and rates are told
OTHER_NOISE = 2.0  # ratio of rms
SYMBOLS = {"ay": "a_y", "vy": "V_y"}
BAND = (0.5, 8.0)  # Hz, of the noise that is compared


def instruments(pairs: Sequence[Pair], recorded: Floor, simulated: Floor) -> tuple[Instrument, ...]:
    """What differs in the known filters, the rates of the records and the noise, channel by channel."""
    pair = pairs[0]
    channels = [c for c in pair.recorded.measured if c in pair.simulated.measured]
    missing = [c for c in pair.recorded.measured if c not in pair.simulated.measured]
    out = [
        found
        for c in channels
        for found in (*_filters(pair, c), *_rates(pair, c), *_noise(c, recorded, simulated))
    ]
    return (*(_not_there(c) for c in missing), *out)


def _not_there(channel: str) -> Instrument:
    return Instrument("channel", channel, "", None, None, f"the simulation has no {_symbol(channel)}")


def _filters(pair: Pair, channel: str) -> Iterator[Instrument]:
    one, two = (run.filters.get(channel) for run in (pair.simulated, pair.recorded))
    sim, rec = (f.cutoff_hz if f else None for f in (one, two))
    if sim is None and rec is None:
        return
    if sim is None or rec is None or max(sim, rec) > OTHER_FILTER * min(sim, rec):
        words = (
            f"the low-pass of {_symbol(channel)} is {_hz(sim)} in the simulation and {_hz(rec)} in the "
            "recordings; the comparison allows for both"
        )
        yield Instrument("filter", channel, "Hz", sim, rec, words)


def _symbol(channel: str) -> str:
    return SYMBOLS.get(channel, channel)


def _hz(cutoff: float | None) -> str:
    return "unknown or none" if cutoff is None else f"{cutoff:.3g} Hz"


def _rates(pair: Pair, channel: str) -> Iterator[Instrument]:
    sim, rec = pair.simulated.rates[channel], pair.recorded.rates[channel]
    if max(sim, rec) > OTHER_RATE * min(sim, rec):
        words = (
            f"{_symbol(channel)} is recorded at {sim:.0f} Hz in the simulation and at {rec:.0f} Hz in the "
            "recordings"
        )
        yield Instrument("rate", channel, "Hz", sim, rec, words)


def _noise(channel: str, recorded: Floor, simulated: Floor) -> Iterator[Instrument]:
    if channel not in recorded.density or channel not in simulated.density:
        return
    sim, rec = simulated.rms(channel, *BAND), recorded.rms(channel, *BAND)
    if max(sim, rec) > OTHER_NOISE * min(sim, rec):
        times = f"{rec / sim:.2g}" if sim > 0 else "infinitely many"
        words = f"the recordings have {times} times the noise of the simulation in {_symbol(channel)}"
        yield Instrument("noise", channel, "", sim, rec, words)
