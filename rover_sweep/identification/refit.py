"""Refits of a model to many replicates of its responses at once, by Gauss-Newton from its optimum.

The residuals are those of `identification.cost`, exact at every step: e = 20/ln 10 Re, 180/pi Im of
ln(H_replicate/H_model), weighted. The sensitivities S(x) = d ln H/dx are expanded once about the optimum,
S(x) = S_0 + sum_q x_q dS/dx_q, with x = ln(theta/theta^) of positive parameters and theta - theta^ of the
others; so a step needs no derivatives of the model. Step: (S^T W S) dx = S^T W e.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Complex, LowPass, Recording, Signal
from rover_sweep.identification.fit import PHASE_WEIGHT, POINTS, Condition, restricted
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.spectra.harmonics import CoarseTransformer, ResidualSpectra, fresh_noise
from rover_sweep.spectra.response import RISING, Band, composite, transformed, usable_band
from rover_sweep.spectra.windowed import Transformer, WindowSpectra, effective_averages

# The response of a model to the measured steering, computed in the frequency domain without step size.


RATE = 1000.0  # Hz, of the output; other times are interpolated
TOP = 8.0  # of w_max: higher frequencies do not affect the band
RETURN_TIME = 10.0  # s after the run, in which the steering returns to its start and the response decays


def forced_response(
    structure: ModelStructure,
    speed: float,
    delta: Signal,
    span: tuple[float, float],
    outputs: Sequence[str],
    w_max: float,
    filters: Mapping[str, LowPass],
) -> dict[str, Signal]:
    """Outputs {output: signal (n,)} at 1 kHz over `span` (start, end) [s], up to a constant.

    y = IFFT(H(w) FFT(delta)), up to 8 w_max [rad/s]. delta [rad] is assumed constant before the run. vydot
    is returned as its integral V_y [m/s], the measured channel. There is no delay from a step size or a held
    input, and an unstable model gives the bounded response of its frequency response.
    """
    start, end = span
    t = start + np.arange(int((end - start) * RATE) + 1) / RATE
    # less its start, extended by a smooth return to zero: periodic without a jump
    u, fade = delta.on(t), int(RETURN_TIME / 2 * RATE)
    back = (u[-1] - u[0]) * (0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade))
    u = np.concatenate((u - u[0], back, np.zeros(fade)))
    w = np.asarray(2 * np.pi * np.fft.rfftfreq(u.size, 1 / RATE), dtype=np.float64)
    used = np.flatnonzero((w > 0) & (w <= TOP * w_max))
    x = np.fft.rfft(u)[used]

    def simulated(output: str) -> Signal:
        h = structure.response(w[used], speed, output, filters)
        spectrum = np.zeros(w.size, dtype=complex)
        spectrum[used] = (h / (1j * w[used]) if output == "vydot" else h) * x
        return Signal(t, np.fft.irfft(spectrum, u.size)[: t.size], "", f"{structure.name} model")

    return {output: simulated(output) for output in outputs}


# Replicates of measured responses: the model's response to the measured steering plus generated noise,
#
# transformed with the windows and the composite of the real data.


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

    known: replicators already made for other models; this one adds its own.
    """

    def __init__(self, group: Group, condition: Condition, known: Known) -> None:
        if any(d.input != "delta" for d in condition.data):
            raise ValueError("the bootstrap needs responses to the steering only, without other inputs")
        self.condition = condition
        self.responses = {d.output: group.responses[d.output] for d in condition.data}
        first = self.responses[condition.data[0].output]
        self.w, self.windows = first.w, first.windows
        self.averages = [effective_averages([run.span for run in group.runs], n) for n in self.windows]
        keys = [(id(run), tuple(self.windows), self.w.tobytes()) for run in group.runs]
        for key, run in zip(keys, group.runs, strict=True):
            if key not in known:
                known[key] = RunReplicator(run, self.windows, self.w)
        self.runs = [known[key] for key in keys]

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
        log_model: Complex = np.asarray(np.log(np.abs(model)) + 1j * np.unwrap(np.angle(model)), complex)
        measured = self.responses[output]
        bands: tuple[Band | None, ...] = (measured.band,) * len(coherence)
        if measured.band == usable_band(measured.w, measured.coherence):  # it was not given
            bands = tuple(usable_band(self.w, g2) for g2 in coherence)
        return Replicates(output, self.w, np.log(h * rise / model), coherence, log_model, bands)


MAX_STEPS = 8  # most Gauss-Newton steps of a replicate
TINY = 1e-300  # of a positive parameter without a lower bound
CONVERGED = 1e-6  # of the cost: converged when the predicted gain of a step is smaller


