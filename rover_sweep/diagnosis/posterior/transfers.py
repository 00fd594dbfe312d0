"""The rows that any small force, steering angle or sensor error would add to a fitted model.

The response to a short pulse at a place, simulated once in each run, is the model's impulse response h there,
through all its sensors. An added signal s(t) then changes a channel by the convolution of h and s, so that a
law costs one Fourier transform and no simulation. It is exact for a linear model at a
constant speed; the curves that are chosen are fitted in the simulation itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.fft import rfft

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter
from rover_sweep.diagnosis.effects.kinds import ForceEffect, LinkageEffect, SensorEffect
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged, motion, sensed
from rover_sweep.diagnosis.simulation.structure import Structure
from rover_sweep.diagnosis.simulation.table_law import FORCES, force_at

LENGTH = 4.0  # s, of an impulse response
PULSE_AT = 0.3  # of the run's length
ANGLE = 0.02  # rad, of a pulse of the steering
WEIGHT = 0.1  # of a pulse of force, as a share of the weight


@dataclass(frozen=True, eq=False)
class RunTransfers:
    """One run of a fitted model. motion {name: (n,)}, signals {channel: (n,)}: of the model, before filters.

    responses {place: {channel: frequency response (k,) at the lines of the run's Fourier transform}}.
    """

    run: Experiment
    motion: Mapping[str, Array]
    signals: Mapping[str, Array]
    responses: Mapping[str, Mapping[str, Any]]


def transfers(
    runs: Sequence[Experiment], structure: Structure, x: Mapping[str, float], places: Sequence[str] = ()
) -> list[RunTransfers]:
    """The impulse responses of a model at the coordinates x in each run. places: () for all."""
    return [_of_run(run, structure, x, places or places_in(structure, run)) for run in runs]


def added_rows(problem: Problem, found: Sequence[RunTransfers], place: str, spectra: Sequence[Any]) -> Array:
    """Whitened rows (size,) that signals add at a place, in the problem's metric.

    spectra: those of the signals, as `tapered_spectrum` gives them, one for each run.
    """
    parts = []
    for row in problem.rows:
        response = found[row.run].responses.get(place, {}).get(row.channel)  # a run may lack the place
        if response is None:
            parts.append(np.zeros(row.size))
            continue
        lines = response[row.bins] * spectra[row.run][row.bins] * row.weight
        parts += [lines.real, lines.imag]
    return problem.of(np.concatenate(parts).astype(np.float64))


def tapered_spectrum(run: Experiment, s: Array) -> Any:
    """Spectrum of a tapered signal s (n,). The taper is slow, so that it may act before the response."""
    return rfft((s * run.taper).astype(np.float32))


def _of_run(
    run: Experiment, structure: Structure, x: Mapping[str, float], places: Sequence[str]
) -> RunTransfers:
    sensors = Sensors.of(run)
    plain = logged(run, structure, x, sensors)
    moved = motion(run, structure, x)
    at = int(PULSE_AT * run.t.size)
    n = min(int(LENGTH * RATE), run.t.size - at)
    responses = {}
    for place in places:
        effect, pulse = _pulse(place, structure, at)
        more = replace(structure, effects=(*structure.effects, effect))
        log = logged(run, more, x, sensors)
        change = {c: (log[c] - plain[c])[at - 2 : at - 2 + n] / pulse for c in plain}
        responses[place] = {c: _early(h, run.t.size) for c, h in change.items() if np.max(np.abs(h)) > 0}
    return RunTransfers(run, moved, sensed(run, structure, x, moved), responses)


def _early(h: Array, size: int) -> Any:
    """Spectrum of a response that begins two samples before its pulse, as the filters are not causal."""
    return rfft(np.roll(np.concatenate((h, np.zeros(size - h.size))), -2).astype(np.float32))


def places_in(structure: Structure, run: Experiment) -> tuple[str, ...]:
    """The places at which a law can act in this model."""
    forces = FORCES if structure.slip and not structure.lumped else ()
    body = [place for place in forces if structure.roll or place != "roll moment"]
    return ("steering", *body, *(f"sensor of {c}" for c in run.measured))


def _pulse(place: str, structure: Structure, at: int) -> tuple[Effect, float]:
    """(effect that adds a pulse of one sample at the index `at`, its height)."""
    rover = structure.rover
    common: dict[str, Any] = {
        "id": "pulse",
        "title": "pulse",
        "equation": "",
        "source": "",
        "apart": "",
        "next_run": "",
        "parameters": (EffectParameter("none", "", 1.0, 0.0, 1.0, ""),),
    }
    if place == "steering":
        return LinkageEffect(**common, act=lambda d, q: _plus(d, at, ANGLE)), ANGLE
    if place.startswith("sensor of "):
        act = partial(_sense, place.split()[-1], at)
        return SensorEffect(**common, act=act), 1.0
    height = WEIGHT * rover.mass * GRAVITY * (rover.wheelbase if "moment" in place else 1.0)
    push = force_at(place, rover)
    return ForceEffect(**common, act=lambda m, q, mass: _force(push, m["t"].size, at, height)), height


def _force(push: tuple[float, float, float], n: int, at: int, height: float) -> tuple[Array, Array, Array]:
    pulse = _plus(np.zeros(n), at, height)
    return push[0] * pulse, push[1] * pulse, push[2] * pulse


def _sense(channel: str, at: int, out: Any, m: Any, q: Any) -> Any:
    return {**out, channel: _plus(out[channel], at, 1.0)}


def _plus(x: Array, at: int, height: float) -> Array:
    out = x.copy()
    out[at] += height
    return out
