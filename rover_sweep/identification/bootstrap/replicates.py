"""Replicates of measured responses: the model's response to the measured steering plus generated noise,

transformed with the windows and the composite of the real data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.identification.bootstrap.forced_response import forced_response
from rover_sweep.identification.cost import Condition, restricted
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.spectra.noise import CoarseTransformer, ResidualSpectra, fresh_noise
from rover_sweep.spectra.response import RISING, Band, FrequencyResponse, composite, transformed, usable_band
from rover_sweep.spectra.windowed import Complex, Transformer, WindowSpectra, effective_averages

NOISE_MARGIN = 1.15  # noise reaches to this times the highest frequency, plus 4 bins of the shortest window


@dataclass(frozen=True, eq=False)
class Replicates:
    """Replicates of one output at w (n_w,) rad/s: log_ratio (count, n_w) = ln(replicate/model).

    coherence (count, n_w); log_model (n_w,): ln of the model's response, phase unwrapped; bands: usable band
    of each replicate [rad/s], None where it has none.
    """

    output: str
    w: Array
    log_ratio: Complex
    coherence: Array
    log_model: Complex
    bands: tuple[Band | None, ...]


class RunReplicator:
    """One run: its windows, the transforms of its steering, and other terms shared by all models.

    windows: lengths [s]; w (n_w,) rad/s.
    """

    def __init__(self, run: Recording, windows: Sequence[float], w: Array) -> None:
        self.run, self.w = run, w
        self.transform = Transformer(*run.span, windows, w)
        self.steering = self.transform(run.manoeuvre("delta"))
        self.w_top = NOISE_MARGIN * float(w[-1]) + 4 * 2 * np.pi / min(windows)
        self.residual_spectra = ResidualSpectra(run.span, self.w_top)
        self.coarse = CoarseTransformer(run.span, self.transform.windows, w, self.w_top)

    def spectra(
        self, structure: ModelStructure, condition: Condition, count: int, rng: np.random.Generator
    ) -> list[tuple[Array, Array, Complex]]:
        """Per window length, sums over windows: |X|^2 (n_w,), |Y|^2, conj(X) Y (count, n_outputs, n_w)."""
        outputs = [d.output for d in condition.data]
        answers, residuals = self._responses_and_residuals(structure, condition, outputs)
        noise = fresh_noise(
            self.residual_spectra(residuals),
            self.coarse.t,
            self.w_top,
            count,
            [o == "p" for o in outputs],
            rng,
        )
        made = self.coarse(noise.reshape(-1, noise.shape[-1]))
        shape = (count, len(outputs), self.w.size)
        model = [np.array(parts).swapaxes(0, 1) for parts in zip(*map(self.transform, answers), strict=True)]
        return [
            _sums(x, y, n.reshape(len(x), *shape)) for x, y, n in zip(self.steering, model, made, strict=True)
        ]

    def _responses_and_residuals(
        self, structure: ModelStructure, condition: Condition, outputs: Sequence[str]
    ) -> tuple[list[Signal], list[Signal]]:
        """The model's responses as signals to transform, and the residuals of the measured channels."""
        run, w_max = self.run, float(self.w[-1])
        answers = forced_response(
            structure, condition.speed, run.manoeuvre("delta"), run.span, outputs, w_max, condition.filters
        )
        made, residuals = [], []
        for output in outputs:
            channel = "vy" if output == "vydot" else output
            measured = run.manoeuvre(channel)
            y = answers[output].on(measured.t)
            residuals.append(replace(measured, x=measured.x - y))
            copy = replace(run, channels={**run.channels, channel: replace(measured, x=y)})
            made.append(transformed(copy, output))
        return made, residuals


def _sums(x: Complex, y: Complex, noise: NDArray[np.complex64]) -> tuple[Array, Array, Complex]:
    """Sums over the windows of |X|^2, |Y + noise|^2 and conj(X) (Y + noise).

    x (n_windows, n_w), y (n_windows, n_outputs, n_w), noise (n_windows, count, n_outputs, n_w).
    """
    power = np.zeros(noise.shape[1:])
    cross = np.zeros(noise.shape[1:], dtype=complex)
    mirrored, short = x.conj().astype(np.complex64), y.astype(np.complex64)
    for xs, ys, ns in zip(mirrored, short, noise, strict=True):
        both = ys + ns
        power += both.real**2 + both.imag**2
        cross += xs * both
    return np.sum(np.abs(x) ** 2, axis=0), power, cross


