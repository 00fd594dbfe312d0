"""How well a model predicts runs that neither its fit nor its selection used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.held_out.cost import SWEPT, frequency_responses_of, response_costs
from rover_sweep.diagnosis.problem.least_squares import fit
from rover_sweep.diagnosis.problem.noise_floor import Floor, level_of
from rover_sweep.diagnosis.problem.residuals import Problem, centred, with_floor
from rover_sweep.diagnosis.result import Fit, HeldOut, Overlay
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged
from rover_sweep.spectra.response import FrequencyResponse

UNITS = {"r": 180 / np.pi, "ay": 1 / 0.3048, "p": 180 / np.pi}  # deg/s, ft/s^2, deg/s: those of J_rms
EVERY = 2  # an overlay has every 2nd sample of the simulation
WORSE = 3.0  # standard deviations from which a channel counts as worse
JUDGED = 9.0  # sum of squares of the difference of two models, from which a run can judge them
EXPLAINABLE = 1.05  # mean square of the rows above which a share removed is computed


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A model with its fitted coordinates x {coordinate: value, SI units}."""

    model: Model
    x: Mapping[str, float]

    def log(self, run: Experiment) -> dict[str, Array]:
        """The simulated log of the run {channel: (n,)}, SI units."""
        return logged(run, self.model.structure, self.x, Sensors.of(run))


@dataclass(frozen=True, eq=False)
class HeldOutRun:
    """A held-out run with everything that does not depend on the model.

    responses: measured frequency responses {output: response} of a sweep, empty for other manoeuvres.
    """

    run: Experiment
    problem: Problem
    responses: Mapping[str, FrequencyResponse]

    @staticmethod
    def of(run: Experiment, floor: Floor, whole: FittedModel) -> HeldOutRun:
        """The run with the noise floor of the used runs, scaled to its own noise level.

        whole: a model whose residual is noise, for that level.
        """
        swept = run.kind in SWEPT
        found = frequency_responses_of(run, centred(run)) if swept else {}
        return HeldOutRun(run, with_floor([run], scaled_floor(run, floor, whole)), found)

    def residual(self, m: FittedModel) -> Array:
        """A model's whitened residual rows (n,)."""
        return self.problem.measured - self.problem.model(m.model.structure, m.x)


def scaled_floor(run: Experiment, floor: Floor, whole: FittedModel) -> Floor:
    """The floor scaled, channel by channel, to the run's noise at frequencies that are not excited.

    A slower run vibrates less. One run has too few quiet frames for a floor of its own, so the shape stays.
    """
    log = whole.log(run)
    level = level_of(run, {c: y - log[c] for c, y in centred(run).items()}, floor)
    return Floor(floor.f, {c: d * level.get(c, 1.0) for c, d in floor.density.items()}, floor.top)


def compare_held_out(held: HeldOutRun, before: FittedModel, after: FittedModel) -> HeldOut:
    """Both models on one held-out run; the mean square of a row is 1 where a model is right.

    share_removed is None where nothing is left to explain, or where the models differ too little to be
    judged.
    """
    one, two = held.residual(before), held.residual(after)
    noise = held.problem.size
    left = float(one @ one), float(two @ two)
    judged = float((one - two) @ (one - two)) > JUDGED and left[0] > EXPLAINABLE * noise
    share = (left[0] - left[1]) / (left[0] - noise) if judged else None
    return HeldOut(held.run.name, fit_of(held, before), fit_of(held, after), share)


def worse_channels(held: HeldOutRun, before: FittedModel, after: FittedModel) -> tuple[str, ...]:
    """The channels of a held-out run that the second model predicts worse, beyond the noise.


    With s, the rows by which both models differ, the difference of the sums of squares has the standard
    deviation 2 sqrt(s^T s) where either model is right.
    """
    problem = held.problem
    one, two = held.residual(before), held.residual(after)
    out = []
    for channel in dict.fromkeys(r.channel for r in problem.rows):
        a, b = (problem.part(rows, channel=channel) for rows in (one, two))
        if b @ b - a @ a > WORSE * 2.0 * float(np.linalg.norm(a - b)) + WORSE:
            out.append(channel)
    return tuple(out)


def refitted_without(effect: str, used: Problem, whole: FittedModel) -> FittedModel:
    """The full model without one of its effects, refitted to the used runs."""
    rest = whole.model.without(effect)
    found = fit(used, rest.structure, rest.free, whole.x)
    return FittedModel(rest, found.x)


def fit_of(held: HeldOutRun, m: FittedModel) -> Fit:
    """J_rms and TIC, equations (15) and (16) of the paper, without the outputs' biases; J of a sweep."""
    log, data = m.log(held.run), centred(held.run)
    errors, measured, model = [], [], []
    for c, factor in UNITS.items():
        if c in data:
            y, s = factor * data[c], factor * log[c]
            bias = np.mean(y - s)
            errors.append(np.mean((y - s - bias) ** 2))
            measured.append(np.mean(y**2))
            model.append(np.mean((s + bias) ** 2))
    rms = float(np.sqrt(np.mean(errors)))
    tic = float(rms / (np.sqrt(np.mean(measured)) + np.sqrt(np.mean(model))))
    return Fit(rms, tic, response_costs(held.run, held.responses, log) if held.responses else {})


def overlays(
    runs: Sequence[Experiment], unused: bool, before: FittedModel, after: FittedModel, floor: Floor
) -> tuple[Overlay, ...]:
    """Measured signals and both models for pictures. unused: the runs are held out; their floor is scaled."""
    out = []
    used = floor
    for run in runs:
        floor = scaled_floor(run, used, after) if unused else used
        one, two, data = before.log(run), after.log(run), centred(run)
        for c, y in data.items():
            w, left_before = spectrum_over_noise(y - one[c], run, floor, c)
            _, left_after = spectrum_over_noise(y - two[c], run, floor, c)
            k = slice(None, None, EVERY)
            noise = floor.rms(c, 0.1, min(12.0, 0.4 * run.rates[c]))
            mean1, mean2 = np.mean(y - one[c]), np.mean(y - two[c])
            out.append(
                Overlay(
                    run.name,
                    c,
                    unused,
                    run.begin + run.t[k],
                    y[k],
                    one[c][k] + mean1,
                    two[c][k] + mean2,
                    noise,
                    w,
                    left_before,
                    left_after,
                )
            )
    return tuple(out)


def spectrum_over_noise(error: Array, run: Experiment, floor: Floor, channel: str) -> tuple[Array, Array]:
    """(frequency (k,) [rad/s], power of a residual over that of the noise (k,)) of up to 24 bands."""
    f = np.fft.rfftfreq(error.size, 1 / RATE)
    power = np.abs(np.fft.rfft((error - error.mean()) * run.taper)) ** 2
    power *= 2 / (RATE * np.sum(run.taper**2))
    edges = np.geomspace(0.08, min(12.0, 0.4 * run.rates[channel]), 25)
    w, ratio = [], []
    for low, high in zip(edges, edges[1:], strict=False):
        inside = (f >= low) & (f < high)
        if inside.sum() >= 2:
            w.append(2 * np.pi * float(np.sqrt(low * high)))
            ratio.append(float(np.mean(power[inside] / floor.at(channel, f[inside]))))
    return np.array(w), np.array(ratio)
