"""Model structures as data: M x' = F x + G u(t - tau), y = H0 x + H1 x' (equations 9 and 10).

Several inputs are the columns of G; each input and each output may have a delay of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.identify.recording import Array, LowPass
from rover_sweep.identify.spectra import Complex

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
    which an input or output comes late, by its name. source: the text it was read from, if any.
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
        """Eigenvalues [rad/s] at a speed [m/s]."""
        mat = self.matrices(speed)
        return np.asarray(np.linalg.eigvals(np.linalg.solve(mat.m, mat.f)), dtype=np.complex128)

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
        path = (slice(None), self.outputs.index(output), self.inputs.index(source))
        y: Complex = _Solved(self.matrices(speed), w).outputs[path]
        known = (filters or {}).get(output)
        late = np.exp(-1j * w * self.delay(source, output))
        return y * late * known.response(w) if known else y * late

    def log_sensitivity(self, w: Array, speed: float, output: str, input: str | None = None) -> Complex:
        """d ln H / d theta (n_w, n_free): real part in nepers, imaginary part in rad, per parameter unit."""
        source = input or self.inputs[0]
        path = (slice(None), self.outputs.index(output), self.inputs.index(source))
        solved = _Solved(self.matrices(speed), w)
        y, step = solved.outputs[path], 1e-20
        columns = np.empty((w.size, len(self.free)), dtype=complex)
        for k, p in enumerate(self.free):
            moved = self._moved(p.name, 1j * step)
            columns[:, k] = -1j * w * (np.imag(_delay(self, moved, source, output)) / step)
            d = _imaginary(self.build({**moved, "V": speed}), step)
            if any(np.any(a) for a in (d.m, d.f, d.g, d.h0, d.h1)):
                columns[:, k] += solved.derivative(d)[path] / y
        return columns

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


class _Solved:
    """(jw M - F)^-1 at all frequencies, its outputs (n_w, ny, nu), and derivatives of them."""

    def __init__(self, mat: Matrices, w: Array) -> None:
        self.s = 1j * w[:, None, None]
        self.inverse = np.linalg.inv(self.s * mat.m - mat.f)
        self.x = self.inverse @ mat.input_matrix.astype(complex)
        self.observe = mat.h0 + self.s * mat.h1
        self.outputs: Complex = self.observe @ self.x

    def derivative(self, d: Matrices) -> Complex:
        """d outputs (n_w, ny, nu) for a change d of the matrices."""
        dx = self.inverse @ (d.input_matrix - (self.s * d.m - d.f) @ self.x)
        change: Complex = (d.h0 + self.s * d.h1) @ self.x + self.observe @ dx
        return change
