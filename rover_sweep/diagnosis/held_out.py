"""How well a model predicts runs that neither its fit nor its selection used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.diagnosis.problem.noise_floor import TOP, Floor, level_of
from rover_sweep.diagnosis.problem.residuals import Problem, centred, signals_left, with_floor
from rover_sweep.diagnosis.result import Fit, HeldOut, TimeHistory
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import FittedModel
from rover_sweep.identification.fit import sampled, weighted_errors
from rover_sweep.identification.verify import UNITS, theil
from rover_sweep.identification.verify import Overlay as Channel
from rover_sweep.quality.coherence import responses
from rover_sweep.quality.verdict import Responses

SWEPT = ("sweep", "bias_sweep", "multisine")  # a doublet excites too little for a frequency response
SURE = 3.0  # standard deviations, from which two models differ on a run
EXPLAINABLE = 1.05  # mean square of the rows above which a share removed is computed


@dataclass(frozen=True, eq=False)
class HeldOutRun:
    """A held-out run with all data that do not depend on the model.

    responses: measured frequency responses {output: response} of a sweep, empty for other manoeuvres.
    """

    run: Experiment
    problem: Problem
    responses: Responses

    @staticmethod
    def of(run: Experiment, floor: Floor, whole: FittedModel) -> HeldOutRun:
        """The run with the noise floor of the used runs, scaled to its own noise level.

        whole: a model whose residual gives that level.
        """
        found = frequency_responses_of(run, centred(run)) if run.kind in SWEPT else {}
        return HeldOutRun(run, with_floor([run], scaled_floor(run, floor, whole)), found)

    def residual(self, m: FittedModel) -> Array:
        """A model's whitened residual rows (n,)."""
        return self.problem.residual(m.model, m.x)


def scaled_floor(run: Experiment, floor: Floor, whole: FittedModel) -> Floor:
    """The floor scaled, channel by channel, to the run's noise at frequencies that are not excited.

    A slower run vibrates less. One run has too few quiet frames for its own floor, so the shape is kept.
    """
    return floor.times(level_of(run, signals_left(run, whole.model, whole.x), floor))


def compare_held_out(held: HeldOutRun, before: FittedModel, after: FittedModel) -> HeldOut:
    """Both models on one held-out run; the mean square residual is 1 if a model is right.

    share_removed is None if no residual is left to explain, or if the models hardly differ.
    """
    one, two = held.residual(before), held.residual(after)
    noise = held.problem.size
    left = float(one @ one), float(two @ two)
    judged = float((one - two) @ (one - two)) > SURE**2 and left[0] > EXPLAINABLE * noise
    share = (left[0] - left[1]) / (left[0] - noise) if judged else None
    return HeldOut(held.run.name, fit_of(held, before), fit_of(held, after), share)


def worse_channels(held: HeldOutRun, before: FittedModel, after: FittedModel) -> tuple[str, ...]:
    """The channels of a held-out run that the second model predicts worse, beyond the noise."""
    problem = held.problem
    one, two = held.residual(before), held.residual(after)
    channels = dict.fromkeys(r.channel for r in problem.rows)
    parts = {c: (problem.part(one, channel=c), problem.part(two, channel=c)) for c in channels}
    return tuple(c for c, (a, b) in parts.items() if worse_by(a, b) > 0.0)


def worse_by(before: Array, after: Array) -> float:
    """Increase of the sum of squares from the first to the second rows (n,), beyond the noise.

    If one of the models is right, the difference of the sums of squares has the standard deviation
    2 sqrt(s^T s), s the difference of their rows.
    """
    spread = 2.0 * float(np.linalg.norm(before - after)) + 1.0
    return float(after @ after - before @ before) - SURE * spread


def fit_of(held: HeldOutRun, m: FittedModel) -> Fit:
    """J_rms and TIC (paper, equations 15 and 16) after removing mean errors; for sweeps also J."""
    run, log, data = held.run, m.log(held.run), centred(held.run)
    channels = [
        Channel(c, unit, run.t, factor * data[c], factor * (log[c] + np.mean(data[c] - log[c])))
        for c, (unit, factor) in UNITS.items()
        if c in data
    ]
    rms = float(np.sqrt(np.mean([c.j_rms**2 for c in channels])))
    return Fit(rms, theil(channels), response_costs(run, held.responses, log) if held.responses else {})


