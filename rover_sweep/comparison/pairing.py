"""Which simulated run repeats which recorded run: by their steering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.errors import DataRefused

ALIKE = 0.4
"""RMS of the difference over that of the steering, up to which two runs have the same steering.

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

    DataRefused where a simulated run has the steering of no recorded run.
    """
    found: dict[int, Pair] = {}
    for sim in simulated:
        fits = [(*_difference(run, sim), k) for k, run in enumerate(recorded) if k not in found]
        off, late, k = min(fits, default=(np.inf, 0.0, -1))
        if off > ALIKE:
            raise DataRefused(_refusal(sim, off))
        found[k] = Pair(recorded[k], sim, late)
    return [found[k] for k in sorted(found)]


def shared(pair: Pair) -> Pair:
    """The pair with the channels that both sides have. DataRefused where the yaw rate is not one of them."""
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


def _refusal(sim: Experiment, off: float) -> str:
    far = "all of them are taken" if off == np.inf else f"the nearest differs by {100 * off:.0f} % (rms)"
    return (
        f"{sim.name} does not have the steering of any of the runs ({far}); drive the simulation with the "
        "steering and speed of a run, as `rover-sweep redrive` does"
    )


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
