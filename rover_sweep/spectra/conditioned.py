"""Responses to one of several correlated inputs: conditioned spectra and partial coherence.

A throttle that moves with the steering and acts on the rover falsifies the simple response to the steering.
At each frequency H = Gxx^-1 Gxy. Its element for one input equals the response between that input and the
output after the part that follows the other inputs is removed from both (Bendat and Piersol 2010, chapter
7; Tischler and Remple 2012, chapter 9). The output's autospectrum is conditioned as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.spectra.response import Band, FrequencyResponse, composite_response, transformed
from rover_sweep.spectra.windowed import (
    OVERLAP_CONSTANT,
    Complex,
    Transformer,
    WindowSpectra,
    effective_averages,
)

ONE_AVERAGE = OVERLAP_CONSTANT**2  # of n_d for each independent average
CORRELATED = (
    0.5  # coherence between inputs, above which Tischler and Remple (chapter 9) advise to repeat the run
)


@dataclass(frozen=True, eq=False)
class InputSpectra:
    """Averaged spectra of one window length among several inputs and outputs, nan below 2 pi/length.

    gxx (n_w, nu, nu): conj(X_i) X_j; gxy {output: (n_w, nu)}: conj(X_i) Y; gyy {output: (n_w,)}; unit^2 s,
    scaled by 2/T_win; w (n_w,) [rad/s], length [s]. averages: n_d of `effective_averages`.
    """

    length: float
    w: Array
    inputs: tuple[str, ...]
    gxx: Complex
    gxy: Mapping[str, Complex]
    gyy: Mapping[str, Array]
    averages: float

    def responses(self, output: str) -> Complex:
        """H = Gxx^-1 Gxy (n_w, nu), the response of an output to each input, in their units."""
        h: Complex = np.einsum("wij,wj->wi", _inverse(self.gxx), self.gxy[output])
        return h

    def multiple_coherence(self, output: str) -> Array:
        """Share (n_w,) of the output's power that follows all inputs: Gyx Gxx^-1 Gxy / Gyy."""
        explained = np.einsum("wi,wi->w", self.gxy[output].conj(), self.responses(output)).real
        return np.asarray(explained / self.gyy[output])

    def input_coherence(self, input: str) -> Array:
        """Share (n_w,) of an input's power that follows the other inputs."""
        k, rest = self._split(input)
        g = self.gxx[:, k, k].real
        return np.asarray(
            1 - _without(self.gxx, rest, self.gxx[:, rest, k], self.gxx[:, rest, k], g).real / g
        )

    def conditioned(self, input: str, output: str) -> WindowSpectra:
        """The spectra input -> output with the effect of the other inputs removed from both.

        Its coherence is the partial coherence |G1y.2|^2 / (G11.2 Gyy.2). Each other input takes one
        independent average, C^2 in n_d. On correlated white noise the random error is then right within 6 %;
        without it, up to 20 % too small.
        """
        k, rest = self._split(input)
        x, y = self.gxx[:, rest, k], self.gxy[output][:, rest]
        gxx = _without(self.gxx, rest, x, x, self.gxx[:, k, k]).real
        gyy = _without(self.gxx, rest, y, y, self.gyy[output]).real
        gxy = _without(self.gxx, rest, x, y, self.gxy[output][:, k])
        left = self.averages - ONE_AVERAGE * len(rest)
        return WindowSpectra(self.length, self.w, gxx, gyy, gxy, left)

    def _split(self, input: str) -> tuple[int, list[int]]:
        k = self.inputs.index(input)
        return k, [i for i in range(len(self.inputs)) if i != k]


def _without(gxx: Complex, rest: list[int], a: Complex, b: Complex, gab: Complex | Array) -> Complex:
    """G_ab.c = G_ab - G_ac Gcc^-1 G_cb (n_w,), c the inputs `rest`; a, b (n_w, n_rest): G_ca, G_cb."""
    inverse = _inverse(gxx[:, rest][:, :, rest])
    taken = np.einsum("wi,wij,wj->w", a.conj(), inverse, b)
    return np.asarray(gab - taken, dtype=np.complex128)


def _inverse(g: Complex) -> Complex:
    """Pseudo-inverse (n_w, n, n) of input spectra, scaled by their power; inputs without power give 0."""
    usable = np.all(np.isfinite(g), axis=(1, 2))
    g = np.where(usable[:, None, None], g, np.eye(g.shape[-1]))
    power = np.sqrt(np.einsum("wii->wi", g).real)
    power[power == 0] = 1.0
    scale = power[:, :, None] * power[:, None, :]
    inverse = np.linalg.pinv(g / scale, rcond=1e-9, hermitian=True) / scale
    return np.asarray(np.where(usable[:, None, None], inverse, np.nan), dtype=np.complex128)


