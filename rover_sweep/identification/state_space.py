"""Model structures M x' = F x + G u(t - tau), y = H0 x + H1 x' (equations 9 and 10 of the paper).

Each input is a column of G; each input and each output may have its own delay. With s = jw the response and,
for a parameter theta that changes the matrices by dM, dF, dG, dH0, dH1, its exact derivative are

    H = (H0 + s H1) X,  X = (s M - F)^-1 G,  both times exp(-s tau)
    dH = (H0 + s H1) (s M - F)^-1 (dG + dF X - s dM X) + (dH0 + s dH1) X

The changes of the matrices come by complex step (Squire and Trapp 1998): dF = Im F(theta + jh)/h with
h = 1e-20, free of rounding errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals, expm

from rover_sweep.data.recording import Array, Complex, LowPass


@dataclass(frozen=True)
class Parameter:
    """A parameter of a structure. value, lower and upper bound in `unit`; bounds apply to free ones.

    tied: (name, factor) for a parameter that always equals another one times a factor.
    """

    name: str
    unit: str
    value: float
    free: bool = False
    lower: float = -np.inf
    upper: float = np.inf
    meaning: str = ""
    tied: tuple[str, float] | None = None


@dataclass(frozen=True, eq=False)
class Matrices:
    """M (nx, nx), F (nx, nx), G (nx,) or (nx, nu), H0 (ny, nx), H1 (ny, nx); SI units, ISO axes."""

    m: NDArray[Any]
    f: NDArray[Any]
    g: NDArray[Any]
    h0: NDArray[Any]
    h1: NDArray[Any]

    @property
    def input_matrix(self) -> NDArray[Any]:
        """G (nx, nu), one column for each input."""
        return self.g.reshape(len(self.g), -1)

    def state_space(self) -> tuple[Array, Array, Array, Array]:
        """A (nx, nx), B (nx, nu), C (ny, nx), D (ny, nu) of x' = A x + B u, y = C x + D u, without delays."""
        a = np.linalg.solve(self.m, self.f)
        b = np.linalg.solve(self.m, self.input_matrix.astype(float))
        return a, b, self.h0 + self.h1 @ a, self.h1 @ b


