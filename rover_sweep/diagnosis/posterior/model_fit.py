"""A model fitted to runs in the metric of the tolerances, with its noise floor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import exp
from typing import Any

import numpy as np
from scipy.fft import rfft

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import MOTIONS, Array
from rover_sweep.diagnosis.effects.effect import (
    Effect,
    EffectParameter,
    ForceEffect,
    SensorEffect,
    SteeringEffect,
    VehicleEffect,
)
from rover_sweep.diagnosis.problem.least_squares import (
    COARSE,
    Fitted,
    Signature,
    columns,
    columns_of_runs,
    fit,
    signatures,
    speed_drift,
)
from rover_sweep.diagnosis.problem.residuals import Problem, Rows, problem, signals_left
from rover_sweep.diagnosis.simulation.candidates import Model, possible
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import logged, motion, sensed
from rover_sweep.diagnosis.simulation.table_law import FORCES, force_at

# The rows that any small force, steering angle or sensor error would add to a fitted model.
#
# The response to a short pulse at a place, simulated once in each run, is the model's impulse response h
# there, through all its sensors. An added signal s(t) then changes a channel by the convolution of h and s,
# so that a law costs one Fourier transform and no simulation. It is exact for a linear model at a constant
# speed; the curves that are chosen are fitted in the simulation itself.


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
    runs: Sequence[Experiment], model: Model, x: Mapping[str, float], places: Sequence[str] = ()
) -> list[RunTransfers]:
    """The impulse responses of a model at the coordinates x in each run. places: () for all."""
    return [_of_run(run, model, x, places or places_in(model, run)) for run in runs]


def added_rows(problem: Problem, found: Sequence[RunTransfers], place: str, spectra: Sequence[Any]) -> Array:
    """Whitened rows (size,) that signals add at a place, in the problem's metric.

    spectra: of the signals by `tapered_spectrum`, one for each run.
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
    """Spectrum of a tapered signal s (n,). The taper is slow, so it may come before the response."""
    return rfft((s * run.taper).astype(np.float32))


def _of_run(run: Experiment, model: Model, x: Mapping[str, float], places: Sequence[str]) -> RunTransfers:
    plain = logged(run, model, x)
    moved = motion(run, model, x)
    at = int(PULSE_AT * run.t.size)
    n = min(int(LENGTH * RATE), run.t.size - at)
    responses = {}
    for place in places:
        effect, pulse = _pulse(place, model, at)
        more = replace(model, unnamed=(*model.unnamed, effect))
        log = logged(run, more, x)
        change = {c: (log[c] - plain[c])[at - 2 : at - 2 + n] / pulse for c in plain}
        # it begins two samples before its pulse, as the filters are not causal
        spectra = {
            c: rfft(np.roll(np.concatenate((h, np.zeros(run.t.size - h.size))), -2).astype(np.float32))
            for c, h in change.items()
            if np.max(np.abs(h)) > 0
        }
        responses[place] = spectra
    return RunTransfers(run, moved, sensed(run, model, x, moved), responses)


def places_in(model: Model, run: Experiment) -> tuple[str, ...]:
    """The places at which a law can act in this model."""
    forces = FORCES if model.slip and not model.lumped else ()
    body = [place for place in forces if model.roll or place != "roll moment"]
    return ("steering", *body, *(f"sensor of {c}" for c in run.measured))


def _pulse(place: str, model: Model, at: int) -> tuple[Effect, float]:
    """(effect that adds a pulse of one sample at the index `at`, its height)."""
    rover = model.rover
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
        return SteeringEffect(**common, act=lambda d, q: _plus(d, at, ANGLE)), ANGLE
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


