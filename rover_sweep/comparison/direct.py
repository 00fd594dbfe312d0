"""Response against response: the difference of pairs of runs in units of both noise floors together.

The steering and the speed of both sides differ a little, by noise and the time stamps of each log. One model
f, the same for both, removes this: D - f(u_D) is compared with S - f(u_S).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from rover_sweep.comparison.answer import Agreement, Bode, Instrument
from rover_sweep.comparison.common_model import FittedSide
from rover_sweep.comparison.differences import Found
from rover_sweep.data.recording import MOTIONS, Array
from rover_sweep.diagnosis.held_out import SWEPT, frequency_responses_of, overlay_of
from rover_sweep.diagnosis.problem.least_squares import with_speed_drift
from rover_sweep.diagnosis.problem.noise_floor import Floor, level_of
from rover_sweep.diagnosis.problem.residuals import Problem, centred, signals_left, whitened, with_floor
from rover_sweep.diagnosis.residual_maps import channel_name
from rover_sweep.diagnosis.result import TimeHistory
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.errors import DataRefused

# Which simulated run repeats which recorded run: by their steering.


ALIKE = 0.4
"""RMS of difference over RMS of steering, up to which two runs have the same steering.

The firmware that repeats a sweep of 12 Hz through its own loop differs by .05 to .09, the same sweep driven
again by .21, another run by 1. Each side is compared at its own steering."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A recorded run and the simulated one with the same steering.

    late: time of the simulated run's grid at the start of the recorded one's [s].
    """

    recorded: Experiment
    simulated: Experiment
    late: float


def pairs_by_steering(recorded: Sequence[Experiment], simulated: Sequence[Experiment]) -> list[Pair]:
    """Each simulated run with its recorded one, in the order of the recorded runs.

    DataRefused if a simulated run has the steering of no recorded run.
    """
    found: dict[int, Pair] = {}
    for sim in simulated:
        fits = [(*_difference(run, sim), k) for k, run in enumerate(recorded) if k not in found]
        off, late, k = min(fits, default=(np.inf, 0.0, -1))
        if off > ALIKE:
            near = f"the nearest differs by {100 * off:.0f} % (rms)"
            raise DataRefused(
                f"{sim.name} does not have the steering of any of the runs "
                f"({'all of them are taken' if off == np.inf else near}); drive the simulation with the "
                "steering and speed of a run, as `rover-sweep redrive` does"
            )
        found[k] = Pair(recorded[k], sim, late)
    return [found[k] for k in sorted(found)]


def shared(pair: Pair) -> Pair:
    """The pair with the channels that both sides have. DataRefused if the yaw rate is not one of them."""
    both = [c for c in pair.recorded.measured if c in pair.simulated.measured]
    if "r" not in both:
        raise DataRefused(
            f"{pair.simulated.name} and {pair.recorded.name} do not both have the yaw rate r, so they cannot "
            f"be compared; {pair.simulated.name} has {', '.join(pair.simulated.measured) or 'no channel'}"
        )
    one, two = (
        replace(run, measured={c: run.measured[c] for c in both}) for run in (pair.recorded, pair.simulated)
    )
    return replace(pair, recorded=one, simulated=two)


def _difference(run: Experiment, sim: Experiment) -> tuple[float, float]:
    """(rms of the steering's difference over its own rms, time by which the simulated grid is ahead [s])."""
    one, two = run.steer - run.steer.mean(), sim.steer - sim.steer.mean()
    size = next_fast_len(one.size + two.size, real=True)
    product = irfft(rfft(two, size) * np.conj(rfft(one, size)), size)
    shift = int(np.argmax(product))
    shift = shift - size if shift > two.size else shift
    start, end = max(0, -shift), min(one.size, two.size - shift)
    if end - start < 0.7 * one.size:
        return np.inf, 0.0
    gap = run.steer[start:end] - sim.steer[start + shift : end + shift]
    whole = float(np.sqrt(np.mean(one[start:end] ** 2)))
    return float(np.sqrt(np.mean((gap - gap.mean()) ** 2))) / max(whole, 1e-9), shift / RATE


Signals = dict[str, Array]


@dataclass(frozen=True, eq=False)
class Direct:
    """Pairs with their difference.

    problem: of the recorded runs, with the noise floor of both sides. rows (n,): whitened difference,
    recorded minus simulated. allowed (n,): the same with the errors of both speeds allowed for.
    """

    pairs: tuple[Pair, ...]
    problem: Problem
    rows: Array
    allowed: Array

    def agreement(self, held_out: bool) -> tuple[Agreement, ...]:
        """Each run against its simulation."""
        return tuple(self._of_run(k, held_out) for k in range(len(self.pairs)))

    def _of_run(self, k: int, held_out: bool) -> Agreement:
        parts = {c: self.problem.part(self.allowed, k, c) for c in MOTIONS}
        levels = {c: _rms(part) for c, part in parts.items() if part.size}
        pair = self.pairs[k]
        whole = _rms(self.problem.part(self.allowed, k))
        return Agreement(pair.recorded.name, pair.simulated.name, held_out, whole, levels)


def direct(pairs: Sequence[Pair], recordings: FittedSide, simulation: FittedSide) -> Direct:
    """The difference of pairs with the noise floors of both sides, at the noise level of each run.

    `recordings` has the model f. A slower run vibrates less, so each one has a level of its own.
    """
    model = recordings.fitted
    gaps, levels = [], []
    one, two = recordings.plain.floor, simulation.plain.floor
    both = sum_of(one, two)
    for p in pairs:
        left = tuple(signals_left(run, model.model, model.x) for run in (p.recorded, p.simulated))
        gaps.append(_gap(p, *left))
        own = signals_left(p.simulated, simulation.fitted.model, simulation.fitted.x)
        noise = level_of(p.recorded, left[0], one), level_of(p.simulated, own, two)
        levels.append({c: _level_of_both(c, (one, two), noise) for c in both.density})
    runs = [p.recorded for p in pairs]
    problem = with_floor(runs, both, levels)
    rows = whitened(problem.rows, runs, gaps)
    metric = with_speed_drift(problem, model, np.sqrt(2.0))  # both sides have it
    return Direct(tuple(pairs), problem, rows, metric.of(rows))


def _level_of_both(
    channel: str, floors: tuple[Floor, Floor], levels: tuple[Mapping[str, float], Mapping[str, float]]
) -> float:
    """Noise power of a difference over that of both floors, from the level of each side."""
    powers = [floor.rms(channel, *BAND) ** 2 for floor in floors]
    own = sum(p * level.get(channel, 1.0) for p, level in zip(powers, levels, strict=True))
    return own / max(sum(powers), 1e-30)


def sum_of(one: Floor, two: Floor) -> Floor:
    """The noise of a difference: sum of the densities."""
    shared = [c for c in one.density if c in two.density]
    density = {c: one.density[c] + two.at(c, one.f) for c in shared}
    tops = {c: min(f.top.get(c, np.inf) for f in (one, two)) for c in shared}
    return Floor(one.f, density, {c: top for c, top in tops.items() if np.isfinite(top)})


def _gap(pair: Pair, recorded: Signals, simulated: Signals) -> Signals:
    """Recorded minus simulated residual on the recorded run's grid."""
    t = pair.recorded.t + pair.late
    at = pair.simulated.t
    return {
        c: y - np.interp(t, at, simulated[c]) if c in simulated else np.zeros(y.size)
        for c, y in recorded.items()
    }


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(rows**2))) if rows.size else 0.0


