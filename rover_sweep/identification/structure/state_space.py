"""Model structures as data: M x' = F x + G u(t - tau), y = H0 x + H1 x' (equations 9 and 10).

Several inputs are the columns of G; each input and each output may have a delay of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.spectra.spectra import Complex

OUTPUTS = ("r", "ay", "vydot", "p")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a structure. value in `unit`; lower and upper bound a free one.

    tied: (name, factor), for one that always equals another parameter times a factor.
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
        """G (nx, nu), one column an input, however it was given."""
        return self.g.reshape(len(self.g), -1)


Builder = Callable[[Mapping[str, Any]], Matrices]


@dataclass(frozen=True, eq=False)
class ModelStructure:
    """A linear structure from `inputs` to `outputs`, a function of its parameters.

    build maps {parameter: value, "V": m/s} to Matrices; it must be analytic in the values, because
    sensitivities are taken by complex step. The first input is the steering angle [rad]. vydot is the
    rate of the lateral velocity at the IMU [m/s^2]. input_delays, output_delays: the parameter [s] by
    which an input or output comes late, by its name. units: of states, inputs and outputs that are not
    SI units of the usual ones; source: the text it was read from, if any.
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
        missing = [n for n in self.delays if n not in self.values]
        if missing:
            raise ValueError(f"{self.name}: the delay {missing[0]!r} is not a parameter")
        if any(p.tied for p in self.parameters):
            object.__setattr__(self, "parameters", _tied(self.parameters))

    @property
    def delays(self) -> tuple[str, ...]:
        """The parameters that are delays [s]."""
        return tuple(dict.fromkeys((*self.input_delays.values(), *self.output_delays.values())))

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that a fit may change."""
        return tuple(p for p in self.parameters if p.free)

    @property
    def values(self) -> dict[str, float]:
        """All parameter values by name."""
        return {p.name: p.value for p in self.parameters}

    def with_values(self, values: Mapping[str, float]) -> ModelStructure:
        """The structure with other parameter values; tied parameters follow the one they are tied to."""
        return replace(
            self,
            parameters=tuple(replace(p, value=float(values.get(p.name, p.value))) for p in self.parameters),
        )

    def with_free(self, names: Sequence[str]) -> ModelStructure:
        """The structure with exactly these parameters free."""
        return replace(self, parameters=tuple(replace(p, free=p.name in names) for p in self.parameters))

    def fixed(self, name: str, value: float) -> ModelStructure:
        """The structure with one parameter fixed at a value, and tied to nothing."""
        return replace(
            self,
            parameters=tuple(
                replace(p, free=False, value=value, tied=None) if p.name == name else p
                for p in self.parameters
            ),
        )

    def matrices(self, speed: float) -> Matrices:
        """Numeric matrices at a speed [m/s]."""
        return self.build({**self.values, "V": speed})

    def poles(self, speed: float) -> NDArray[np.complex128]:
        """Eigenvalues [rad/s] at a speed [m/s]; a state without a rate in M has none."""
        mat = self.matrices(speed)
        found = np.asarray(eigvals(mat.f, mat.m), dtype=np.complex128)
        return found[np.isfinite(found)]

    def delay(self, input: str, output: str) -> float:
        """Delay [s] from an input to an output."""
        return float(_delay(self, self.values, input, output))

    def response(
        self,
        w: Array,
        speed: float,
        output: str,
        filters: Mapping[str, LowPass] | None = None,
        input: str | None = None,
    ) -> Complex:
        """Frequency response (n_w,) input -> output at w [rad/s], sensor filters included.

        input: the first one, the steering angle [rad], unless named.
        """
        source = input or self.inputs[0]
        y = self._path(w, speed, output, source).response
        known = (filters or {}).get(output)
        late = np.exp(-1j * w * self.delay(source, output))
        return y * late * known.response(w) if known else y * late

    def log_sensitivity(self, w: Array, speed: float, output: str, input: str | None = None) -> Complex:
        """d ln H / d theta (n_w, n_free): real part in nepers, imaginary part in rad, per parameter unit."""
        source, step = input or self.inputs[0], 1e-20
        if not self.free:
            return np.empty((w.size, 0), dtype=complex)
        path = self._path(w, speed, output, source)
        moved = [self._moved(p.name, 1j * step) for p in self.free]
        late = np.array([np.imag(_delay(self, values, source, output)) / step for values in moved])
        change = path.derivatives([_imaginary(self.build({**v, "V": speed}), step) for v in moved])
        return change / path.response[:, None] - 1j * w[:, None] * late

    def _path(self, w: Array, speed: float, output: str, input: str) -> _Path:
        return _Path(self.matrices(speed), w, self.outputs.index(output), self.inputs.index(input))

    def _moved(self, name: str, step: complex) -> dict[str, Any]:
        """All values with one parameter moved, and those tied to it with it."""
        values: dict[str, Any] = {**self.values, name: self.values[name] + step}
        return values | {p.name: p.tied[1] * values[p.tied[0]] for p in self.parameters if p.tied}


def _tied(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """The parameters with the tied ones at their values; ValueError for a tie that leads nowhere."""
    known = {p.name: p for p in parameters}
    for p in parameters:
        if p.tied and (p.free or p.tied[0] not in known or known[p.tied[0]].tied):
            reason = "is free" if p.free else "needs a parameter that is not tied itself"
            raise ValueError(f"{p.name}, tied to {p.tied[0]}, {reason}")
    return tuple(replace(p, value=p.tied[1] * known[p.tied[0]].value) if p.tied else p for p in parameters)


def _delay(structure: ModelStructure, values: Mapping[str, Any], input: str, output: str) -> Any:
    names = structure.input_delays.get(input), structure.output_delays.get(output)
    return sum(values[n] for n in names if n)


def _imaginary(mat: Matrices, step: float) -> Matrices:
    return Matrices(*(np.imag(a) / step for a in (mat.m, mat.f, mat.g, mat.h0, mat.h1)))


class _Path:
    """The response (n_w,) of one output to one input, without delay, and derivatives of it."""

    def __init__(self, mat: Matrices, w: Array, row: int, column: int) -> None:
        self.s, self.row, self.column = 1j * w[:, None], row, column
        inverse = np.linalg.inv(self.s[:, :, None] * mat.m - mat.f)
        observe = mat.h0[row] + self.s * mat.h1[row]
        self.x = inverse @ mat.input_matrix[:, column].astype(complex)
        self.adjoint = np.einsum("wi,wij->wj", observe, inverse)
        self.response: Complex = np.einsum("wi,wi->w", observe, self.x)

    def derivatives(self, changes: Sequence[Matrices]) -> Complex:
        """d response (n_w, n) for each of n changes of the matrices."""
        m, f = (np.array([getattr(d, name) for d in changes]) for name in ("m", "f"))
        g = np.array([d.input_matrix[:, self.column] for d in changes])
        h0, h1 = (np.array([getattr(d, name)[self.row] for d in changes]) for name in ("h0", "h1"))
        force = (
            g + np.einsum("pij,wj->wpi", f, self.x) - self.s[:, :, None] * np.einsum("pij,wj->wpi", m, self.x)
        )
        return np.einsum("wi,wpi->wp", self.adjoint, force) + self.x @ h0.T + self.s * (self.x @ h1.T)