# The error that every model of a rover has, as a term of the covariance.
#
# No rover is a single track with roll: unsprung masses, a roll axis that nobody sees, Ackermann geometry,
# creeping tyres, three dimensions. What they leave is no noise, and without this term an effect of the
# library is fitted to it, and named. Three coefficients of the equations, alike in all runs, are known no
# better than:
#
#     Y_f += C z_f p/V,  Y_r += C z_r p/V    z ~ N(0, (HEIGHT h)^2): the tyres' contact moves sideways with p
#     N += t m a_y                           t ~ N(0, (TRAIL L)^2): pneumatic trail
#
# And each modelled response is uncertain by `COMMON` of its gain, and by as much in phase [rad], in every
# octave and alike in all runs, and by `OWN` in each run for itself:
#
#     rows = (1 + sum over octaves k of (a_k + i b_k) hat_k(log2 f)) modelled rows,   a_k, b_k ~ N(0, rho^2)
#
# The hats are linear in log2 f and sum to 1. Kennedy and O'Hagan 2001: Bayesian calibration of computer
# models (the discrepancy), J. R. Statist. Soc. B 63(3); here it is relative, and a Gaussian process on few
# knots. The four sizes are those under which healthy rovers of four engines are most probable.


COMMON = 0.007  # standard deviation of the relative error that all runs share
OWN = 0.005  # of the one of each run
HEIGHT = 0.5  # of the contact's way sideways, over that of the CG
TRAIL = 0.025  # of the wheelbase
KNOTS = 0.04 * 2.0 ** np.arange(9)  # Hz, an octave apart, from below the sweeps to beyond the highest line