# Differences of the measurement that the logs show by themselves: filters, rates, noise.


OTHER_FILTER, OTHER_RATE = 1.05, 1.5  # ratios from which cut-offs and rates are told
OTHER_NOISE = 2.0  # ratio of rms
BAND = (0.5, 8.0)  # Hz, of the noise that is compared


def instruments(pairs: Sequence[Pair], recorded: Floor, simulated: Floor) -> tuple[Instrument, ...]:
    """Differences in known filters, recording rates and noise, channel by channel."""
    pair = pairs[0]
    missing = [
        Instrument("channel", c, "", None, None, f"the simulation has no {channel_name(c)}")
        for c in pair.recorded.measured
        if c not in pair.simulated.measured
    ]
    different = [
        found
        for c in pair.recorded.measured
        if c in pair.simulated.measured
        for found in (*_filters(pair, c), *_rates(pair, c), *_noise(c, recorded, simulated))
    ]
    return (*missing, *different)


def _filters(pair: Pair, channel: str) -> Iterator[Instrument]:
    one, two = (run.filters.get(channel) for run in (pair.simulated, pair.recorded))
    sim, rec = (f.cutoff_hz if f else None for f in (one, two))
    if sim is None and rec is None:
        return
    if sim is None or rec is None or max(sim, rec) > OTHER_FILTER * min(sim, rec):
        words = (
            f"the low-pass of {channel_name(channel)} is {_hz(sim)} in the simulation and {_hz(rec)} in the "
            "recordings; the comparison allows for both"
        )
        yield Instrument("filter", channel, "Hz", sim, rec, words)


