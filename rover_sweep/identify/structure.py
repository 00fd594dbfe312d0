"""Model structures as data: M x' = F x + G u(t - tau), y = H0 x + H1 x' (equations 9 and 10)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.identify.recording import Array, LowPass
from rover_sweep.identify.spectra import Complex

OUTPUTS = ("r", "ay", "vydot", "p")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a structure. value in `unit`; lower and upper bound a free one."""

    name: str
    unit: str
    value: float
    free: bool = False
    lower: float = -np.inf
    upper: float = np.inf
    meaning: str = ""


@dataclass(frozen=True, eq=False)
class Matrices:
    """M (nx, nx), F (nx, nx), G (nx,), H0 (ny, nx), H1 (ny, nx); SI units, ISO axes."""

    m: NDArray[Any]
    f: NDArray[Any]
    g: NDArray[Any]
    h0: NDArray[Any]
    h1: NDArray[Any]


Builder = Callable[[Mapping[str, Any]], Matrices]


@dataclass(frozen=True, eq=False)
class ModelStructure:
    """A linear structure from steering angle [rad] to `outputs`, a function of its parameters.

    build maps {parameter: value, "V": m/s} to Matrices; it must be analytic in the values, because
    sensitivities are taken by complex step. Parameter "tau" [s] delays the input. vydot is the rate
    of the lateral velocity at the IMU [m/s^2].
    """

    name: str
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    build: Builder
    reference: str

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that a fit may change."""
        return tuple(p for p in self.parameters if p.free)

    @property
    def values(self) -> dict[str, float]:
        """All parameter values by name."""
        return {p.name: p.value for p in self.parameters}

    def with_values(self, values: Mapping[str, float]) -> ModelStructure:
        """The structure with other parameter values."""
        return replace(
            self,
            parameters=tuple(replace(p, value=float(values.get(p.name, p.value))) for p in self.parameters),
        )

    def with_free(self, names: Sequence[str]) -> ModelStructure:
        """The structure with exactly these parameters free."""
        return replace(self, parameters=tuple(replace(p, free=p.name in names) for p in self.parameters))

    def fixed(self, name: str, value: float) -> ModelStructure:
        """The structure with one parameter fixed at a value."""
        return replace(
            self,
            parameters=tuple(
                replace(p, free=False, value=value) if p.name == name else p for p in self.parameters
            ),
        )

    def matrices(self, speed: float) -> Matrices:
        """Numeric matrices at a speed [m/s]."""
        return self.build({**self.values, "V": speed})

    def poles(self, speed: float) -> NDArray[np.complex128]:
        """Eigenvalues [rad/s] at a speed [m/s]."""
        mat = self.matrices(speed)
        return np.asarray(np.linalg.eigvals(np.linalg.solve(mat.m, mat.f)), dtype=np.complex128)

    def response(
        self, w: Array, speed: float, output: str, filters: Mapping[str, LowPass] | None = None
    ) -> Complex:
        """Frequency response (n_w,) steering [rad] -> output at w [rad/s], sensor filters included."""
        row = self.outputs.index(output)
        mat = self.matrices(speed)
        y: Complex = _Solved(mat, w).outputs[:, row]
        known = (filters or {}).get(output)
        delay = np.exp(-1j * w * self.values["tau"])
        return y * delay * known.response(w) if known else y * delay

    def log_sensitivity(self, w: Array, speed: float, output: str) -> Complex:
        """d ln H / d theta (n_w, n_free): real part in nepers, imaginary part in rad, per parameter unit."""
        row, values = self.outputs.index(output), self.values
        solved = _Solved(self.matrices(speed), w)
        y = solved.outputs[:, row]
        columns = []
        for p in self.free:
            if p.name == "tau":
                columns.append(-1j * w)
                continue
            step = 1e-20
            d = self.build({**values, "V": speed, p.name: values[p.name] + 1j * step})
            columns.append(solved.derivative(_imaginary(d, step))[:, row] / y)
        return np.column_stack(columns) if columns else np.empty((w.size, 0), dtype=complex)


def _imaginary(mat: Matrices, step: float) -> Matrices:
    return Matrices(*(np.imag(a) / step for a in (mat.m, mat.f, mat.g, mat.h0, mat.h1)))


class _Solved:
    """(jw M - F)^-1 at all frequencies, its outputs, and derivatives of them."""

    def __init__(self, mat: Matrices, w: Array) -> None:
        self.mat, self.s = mat, 1j * w[:, None, None]
        self.inverse = np.linalg.inv(self.s * mat.m - mat.f)
        self.x = self.inverse @ mat.g.astype(complex)
        self.observe = mat.h0 + self.s * mat.h1
        self.outputs: Complex = np.einsum("wij,wj->wi", self.observe, self.x)

    def derivative(self, d: Matrices) -> Complex:
        """d outputs (n_w, ny) for a change d of the matrices."""
        moved = d.g - np.einsum("wij,wj->wi", self.s * d.m - d.f, self.x)
        dx = np.einsum("wij,wj->wi", self.inverse, moved)
        return np.einsum("wij,wj->wi", d.h0 + self.s * d.h1, self.x) + np.einsum(
            "wij,wj->wi", self.observe, dx
        )
