"""The cost of a model against measured frequency responses: residuals, their derivatives, J.

For each response, n points w_i, log spaced over its usable band (equation 11 of the paper, with its |T|
read as dB and its phase as degrees; Tischler & Remple 2012, chapter 11):

    J = (20/n) sum_i W_i [ (dB error)^2 + W_p (deg error)^2 ],  W_i = [1.58 (1 - exp(-g2_i))]^2

W_p = 0.01745 makes 7.57 deg weigh as much as 1 dB; W_i is 1 at coherence 1 and .39 at coherence .5.
With e = ln(H_data/H_model) both errors are one complex number: dB = (20/ln 10) Re e, deg = (180/pi) Im e.
The residuals are these errors times sqrt(20 W_i/n) and, for the phase, sqrt(W_p); so their squares sum to
J. Their derivatives follow from d ln H/d theta, which the structure gives by complex step, with the sign
reversed because the model is subtracted. A fit over several responses and speeds minimises the sum of J.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.spectra.response import Band, FrequencyResponse
from rover_sweep.spectra.windowed import Complex

PHASE_WEIGHT = 0.01745  # W_p: 7.57 deg weigh as much as 1 dB (W_g = 1)
POINTS = 20  # log-spaced points a response


@dataclass(frozen=True, eq=False)
class ResponseData:
    """The points of one response in the cost: w (n,) rad/s, h (n,) in output unit per input unit.

    coherence (n,): 0..1, the partial coherence where another input was taken out.
    """

    output: str
    w: Array
    h: Complex
    coherence: Array
    input: str = "delta"

    @property
    def label(self) -> str:
        """`output` for the steering input, "output/input" for another one."""
        return self.output if self.input == "delta" else f"{self.output}/{self.input}"

    @property
    def weight(self) -> Array:
        """W_gamma (n,) = [1.58 (1 - exp(-g2))]^2 of equation (11)."""
        return (1.58 * (1.0 - np.exp(-self.coherence))) ** 2


@dataclass(frozen=True, eq=False)
class Condition:
    """Responses at one speed [m/s]. filters: known low-passes of the sensors, by output."""

    speed: float
    data: tuple[ResponseData, ...]
    filters: Mapping[str, LowPass]


def sampled(response: FrequencyResponse, band: Band, points: int = POINTS) -> ResponseData:
    """`points` log-spaced points of a measured response within a band (low, high) [rad/s]."""
    w = np.geomspace(*band, points)
    h, coherence = response.at(w)
    return ResponseData(response.output, w, h, np.clip(coherence, 0.0, 1.0), response.input)


def residuals(structure: ModelStructure, condition: Condition) -> dict[str, Array]:
    """Weighted residuals (2n,) of each response: n in dB, then n in deg; their squares sum to its J."""
    out = {}
    for data in condition.data:
        model = structure.response(data.w, condition.speed, data.output, condition.filters, data.input)
        out[data.label] = weighted_errors(data, model)
    return out


def weighted_errors(data: ResponseData, model: Complex) -> Array:
    """Residuals (2n,) of a model's complex response (n,) at the points of a measured one."""
    ratio = data.h / model
    scale = np.sqrt(20.0 / data.w.size * data.weight)
    db = 20 * np.log10(np.abs(ratio))
    deg = np.degrees(np.angle(ratio)) * np.sqrt(PHASE_WEIGHT)
    return np.concatenate((scale * db, scale * deg))


def jacobian(structure: ModelStructure, condition: Condition) -> Array:
    """d residuals / d theta (2n per response, n_free), responses in the order of `condition.data`."""
    blocks = []
    for data in condition.data:
        s = structure.log_sensitivity(data.w, condition.speed, data.output, data.input)
        scale = np.sqrt(20.0 / data.w.size * data.weight)[:, None]
        deg = np.degrees(s.imag) * np.sqrt(PHASE_WEIGHT)
        blocks += [-scale * s.real * 20 / np.log(10), -scale * deg]
    return np.concatenate(blocks)


def costs(structure: ModelStructure, conditions: Sequence[Condition]) -> dict[str, float]:
    """J of each response, equation (11), averaged over the conditions."""
    values: dict[str, list[float]] = {}
    for condition in conditions:
        for label, r in residuals(structure, restricted(condition, structure)).items():
            values.setdefault(label, []).append(float(r @ r))
    return {label: float(np.mean(j)) for label, j in values.items()}


def restricted(condition: Condition, structure: ModelStructure) -> Condition:
    """The condition with only the responses that the structure has; ValueError when it has none of them."""
    kept = tuple(d for d in condition.data if d.output in structure.outputs and d.input in structure.inputs)
    if not kept:
        raise ValueError(
            f"{structure.name} has none of the responses {[d.label for d in condition.data]}: outputs "
            f"{structure.outputs}, inputs {structure.inputs}"
        )
    return Condition(condition.speed, kept, condition.filters)