Known = dict[tuple[int, tuple[float, ...], bytes], RunReplicator]  # by run, windows and frequencies


class GroupReplicator:
    """The runs of one speed: generates replicates of the fitted responses for any model.

    known: replicators that other models' responses have made already, and which this one adds to.
    """

    def __init__(self, group: Group, condition: Condition, known: Known) -> None:
        if any(d.input != "delta" for d in condition.data):
            raise ValueError("the bootstrap needs responses to the steering only, without other inputs")
        self.condition = condition
        self.responses = {d.output: group.responses[d.output] for d in condition.data}
        first = self.responses[condition.data[0].output]
        self.w, self.windows = first.w, first.windows
        self.averages = [effective_averages([run.span for run in group.runs], n) for n in self.windows]
        self.runs = [self._of(run, known) for run in group.runs]

    def _of(self, run: Recording, known: Known) -> RunReplicator:
        key = (id(run), tuple(self.windows), self.w.tobytes())
        if key not in known:
            known[key] = RunReplicator(run, self.windows, self.w)
        return known[key]

    def __call__(
        self, structure: ModelStructure, count: int, rng: np.random.Generator
    ) -> tuple[Replicates, ...]:
        """`count` replicates of each response that the structure has, in the order of the condition."""
        condition = restricted(self.condition, structure)
        per_run = [run.spectra(structure, condition, count, rng) for run in self.runs]
        spectra = [self._averaged(i, [parts[i] for parts in per_run]) for i in range(len(self.windows))]
        flat = composite(spectra)
        xx, yy = (g.reshape(count, -1, self.w.size) for g in flat[:2])
        xy = flat[2].reshape(count, -1, self.w.size)
        coherence = np.abs(xy) ** 2 / (xx * yy)
        return tuple(
            self._replicates(data.output, structure, xy[:, k] / xx[:, k], coherence[:, k])
            for k, data in enumerate(condition.data)
        )

    def _averaged(self, i: int, parts: Sequence[tuple[Array, Array, Complex]]) -> WindowSpectra:
        """Spectra of window length i, the axes (replicate, output, w) flattened to one for `composite`."""
        length, count = self.windows[i], sum(run.transform.windows[i][0].size for run in self.runs)
        resolved = self.w >= 2 * np.pi / length * (1 - 1e-9)
        scale = 2.0 / length / count * np.where(resolved, 1.0, np.nan)
        yy = scale * sum(p[1] for p in parts)
        xx = np.broadcast_to(scale * sum(p[0] for p in parts), yy.shape)
        xy = np.asarray(scale * sum(p[2] for p in parts), dtype=np.complex128)
        return WindowSpectra(
            length,
            np.broadcast_to(self.w, yy.shape).ravel(),
            xx.ravel(),
            yy.ravel(),
            xy.ravel(),
            averages=self.averages[i],
        )

    def _replicates(self, output: str, structure: ModelStructure, h: Complex, coherence: Array) -> Replicates:
        rise = 1j * self.w if output in RISING else 1.0
        model = structure.response(self.w, self.condition.speed, output, self.condition.filters)
        log_model = np.log(np.abs(model)) + 1j * np.unwrap(np.angle(model))
        bands = self._bands(self.responses[output], coherence)
        return Replicates(output, self.w, np.log(h * rise / model), coherence, log_model, bands)

    def _bands(self, measured: FrequencyResponse, coherence: Array) -> tuple[Band | None, ...]:
        """Usable band of each replicate from its coherence (count, n_w); the data's band if it was given."""
        if measured.band != usable_band(measured.w, measured.coherence):
            return (measured.band,) * len(coherence)
        return tuple(usable_band(self.w, g2) for g2 in coherence)