def refitted_replicates(
    structure: ModelStructure, conditions: Sequence[Condition], replicates: Sequence[Sequence[Replicates]]
) -> Array:
    """theta_b (count, n_free) in parameter units, nan in rows that did not converge or lack a usable band.

    replicates: per condition, one for each response in the order of its data. Each replicate has its own
    bands and coherence weights.
    """
    parts = [(c, r) for c, responses in zip(conditions, replicates, strict=True) for r in responses]
    expansion = _Expansion(structure, parts)
    theta = np.full((len(parts[0][1].bands), len(structure.free)), np.nan)
    with_bands: dict[tuple[Band | None, ...], list[int]] = {}
    for i, bands in enumerate(zip(*(r.bands for _, r in parts), strict=True)):
        with_bands.setdefault(bands, []).append(i)
    for bands, rows in with_bands.items():
        known = [b for b in bands if b is not None]
        if len(known) == len(parts):
            theta[rows] = _refit(expansion, known, np.array(rows))
    return theta


@dataclass(frozen=True, eq=False)
class _Points:
    """One response at the n points of its fit, w (n,) rad/s, for k replicates.

    left (n,), share (n,): index and weight of linear interpolation in the replicates' grid. log_ratio (k, n)
    = ln(replicate/model); weight (k, n) of the cost; model (n,): response without the sensor's low-pass.
    """

    condition: Condition
    output: str
    w: Array
    left: np.ndarray
    share: Array
    log_ratio: Complex
    weight: Array
    model: Complex

    def between(self, y: np.ndarray) -> np.ndarray:
        """y (..., n_w) at the points, linear over log w."""
        return y[..., self.left] * (1 - self.share) + y[..., self.left + 1] * self.share


def _points(
    structure: ModelStructure, condition: Condition, r: Replicates, band: Band, rows: np.ndarray
) -> _Points:
    """The points as `cost.sampled` takes them: interpolated over log w in dB and unwrapped phase.

    `interpolation_error` corrects log_ratio: the data are interpolated from the grid, the model is exact.
    """
    w = np.geomspace(*band, POINTS)
    x, grid = np.log(w), np.log(r.w)
    left = np.clip(np.searchsorted(grid, x, "right") - 1, 0, r.w.size - 2)
    share = (x - grid[left]) / (grid[left + 1] - grid[left])
    bare = structure.response(w, condition.speed, r.output)
    known = condition.filters.get(r.output)
    exact = bare * known.response(w) if known else bare
    empty = _Points(condition, r.output, w, left, share, r.log_model, w, bare)
    interpolation_error = np.log(np.exp(empty.between(r.log_model)) / exact)
    coherence = np.clip(empty.between(r.coherence[rows]), 0.0, 1.0)
    weight = 20.0 / POINTS * (1.58 * (1.0 - np.exp(-coherence))) ** 2
    ratio = empty.between(r.log_ratio[rows]) + interpolation_error
    return _Points(condition, r.output, w, left, share, ratio, weight, bare)


def _refit(expansion: _Expansion, bands: Sequence[Band], rows: np.ndarray) -> Array:
    """theta_b (n_rows, n_free) of the replicates `rows`, which share these bands."""
    points = [
        _points(expansion.structure, c, r, b, rows) for (c, r), b in zip(expansion.parts, bands, strict=True)
    ]
    model = _PointModel(expansion, points)
    data = _stacked([p.log_ratio for p in points])
    weight = np.concatenate([np.tile(p.weight, 2) for p in points], axis=1)
    x, residual = np.zeros((rows.size, expansion.start.size)), data.copy()
    moving = np.arange(rows.size)
    for _ in range(MAX_STEPS):
        slope = model.sensitivities(x[moving])
        step, _ = _step(slope, weight[moving], residual[moving])
        # a parameter at its bound that the step would push beyond stays there, and no longer counts
        blocked = (step != 0) & (expansion.within_bounds(x[moving] + step) == x[moving])
        step, gain = _step(np.where(blocked[:, None, :], 0.0, slope), weight[moving], residual[moving])
        x[moving] = expansion.within_bounds(x[moving] + step)
        cost = np.sum(weight[moving] * residual[moving] ** 2, axis=1)
        moving = moving[~(gain <= CONVERGED * cost)]
        if not moving.size:
            break
        residual[moving] = data[moving] - model.log_change(x[moving])
    theta = expansion.theta(x)
    theta[moving] = np.nan
    return theta