def held_input(a: Array, b: Array, time: float) -> tuple[Array, Array]:
    """exp(a t) (nx, nx) and its integral times b (nx, nu), for an input held for `time` [s]."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    moved = expm(block * time)
    return moved[:n, :n], moved[:n, n:]


Builder = Callable[[Mapping[str, Any]], Matrices]
STEP = 1e-20  # of the complex step


@dataclass(frozen=True, eq=False)
class ModelStructure:
    """A linear structure from `inputs` to `outputs`, a function of its parameters.

    build: maps {parameter: value, "V": speed in m/s} to Matrices; analytic, for the complex step. The first
    input is the steering angle [rad]. Outputs at the IMU: r [rad/s], ay [m/s^2], vydot [m/s^2] (rate of the
    lateral velocity), p [rad/s]. input_delays, output_delays: {input or output: parameter that is its delay
    [s]}. units: of further states, inputs and outputs; source: the TOML text it was read from, if any.
    """

    name: str
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    build: Builder
    reference: str
    inputs: tuple[str, ...] = ("delta",)
    input_delays: Mapping[str, str] = field(default_factory=lambda: {"delta": "tau"})
    output_delays: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    source: str = ""

    def __post_init__(self) -> None:
        names = {p.name for p in self.parameters}  # not `values`, which are kept: ties may change them below
        missing = [n for n in self.delays if n not in names]
        if missing:
            raise ValueError(f"{self.name}: the delay {missing[0]!r} is not a parameter")
        if any(p.tied for p in self.parameters):
            object.__setattr__(self, "parameters", _tied(self.parameters))

    @property
    def delays(self) -> tuple[str, ...]:
        """Names of the parameters that are delays [s]."""
        return tuple(dict.fromkeys((*self.input_delays.values(), *self.output_delays.values())))

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that a fit changes, in the order of all (n_free,) arrays."""
        return tuple(p for p in self.parameters if p.free)

    @property
    def values(self) -> dict[str, float]:
        """All parameter values by name."""
        return dict(self._values)

    @cached_property
    def _values(self) -> dict[str, float]:
        return {p.name: p.value for p in self.parameters}

    def with_values(self, values: Mapping[str, float]) -> ModelStructure:
        """The structure with other parameter values; tied parameters follow the one they are tied to."""
        changed = (
            replace(p, value=float(values[p.name])) if p.name in values else p for p in self.parameters
        )
        return replace(self, parameters=tuple(changed))

    def with_free(self, names: Sequence[str]) -> ModelStructure:
        """The structure with exactly these parameters free."""
        return replace(self, parameters=tuple(replace(p, free=p.name in names) for p in self.parameters))

    def fixed(self, name: str, value: float) -> ModelStructure:
        """The structure with one parameter fixed at a value, and no longer tied."""
        return replace(
            self,
            parameters=tuple(
                replace(p, free=False, value=value, tied=None) if p.name == name else p
                for p in self.parameters
            ),
        )

    def matrices(self, speed: float) -> Matrices:
        """Matrices as numbers at a speed [m/s]."""
        return self.build({**self.values, "V": speed})

    def poles(self, speed: float) -> NDArray[np.complex128]:
        """Finite eigenvalues of (F, M) (n,) [rad/s] at a speed [m/s]."""
        mat = self.matrices(speed)
        found = np.asarray(eigvals(mat.f, mat.m), dtype=np.complex128)
        return found[np.isfinite(found)]

    def delay(self, *places: str) -> float:
        """Sum of the delays [s] of the named inputs and outputs."""
        return float(_delay(self, self.values, *places))

    def response(
        self,
        w: Array,
        speed: float,
        output: str,
        filters: Mapping[str, LowPass] | None = None,
        input: str | None = None,
    ) -> Complex:
        """Frequency response (n_w,) input -> output at w (n_w,) [rad/s], output unit per input unit.

        speed [m/s]; filters: known low-passes of the sensors, by output. input: default the steering angle.
        """
        source = input or self.inputs[0]
        y = self._path(w, speed, output, source).response
        known = (filters or {}).get(output)
        late = np.exp(-1j * w * self.delay(source, output))
        return y * late * known.response(w) if known else y * late

    def log_sensitivity(self, w: Array, speed: float, output: str, input: str | None = None) -> Complex:
        """d ln H / d theta (n_w, n_free) at w (n_w,) [rad/s]: nepers + j rad, per parameter unit.

        Low-passes of sensors do not change it.
        """
        source, speed = input or self.inputs[0], float(speed)
        if not self.free:
            return np.empty((w.size, 0), dtype=complex)
        path = self._path(w, speed, output, source)
        late = np.array([np.imag(_delay(self, values, source, output)) / STEP for values in self._moved])
        if speed not in self._changes:  # the same for all outputs
            built = [self.build({**values, "V": speed}) for values in self._moved]
            self._changes[speed] = [
                Matrices(*(np.imag(a) / STEP for a in (b.m, b.f, b.g, b.h0, b.h1))) for b in built
            ]
        change = path.derivatives(self._changes[speed])
        return change / path.response[:, None] - 1j * w[:, None] * late

    def _path(self, w: Array, speed: float, output: str, input: str) -> _Path:
        return _Path(self.matrices(speed), w, self.outputs.index(output), self.inputs.index(input))

    @cached_property
    def _moved(self) -> list[dict[str, Any]]:
        """All values with one free parameter changed by a complex step, and those tied to it, for each."""
        moved = []
        for changed in self.free:
            values: dict[str, Any] = {**self.values, changed.name: changed.value + 1j * STEP}
            moved.append(values | {p.name: p.tied[1] * values[p.tied[0]] for p in self.parameters if p.tied})
        return moved

    @cached_property
    def _changes(self) -> dict[float, list[Matrices]]:
        """{speed: derivatives of the matrices with respect to the free parameters}, as they are needed."""
        return {}


def _tied(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """The parameters with values for the tied ones; ValueError for a tie to an unknown or tied parameter."""
    known = {p.name: p for p in parameters}
    for p in parameters:
        if p.tied and (p.free or p.tied[0] not in known or known[p.tied[0]].tied):
            reason = (
                "cannot be free"
                if p.free
                else "must be tied to a parameter that exists and is not tied itself"
            )
            raise ValueError(f"{p.name}, tied to {p.tied[0]}, {reason}")
    return tuple(replace(p, value=p.tied[1] * known[p.tied[0]].value) if p.tied else p for p in parameters)


def _delay(structure: ModelStructure, values: Mapping[str, Any], *places: str) -> Any:
    late = {**structure.output_delays, **structure.input_delays}
    return sum(values[late[place]] for place in places if place in late)


class _Path:
    """The response H (n_w,) of one output to one input, without delay, and its derivatives."""

    def __init__(self, mat: Matrices, w: Array, row: int, column: int) -> None:
        self.s, self.row, self.column = 1j * w[:, None], row, column
        inverse = np.linalg.inv(self.s[:, :, None] * mat.m - mat.f)
        observe = mat.h0[row] + self.s * mat.h1[row]
        self.x = inverse @ mat.input_matrix[:, column].astype(complex)
        self.adjoint = np.einsum("wi,wij->wj", observe, inverse)
        self.response: Complex = np.einsum("wi,wi->w", observe, self.x)

    def derivatives(self, changes: Sequence[Matrices]) -> Complex:
        """dH (n_w, n) for n changes of the matrices."""
        m, f = (np.array([getattr(d, name) for d in changes]) for name in ("m", "f"))
        g = np.array([d.input_matrix[:, self.column] for d in changes])
        h0, h1 = (np.array([getattr(d, name)[self.row] for d in changes]) for name in ("h0", "h1"))
        force = (
            g + np.einsum("pij,wj->wpi", f, self.x) - self.s[:, :, None] * np.einsum("pij,wj->wpi", m, self.x)
        )
        return np.einsum("wi,wpi->wp", self.adjoint, force) + self.x @ h0.T + self.s * (self.x @ h1.T)