def _hz(cutoff: float | None) -> str:
    return "unknown or none" if cutoff is None else f"{cutoff:.3g} Hz"


def _rates(pair: Pair, channel: str) -> Iterator[Instrument]:
    sim, rec = pair.simulated.rates[channel], pair.recorded.rates[channel]
    if max(sim, rec) > OTHER_RATE * min(sim, rec):
        words = (
            f"{channel_name(channel)} is recorded at {sim:.0f} Hz in the simulation and at {rec:.0f} Hz in "
            "the recordings"
        )
        yield Instrument("rate", channel, "Hz", sim, rec, words)


def _noise(channel: str, recorded: Floor, simulated: Floor) -> Iterator[Instrument]:
    if channel not in recorded.density or channel not in simulated.density:
        return
    sim, rec = simulated.rms(channel, *BAND), recorded.rms(channel, *BAND)
    if max(sim, rec) > OTHER_NOISE * min(sim, rec):
        times = f"{rec / sim:.2g}" if sim > 0 else "infinitely many"
        words = f"the recordings have {times} times the noise of the simulation in {channel_name(channel)}"
        yield Instrument("noise", channel, "", sim, rec, words)


# Recorded and simulated signals and responses of pairs of runs, for the pictures.


@dataclass(frozen=True, eq=False)
class BeforeAfter:
    """A recorded run with two simulations of it {channel: (n,)} on its grid, and the noise of both sides."""

    run: Experiment
    before: Signals
    after: Signals
    floor: Floor
    held_out: bool


def predicted(
    compared: Direct, recordings: FittedSide, found: Found, held_out: bool
) -> tuple[BeforeAfter, ...]:
    """The simulated runs without and with the differences that were found."""
    model, out = recordings.fitted.model, []
    for pair in compared.pairs:
        ends = [logged(pair.recorded, model, x[0]) for x in (found.recordings, found.simulation)]
        before = simulated_log(pair)
        after = {c: y + ends[0][c] - ends[1][c] for c, y in before.items() if c in ends[0]}
        out.append(BeforeAfter(pair.recorded, before, after, compared.problem.floor, held_out))
    return tuple(out)


def driven_again(before: Direct, after: Direct, held_out: bool) -> tuple[BeforeAfter, ...]:
    """Two simulations of the same recorded runs."""
    first = {pair.recorded.name: pair for pair in before.pairs}
    return tuple(
        BeforeAfter(
            pair.recorded,
            simulated_log(first[pair.recorded.name]),
            simulated_log(pair),
            after.problem.floor,
            held_out,
        )
        for pair in after.pairs
        if pair.recorded.name in first
    )


def simulated_log(pair: Pair) -> Signals:
    """The simulated run {channel: (n,)} on the recorded run's grid."""
    t, at = pair.recorded.t + pair.late, pair.simulated.t
    log = centred(pair.simulated)
    return {c: np.interp(t, at, log[c]) for c in pair.recorded.measured if c in log}


def histories_of(runs: Sequence[BeforeAfter]) -> tuple[TimeHistory, ...]:
    """Time histories over each other, with the spectra of the residuals over the noise."""
    return tuple(
        overlay_of(one.run, c, one.held_out, one.before[c], one.after[c], one.floor)
        for one in runs
        for c in one.run.measured
        if c in one.before and c in one.after and c in one.floor.density
    )


def bode_of_runs(runs: Sequence[BeforeAfter]) -> tuple[Bode, ...]:
    """Responses of the first run that is a sweep; none without one."""
    one = next((one for one in runs if one.run.kind in SWEPT), None)
    if one is None:
        return ()
    run = one.run
    logs = (centred(run), one.before, one.after)
    measured, before, after = (frequency_responses_of(run, log) for log in logs)
    return tuple(
        Bode(
            run.name,
            one.held_out,
            output,
            found.w,
            found.h,
            before[output].at(found.w)[0],
            after[output].at(found.w)[0],
            found.coherence,
            found.band,
        )
        for output, found in measured.items()
        if output in before and output in after
    )
