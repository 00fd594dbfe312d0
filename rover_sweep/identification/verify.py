"""Time-domain verification on a run that was not fitted: J_rms and TIC, equations (15), (16) of the paper.

(Tischler & Remple 2012, chapter 14.) The model is driven by the measured input. Constant biases of the state
derivatives and of the outputs are unknown; they enter linearly, so least squares solves them first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from rover_sweep.data.recording import Array, LowPass, Recording, drawing
from rover_sweep.data.results import PlainNumbers, ShortTable, Shown, plain_number
from rover_sweep.identification.state_space import ModelStructure, held_input

UNITS = {"r": ("deg/s", 180 / np.pi), "ay": ("ft/s^2", 1 / 0.3048), "p": ("deg/s", 180 / np.pi)}
RATE = 400.0  # Hz, of the simulation
DIVERGED = 1e9  # SI units: limit of a diverging output, so that J_rms is finite


@dataclass(frozen=True, eq=False)
class Overlay:
    """One channel of a verification in the units of J_rms: t [s], measured and model (n,)."""

    channel: str
    unit: str
    t: Array
    measured: Array
    model: Array

    @property
    def j_rms(self) -> float:
        """RMS of the error."""
        return float(np.sqrt(np.mean((self.measured - self.model) ** 2)))

    @property
    def tic(self) -> float:
        """Theil inequality coefficient of this channel."""
        return theil([self])


@dataclass(frozen=True, eq=False, repr=False)
class Verification(PlainNumbers, Shown):
    """The prediction of one run at `speed` [m/s]: j_rms over deg/s and ft/s^2, tic from 0 (perfect) to 1.

    state_biases [state unit per s] and output_biases [SI units]: solved by least squares.
    """

    run: str
    speed: float
    overlays: tuple[Overlay, ...]
    state_biases: Mapping[str, float]
    output_biases: Mapping[str, float]

    @property
    def j_rms(self) -> float:
        """sqrt(sum e^T W e / (n_t n_o)), equation (15), with W = 1 in deg/s and ft/s^2."""
        return float(np.sqrt(np.mean([o.j_rms**2 for o in self.overlays])))

    @property
    def tic(self) -> float:
        """Theil inequality coefficient over all channels, equation (16)."""
        return theil(self.overlays)

    def plot(self, axes: Any = None) -> Any:
        """Draws measured and predicted channels; returns matplotlib axes (channels,), or those given."""
        return drawing("draw_verification")(self, "model", axes)

    def table(self) -> ShortTable:
        """J_rms and TIC of each channel and of all."""
        rows = [(o.channel, o.unit, plain_number(o.j_rms, 3), plain_number(o.tic, 2)) for o in self.overlays]
        rows.append(("all", "", plain_number(self.j_rms, 3), plain_number(self.tic, 2)))
        title = f"verification on {self.run} at {self.speed:.2f} m/s"
        return ShortTable(title, ("channel", "unit", "J_rms", "TIC"), tuple(rows))


def theil(overlays: Sequence[Overlay]) -> float:
    """TIC = RMS(e) / (RMS(y) + RMS(y^)), equation (16)."""

    def rms(parts: list[Array]) -> float:
        return float(np.sqrt(np.mean([np.mean(x**2) for x in parts])))

    error = rms([o.measured - o.model for o in overlays])
    return error / (rms([o.measured for o in overlays]) + rms([o.model for o in overlays]))


def simulated_outputs(
    structure: ModelStructure, speed: float, u: Array, rate: float, filters: Mapping[str, LowPass]
) -> dict[str, Array]:
    """{output: (n,)} in SI units of the model from rest, driven by u, held between samples.

    u: the steering angle (n,) [rad] or all inputs (n, nu), at `rate` [Hz]; speed [m/s]. Delays and the known
    low-passes of the sensors, by output, are applied.
    """
    columns = dict(zip(structure.inputs, u.reshape(len(u), -1).T, strict=True))
    inputs = [_delayed(x, structure.delay(i), rate) for i, x in columns.items()]
    system = structure.matrices(speed).state_space()
    found = _outputs(structure, system, np.column_stack(inputs), rate, filters)
    return {o: _delayed(y, structure.delay(o), rate) for o, y in found.items()}


def _delayed(x: Array, delay: float, rate: float) -> Array:
    """The signal (n,) delayed [s]."""
    k = np.arange(x.size)
    return np.interp(k - delay * rate, k, x) if delay else x


def _outputs(
    structure: ModelStructure,
    system: tuple[Array, Array, Array, Array],
    u: Array,
    rate: float,
    filters: Mapping[str, LowPass],
) -> dict[str, Array]:
    """{output: (n,)} of (A, B, C, D) from rest, with u (n, nu) held between samples, and its low-passes."""
    a, b, c, d = system
    with np.errstate(over="ignore", invalid="ignore"):
        step, pushed = held_input(a / rate, b / rate, 1.0)
        driven, x = u @ pushed.T, np.zeros((len(u), len(a)))
        for k in range(1, len(u)):
            x[k] = step @ x[k - 1] + driven[k - 1]
        y = x @ c.T + u @ d.T
    y = np.clip(np.nan_to_num(y, nan=DIVERGED), -DIVERGED, DIVERGED)
    return {name: _filtered(y[:, i], rate, filters.get(name)) for i, name in enumerate(structure.outputs)}


def _filtered(y: Array, rate: float, low_pass: LowPass | None) -> Array:
    """y (n,) through the discrete filter (Tustin's rule); padded by zeros until its response has ended."""
    if low_pass is None:
        return y
    size = next_fast_len(y.size + int(6.0 * rate / low_pass.cutoff_hz), real=True)
    w = np.linspace(0.0, np.pi, size // 2 + 1) * (2 * (size // 2) / size)  # rad per sample
    warped = 2.0 * rate * np.tan(np.minimum(0.5 * w, 0.5 * np.pi - 1e-9))
    return irfft(rfft(y, size) * low_pass.response(warped), size)[: y.size]


def verify(
    structure: ModelStructure,
    run: Recording,
    channels: Sequence[str] = ("r", "ay", "p"),
    filters: Mapping[str, LowPass] | None = None,
) -> Verification:
    """Compares the model, driven by the run's inputs at its mean speed, with the measurements.

    channels: outputs to compare, where recorded. filters: default the known filters of the run. A further
    input that was not recorded is taken as constant. ValueError when there is no channel to compare.
    """
    low_passes = run.filters if filters is None else filters
    used = [c for c in channels if c in structure.outputs and c in run]
    if not used:
        raise ValueError(
            f"no channel of {tuple(channels)} is both an output of {structure.name} and recorded"
        )
    start, end = run.span
    grid = start + np.arange(int((end - start) * RATE) + 1) / RATE
    speed = run.mean_speed
    driven = np.zeros((grid.size, len(structure.inputs)))
    for k, name in enumerate(structure.inputs):
        if name in run or name == "delta":  # each input from its value at the start
            x = run[name].on(grid)
            driven[:, k] = x - np.median(x[: max(int(0.2 * RATE), 1)])
    model = simulated_outputs(structure, speed, driven, RATE, low_passes)
    mat = structure.matrices(speed)
    a, _, c, _ = mat.state_space()
    ones, pushes = np.ones((grid.size, 1)), np.eye(len(a))  # a constant unit bias of each state derivative
    unit = [
        _outputs(structure, (a, b[:, None], c, mat.h1 @ b[:, None]), ones, RATE, low_passes) for b in pushes
    ]
    return _solved(structure, run, used, grid, model, unit, speed)


def _solved(
    structure: ModelStructure,
    run: Recording,
    used: Sequence[str],
    grid: Array,
    model: dict[str, Array],
    unit: list[dict[str, Array]],
    speed: float,
) -> Verification:
    signals = {c: run.manoeuvre(c) for c in used}
    rows, errors = [], []
    for k, c in enumerate(used):
        scale, t = UNITS[c][1] / np.sqrt(signals[c].t.size), signals[c].t
        offsets = np.zeros((t.size, len(used)))
        offsets[:, k] = 1.0
        states = np.column_stack([np.interp(t, grid, u[c]) for u in unit])
        rows.append(scale * np.column_stack((states, offsets)))
        errors.append(scale * (signals[c].x - np.interp(t, grid, model[c])))
    bias = np.linalg.lstsq(np.concatenate(rows), np.concatenate(errors), rcond=1e-8)[0]
    overlays = []
    for c, row, error in zip(used, rows, errors, strict=True):
        unit_name, factor = UNITS[c]
        measured = factor * signals[c].x
        left = (error - row @ bias) * np.sqrt(error.size)
        overlays.append(Overlay(c, unit_name, signals[c].t, measured, measured - left))
    n = len(unit)
    return Verification(
        run.name,
        speed,
        tuple(overlays),
        dict(zip(structure.states, map(float, bias[:n]), strict=True)),
        dict(zip(used, map(float, bias[n:]), strict=True)),
    )
