"""Cost J of a simulation against the recording, for each response, on a held-out sweep.

The simulated log passes the same composite estimator as the measured one, with the same steering, so that
windows and leakage are the same in both (equation (11) of the paper).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.identification.cost import PHASE_WEIGHT, ResponseData, sampled
from rover_sweep.quality.coherence import responses
from rover_sweep.spectra.response import FrequencyResponse
from rover_sweep.spectra.windowed import Complex

SWEPT = ("sweep", "bias_sweep", "multisine")  # a doublet excites too little for a frequency response
UNITS = {"r": "rad/s", "p": "rad/s", "ay": "m/s^2", "vy": "m/s", "delta": "rad", "speed": "m/s"}

Responses = Mapping[str, FrequencyResponse]


def frequency_responses_of(run: Experiment, log: Mapping[str, Array]) -> Responses:
    """Composite responses {output: response} of a log {channel: (n,)} to the run's steering."""
    return responses([recorded(run, log)])


def recorded(run: Experiment, log: Mapping[str, Array]) -> Recording:
    """A log {channel: (n,)}, SI units, on the run's grid as a recording of the whole run."""
    channels = {"delta": run.steer, "speed": run.speed, **log}
    signals = {c: Signal(run.t, x, UNITS[c], hold=False) for c, x in channels.items()}
    return Recording(run.name, signals, (float(run.t[0]), float(run.t[-1])), "other")


def as_sampled(run: Experiment, log: Mapping[str, Array]) -> dict[str, Array]:
    """The log {channel: (n,)} on the run's grid after sampling at the channels' own rates."""
    out = {}
    for channel, y in log.items():
        stamps = np.arange(run.t[0], run.t[-1] + 1e-9, 1.0 / run.rates[channel])
        out[channel] = np.interp(run.t, stamps, np.interp(stamps, run.t, y))
    return out


def response_costs(run: Experiment, measured: Responses, log: Mapping[str, Array]) -> dict[str, float]:
    """{output: J} of a simulated log {channel: (n,)} over the bands in which the recording is coherent.

    measured: responses of the recorded run. A response without a usable band has no J.
    """
    simulated = frequency_responses_of(run, as_sampled(run, log))
    out = {}
    for output, response in measured.items():
        if response.band is not None:
            data = sampled(response, response.band)
            out[output] = cost(data, simulated[output].at(data.w)[0])
    return out


def cost(data: ResponseData, model: Complex) -> float:
    """J of a model's complex response (n,) at the points of the measured one, equation (11) of the paper."""
    ratio = data.h / model
    errors = (20 * np.log10(np.abs(ratio))) ** 2 + PHASE_WEIGHT * np.degrees(np.angle(ratio)) ** 2
    return float(20.0 / data.w.size * np.sum(data.weight * errors))