def frequency_responses_of(run: Experiment, log: Mapping[str, Array]) -> Responses:
    """Composite responses {output: response} of a log {channel: (n,)} to the run's steering."""
    return responses([recorded(run, log)])


def recorded(run: Experiment, log: Mapping[str, Array]) -> Recording:
    """Makes a recording from a log {channel: (n,)}, SI units, on the run's grid."""
    units = {"r": "rad/s", "p": "rad/s", "ay": "m/s^2", "vy": "m/s", "delta": "rad", "speed": "m/s"}
    channels = {"delta": run.steer, "speed": run.speed, **log}
    signals = {c: Signal(run.t, x, units[c], hold=False) for c, x in channels.items()}
    return Recording(run.name, signals, (float(run.t[0]), float(run.t[-1])), "other")


def response_costs(run: Experiment, measured: Responses, log: Mapping[str, Array]) -> dict[str, float]:
    """{output: J}, equation (11) of the paper, of a simulated log {channel: (n,)} in the coherent bands.

    The log passes the same composite estimator as the measured one, with the same steering, so that windows
    and leakage are the same in both. measured: responses of the recorded run; one without a usable band is
    left out.
    """
    as_sampled = {}  # at the channels' own rates
    for channel, y in log.items():
        stamps = np.arange(run.t[0], run.t[-1] + 1e-9, 1.0 / run.rates[channel])
        as_sampled[channel] = np.interp(run.t, stamps, np.interp(stamps, run.t, y))
    simulated, out = frequency_responses_of(run, as_sampled), {}
    for output, response in measured.items():
        if response.band is not None:
            data = sampled(response, response.band)
            errors = weighted_errors(data, simulated[output].at(data.w)[0])
            out[output] = float(errors @ errors)
    return out


def overlays(
    runs: Sequence[Experiment], unused: bool, before: FittedModel, after: FittedModel, floor: Floor
) -> tuple[TimeHistory, ...]:
    """Measured signals and both models for pictures. unused: the runs are held out; their floor is scaled."""
    out = []
    for run in runs:
        own = scaled_floor(run, floor, after) if unused else floor
        one, two = before.log(run), after.log(run)
        out += [overlay_of(run, c, unused, one[c], two[c], own) for c in centred(run)]
    return tuple(out)


def overlay_of(
    run: Experiment, channel: str, unused: bool, before: Array, after: Array, floor: Floor
) -> TimeHistory:
    """One measured channel and two simulations of it (n,), without their biases, at every second sample."""
    y, k = centred(run)[channel], slice(None, None, 2)
    one, two = (x + np.mean(y - x) for x in (before, after))
    w, left_before = spectrum_over_noise(y - before, run, floor, channel)
    left_after = spectrum_over_noise(y - after, run, floor, channel)[1]
    noise = floor.rms(channel, 0.1, min(TOP, 0.4 * run.rates[channel]))
    t = run.begin + run.t[k]
    return TimeHistory(run.name, channel, unused, t, y[k], one[k], two[k], noise, w, left_before, left_after)


def spectrum_over_noise(error: Array, run: Experiment, floor: Floor, channel: str) -> tuple[Array, Array]:
    """(frequency (k,) [rad/s], residual power over noise power (k,)) of up to 24 bands."""
    f = np.fft.rfftfreq(error.size, 1 / RATE)
    power = np.abs(np.fft.rfft((error - error.mean()) * run.taper)) ** 2
    power *= 2 / (RATE * np.sum(run.taper**2))
    edges = np.geomspace(0.08, min(TOP, 0.4 * run.rates[channel]), 25)
    w, ratio = [], []
    for low, high in zip(edges, edges[1:], strict=False):
        inside = (f >= low) & (f < high)
        if inside.sum() >= 2:
            w.append(2 * np.pi * float(np.sqrt(low * high)))
            ratio.append(float(np.mean(power[inside] / floor.at(channel, f[inside]))))
    return np.array(w), np.array(ratio)