def structural_error(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Signatures of the model's structural error, one standard deviation. problem: without metric."""
    return [*errors_of_coefficients(problem, fitted), *errors_of_responses(problem, fitted)]


def errors_of_coefficients(problem: Problem, fitted: Fitted) -> Iterator[Signature]:
    """Signatures of the tyre-slip coefficients that no measurement determines."""
    model, x = fitted.model, fitted.x
    if model.lumped or not model.slip:
        return
    rover, stiffness = model.rover, exp(x["ln_C"])
    parts = {"yaw moment": ("trail", TRAIL * rover.wheelbase * rover.mass)}
    if model.roll and rover.h:
        height = HEIGHT * rover.h * exp(x.get("ln_h", 0.0))
        parts |= {f"side force {end}": (f"roll axis {end}", height * stiffness) for end in ("front", "rear")}
    found = transfers(problem.runs, model, x, tuple(parts))
    for place, (name, size) in parts.items():
        driving = [t.motion["across"] if name == "trail" else t.motion["p"] / t.motion["V"] for t in found]
        spectra = [tapered_spectrum(t.run, size * s) for t, s in zip(found, driving, strict=True)]
        yield Signature("structure", name, 1.0, added_rows(problem.plain, found, place, spectra))


def errors_of_responses(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Gain and phase errors by octave and channel: of all runs, and of each one."""
    modelled = problem.plain_models(fitted.model, [fitted.x])[0]
    out = []
    for channel in dict.fromkeys(r.channel for r in problem.rows):
        runs = [r for r in problem.rows if r.channel == channel]
        out += list(_of_response(channel, COMMON, runs, modelled))
        for r in runs if len(runs) > 1 else ():
            own = problem.rows_of(r.run)
            at = replace(r, start=r.start - own.start)
            out += [replace(s, run=r.run) for s in _of_response(channel, OWN, [at], modelled[own])]
    return out


def _of_response(channel: str, size: float, members: list[Rows], modelled: Array) -> Iterator[Signature]:
    """The signatures of one channel in some runs: gain and phase of each octave that their lines reach.

    modelled (n,): rows of the model, to which the starts of the members refer.
    """
    for knot in range(KNOTS.size):
        gain, phase = np.zeros(modelled.size), np.zeros(modelled.size)
        for r in members:
            hat = size * _hat(knot, r.f)
            real, imag = slice(r.start, r.start + r.bins.size), slice(r.start + r.bins.size, r.start + r.size)
            gain[real], gain[imag] = hat * modelled[real], hat * modelled[imag]
            phase[real], phase[imag] = -hat * modelled[imag], hat * modelled[real]
        if gain.any():
            yield Signature("structure", f"gain of {channel} at {KNOTS[knot]:.3g} Hz", size, gain)
            yield Signature("structure", f"phase of {channel} at {KNOTS[knot]:.3g} Hz", size, phase)


def _hat(knot: int, f: Array) -> Array:
    """The hat (k,) of one knot over log2 of f (k,) [Hz]; the first and the last go on beyond the knots."""
    place = np.log2(np.clip(f, KNOTS[0], KNOTS[-1]) / KNOTS[0])
    return np.maximum(0.0, 1.0 - np.abs(place - knot))


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A model fitted twice, each time with its Jacobian at the fit.

    problem, fitted: in the metric of the tolerances. closest: the fit without tolerances, which is nearest to
    the recordings. cannot_see: {effect: why}.
    """

    problem: Problem
    closest: Fitted
    fitted: Fitted
    cannot_see: Mapping[str, str]

    @property
    def model(self) -> Model:
        """The model."""
        return self.fitted.model

    @property
    def misfit(self) -> dict[str, float]:
        """{channel: mean square of its residual rows with tolerances allowed for, 1 at the noise floor}."""
        parts = {c: self.problem.part(self.fitted.rows, channel=c) for c in MOTIONS}
        return {c: float(np.mean(part**2)) for c, part in parts.items() if part.size}

    def with_explanation(self, fitted: Fitted) -> ModelFit:
        """Another model, fitted in the same metric, with its closest fit."""
        return replace(self, closest=fit(self.problem.plain, fitted.model, fitted.x), fitted=fitted)


def model_fit(
    runs: Sequence[Experiment],
    model: Model,
    start: Mapping[str, float],
    only: Sequence[str] = (),
    without: Sequence[str] = (),
) -> ModelFit:
    """The model fitted to runs. start: {coordinate: value}; only, without: ids, for `cannot_see`."""
    plain, closest = fit_with_floor(runs, model, start)
    metric = in_metric_of(plain, closest)
    known = replace(closest, jacobian=metric.of(closest.jacobian))
    fitted = fit(metric, model, closest.x, known=known, roughly=True)
    if not fitted.far_off:  # else it is only where a search begins
        fitted = fit(metric, model, fitted.x, known=fitted)
    return ModelFit(metric, closest, fitted, possible(model, runs, only, without)[1])


def in_metric_of(plain: Problem, fitted: Fitted) -> Problem:
    """The problem in the metric of tolerances, speed errors and structural errors."""
    effects = possible(fitted.model, plain.runs)[0]
    given, plain = plain, plain.steadied(fitted.model, fitted.x)
    known = signatures(plain, fitted, effects, tolerances=True)
    inexact = {e.id for e in effects if isinstance(e, VehicleEffect) or e.id == "tyre_speed"}
    usual = [*(s for s in known if s.effect in inexact), *speed_drift(plain, fitted)]
    usual += structural_error(plain, fitted)
    measured = [s for s in known if s.effect not in inexact]
    # what people know of a part counts in full, as a prior does; equations and estimator are as inexact
    # as the rows
    both = columns(usual, plain.size), columns(measured, plain.size) / np.sqrt(COARSE)
    return given.in_metric(np.column_stack(both), columns_of_runs(plain, usual))


def fit_with_floor(
    runs: Sequence[Experiment], model: Model, start: Mapping[str, float], near: bool = False
) -> tuple[Problem, Fitted]:
    """The model fitted with the noise floor of its own residual.

    start: {coordinate: value}. near: start is an earlier fit, so one pass is enough.
    """
    x = {**model.start, **start}
    if not near:
        x = dict(fit(with_floor_of(runs, model, x), model, x, roughly=True).x)
    found = with_floor_of(runs, model, x)
    return found, fit(found, model, x)


def with_floor_of(runs: Sequence[Experiment], model: Model, x: Mapping[str, float]) -> Problem:
    """The problem of the runs with the noise floor of a model's residual. x: {coordinate: value}."""
    return problem(runs, [signals_left(run, model, x) for run in runs])