def _step(slope: Array, weight: Array, residual: Array) -> tuple[Array, Array]:
    """The Gauss-Newton step (count, n_free) and its predicted decrease of the cost (count,)."""
    weighted = np.swapaxes(slope * weight[:, :, None], 1, 2)
    gradient = (weighted @ residual[..., None])[..., 0]
    normal = weighted @ slope
    ridge = 1e-12 * np.einsum("bpp->bp", normal) + 1e-30  # for a parameter without effect on the data
    normal = normal + ridge[:, :, None] * np.eye(slope.shape[2])
    step: Array = np.linalg.solve(normal, gradient[..., None])[..., 0]
    return step, np.sum(step * gradient, axis=1)


class _Expansion:
    """The model about its optimum, expanded in x (see the module's text).

    slope: S_0 (n_free, n_w) of each response on its grid; curvature: dS/dx (n_free, n_free, n_w).
    """

    def __init__(self, structure: ModelStructure, parts: Sequence[tuple[Condition, Replicates]]) -> None:
        self.structure, self.parts = structure, parts
        self.start, self.lower, self.upper = (
            np.array([(p.value, p.lower, p.upper) for p in structure.free], dtype=float).reshape(-1, 3).T
        )
        self.log = self.lower > 0  # positive parameters, fitted as logarithms
        self.slope = self._slopes(np.zeros(self.start.size))
        curvatures = [self._curvature(e) for e in np.eye(self.start.size)]
        self.curvature = [np.array([b[k] for b in curvatures]) for k in range(len(parts))]

    def theta(self, x: Array) -> Array:
        """Parameter values theta (..., n_free) at x (..., n_free)."""
        return np.where(self.log, self.start * np.exp(np.where(self.log, x, 0.0)), self.start + x)

    def within_bounds(self, x: Array) -> Array:
        """x (..., n_free), clipped to the parameters' bounds."""
        start = np.where(self.log, self.start, 1.0)
        low, high = (
            np.where(self.log, np.log(np.maximum(bound, TINY) / start), bound - self.start)
            for bound in (self.lower, self.upper)
        )
        return np.clip(x, low, high)

    def at(self, x: Array) -> ModelStructure:
        """The structure at x (n_free,)."""
        names = [p.name for p in self.structure.free]
        return self.structure.with_values(dict(zip(names, self.theta(x), strict=True)))

    def _slopes(self, x: Array) -> list[Complex]:
        """d ln H / dx (n_free, n_w) of each response."""
        structure, scale = self.at(x), np.where(self.log, self.theta(x), 1.0)
        return [(structure.log_sensitivity(r.w, c.speed, r.output) * scale).T for c, r in self.parts]

    def _curvature(self, direction: Array) -> list[Complex]:
        """Derivative of the sensitivities along one parameter, by central differences."""
        h = 1e-4 * direction * np.where(self.log, 1.0, np.abs(self.start) + 1e-3)
        pairs = zip(self._slopes(h), self._slopes(-h), strict=True)
        return [(after - before) / (2 * np.sum(h)) for after, before in pairs]


class _PointModel:
    """The model at the points of one set of bands, in [dB, weighted deg] of every response (n in total)."""

    def __init__(self, expansion: _Expansion, points: Sequence[_Points]) -> None:
        self.expansion, self.points = expansion, points
        self.slope = _stacked([p.between(s) for p, s in zip(points, expansion.slope, strict=True)]).T
        self.curvature = np.swapaxes(
            _stacked([p.between(b) for p, b in zip(points, expansion.curvature, strict=True)]), 1, 2
        )

    def sensitivities(self, x: Array) -> Array:
        """S(x) (count, n, n_free), to first order in x (count, n_free)."""
        return self.slope + np.einsum("bq,qnp->bnp", x, self.curvature)

    def log_change(self, x: Array) -> Array:
        """ln(H(x)/H(0)) (count, n) at x (count, n_free), exact; the sensors' low-passes cancel."""
        models = [self.expansion.at(row) for row in x]
        return _stacked(
            [
                np.log(np.array([m.response(p.w, p.condition.speed, p.output) for m in models]) / p.model)
                for p in self.points
            ]
        )


def _stacked(logs: Sequence[np.ndarray]) -> Array:
    """Complex logarithms as [dB, weighted deg] of every response, along the last axis."""
    parts = []
    for z in logs:
        parts += [z.real * 20 / np.log(10), np.degrees(z.imag) * np.sqrt(PHASE_WEIGHT)]
    return np.concatenate(parts, axis=-1)