def input_spectra(
    runs: Sequence[Mapping[str, Signal]],
    spans: Sequence[tuple[float, float]],
    inputs: Sequence[str],
    outputs: Sequence[str],
    lengths: Sequence[float],
    w: Array,
) -> tuple[InputSpectra, ...]:
    """Averaged spectra of all inputs and outputs for each window length [s] at w [rad/s], over all runs.

    runs: {channel: signal} within the spans (start, end) [s]. Each window lies within one run. Lengths that
    leave too few averages for the number of inputs are left out. ValueError when the longest remaining window
    does not resolve the lowest w.
    """
    total = sum(end - start for start, end in spans)
    used = windows_for_inputs(lengths, spans, len(inputs))
    if not used or w[0] < 2 * np.pi / max(used) * (1 - 1e-9):
        raise ValueError(
            f"{total:g} s of runs are too short for {len(inputs)} inputs down to {w[0]:g} rad/s: drive "
            "longer runs or raise the lowest frequency"
        )
    names = (*inputs, *outputs)
    sums = [np.zeros((w.size, len(names), len(names)), dtype=complex) for _ in used]
    counts = [0] * len(used)
    for channels, span in zip(runs, spans, strict=True):
        transform = Transformer(*span, used, w)
        by_name = [transform(channels[name]) for name in names]
        for k in range(len(used)):
            z = np.stack([rows[k] for rows in by_name], axis=-1)
            counts[k] += len(z)
            sums[k] += np.einsum("nwi,nwj->wij", z.conj(), z)
    found = zip(used, sums, counts, strict=True)
    return tuple(
        _averaged(length, g, n, w, inputs, outputs, effective_averages(spans, length))
        for length, g, n in found
    )


def windows_for_inputs(
    lengths: Sequence[float], spans: Sequence[tuple[float, float]], inputs: int
) -> tuple[float, ...]:
    """The window lengths [s] that leave at least one independent average for each of the inputs."""
    return tuple(n for n in lengths if effective_averages(spans, n) >= ONE_AVERAGE * inputs * (1 - 1e-9))


def _averaged(
    length: float,
    sums: Complex,
    count: int,
    w: Array,
    inputs: Sequence[str],
    outputs: Sequence[str],
    averages: float,
) -> InputSpectra:
    scale = 2.0 / length / count * np.where(w >= 2 * np.pi / length * (1 - 1e-9), 1.0, np.nan)
    g = (scale[:, None, None] * sums).astype(complex)
    n = len(inputs)
    gxy = {o: g[:, :n, n + k] for k, o in enumerate(outputs)}
    gyy = {o: g[:, n + k, n + k].real for k, o in enumerate(outputs)}
    return InputSpectra(length, w, tuple(inputs), g[:, :n, :n], gxy, gyy, averages)


def conditioned_responses(
    runs: Sequence[Recording],
    outputs: Sequence[str],
    w: Array,
    windows: Sequence[float],
    inputs: Sequence[str],
    bands: Mapping[str, Band] | None = None,
) -> dict[str, dict[str, FrequencyResponse]]:
    """{input: {output: composite response}}, each conditioned on all other inputs, over all runs.

    The conditioned spectra of each window length form a composite like ordinary ones. coherence is the
    partial coherence; gxx and gyy are the conditioned autospectra. w (n_w,) [rad/s], windows [s]. bands:
    {output: usable band [rad/s]} of the first input, instead of the choice from the partial coherence.
    """
    channels = [
        {i: run.manoeuvre(i) for i in inputs} | {f"to {o}": transformed(run, o) for o in outputs}
        for run in runs
    ]
    names = [f"to {o}" for o in outputs]
    spectra = input_spectra(channels, [run.span for run in runs], inputs, names, windows, w)
    found: dict[str, dict[str, FrequencyResponse]] = {}
    for i in inputs:
        chosen = (bands or {}) if i == inputs[0] else {}
        units = {o: channels[0][f"to {o}"].unit for o in outputs}
        found[i] = {o: _response(spectra, i, o, (runs[0][i].unit, units[o]), chosen.get(o)) for o in outputs}
    return found


def _response(
    spectra: Sequence[InputSpectra], input: str, output: str, units: tuple[str, str], band: Band | None
) -> FrequencyResponse:
    """The composite of one pair. units: of the input and of the transformed signal."""
    parts = [s.conditioned(input, f"to {output}") for s in spectra]
    plain = composite_response(input, output, *units, parts, band)
    weight = _weights(parts)
    return replace(
        plain,
        conditioned_on=tuple(i for i in spectra[0].inputs if i != input),
        multiple_coherence=_mean(weight, [s.multiple_coherence(f"to {output}") for s in spectra]),
        input_coherence=_mean(weight, [s.input_coherence(input) for s in spectra]),
    )


def _weights(parts: Sequence[WindowSpectra]) -> Array:
    """W_i^2 (n_windows, n_w) of the composite's starting values, 0 where a window does not resolve w."""
    error = np.array([s.random_error for s in parts])
    return np.where(np.isfinite(error), (error / np.nanmin(error, axis=0)) ** -8.0, 0.0)


def _mean(weight: Array, values: Sequence[Array]) -> Array:
    usable = np.where(weight > 0, np.array(values), 0.0)
    return np.asarray(np.sum(weight * usable, axis=0) / np.sum(weight, axis=0))


def moving(runs: Sequence[Recording], channel: str) -> bool:
    """True when a channel varies within the manoeuvres, as an input must."""
    parts = [run.manoeuvre(channel).x for run in runs]
    return any(x.size and float(np.ptp(x)) > 1e-9 * float(np.max(np.abs(x))) for x in parts)


def correlated_inputs(response: FrequencyResponse) -> str | None:
    """A sentence when the input is strongly correlated with the others in the usable band, else None."""
    if response.input_coherence is None or response.band is None:
        return None
    low, high = response.band
    inside = (response.w >= low) & (response.w <= high)
    shared = float(np.mean(response.input_coherence[inside]))
    if shared <= CORRELATED:
        return None
    others = " and ".join(response.conditioned_on)
    return (
        f"{others} moves with the steering (mean coherence {shared:.2f} over {low:.2g}-{high:.3g} rad/s, "
        f"guideline <= {CORRELATED:g}), so their effects cannot be separated well: drive again with "
        f"{others} constant or moved independently"
    )
