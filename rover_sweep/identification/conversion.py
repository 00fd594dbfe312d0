"""Identified models and responses as objects of python-control and scipy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import factorial
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.errors import missing_extra
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.state_space import ModelStructure, held_input
from rover_sweep.spectra.response import FrequencyResponse

if TYPE_CHECKING:
    import control
    import scipy.signal

System = tuple[Array, Array, Array, Array]  # A (nx, nx), B (nx, nu), C (ny, nx), D (ny, nu)
GAIN: System = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))  # of 1


class HasFit(Protocol):
    """A model with its fit, such as `ModelResult`."""

    @property
    def fit(self) -> FitResult:
        """The fit."""


def to_control(
    found: HasFit | FitResult | ModelStructure | FrequencyResponse,
    speed: float | None = None,
    pade: int = 2,
    sensors: Mapping[str, LowPass] | None = None,
) -> control.StateSpace | control.FrequencyResponseData:
    """A model as `control.StateSpace` or a measured response as `control.FrequencyResponseData`.

    speed [m/s]: default that of the fit; needed for a structure. pade: order of the approximation of delays;
    0 leaves them out (tau [s] is a parameter of the model). sensors: low-passes added to the outputs, such as
    `group.runs[0].filters`: with them the outputs are the recorded ones, else the true ones. Inputs,
    outputs and states keep their names; SI units, ISO axes. UsageError without python-control.

    >>> system = rs.to_control(result.models["roll-yaw"])
    >>> system.input_labels, system.output_labels
    (['delta'], ['r', 'ay', 'vydot', 'p'])
    >>> rs.to_control(result.responses["r"]).frequency.size
    120
    """
    try:
        import control
    except ImportError:
        raise missing_extra("to_control() needs python-control", "control") from None
    if isinstance(found, FrequencyResponse):
        h = np.asarray(found.h)[None, None, :]
        names = {"inputs": [found.input], "outputs": [found.output]}
        return control.FrequencyResponseData(h, found.w, **names)
    structure, at = _structure_and_speed(found, speed)
    before, rover, after = _parts(structure, at, pade, sensors or {})
    states = [f"before{k}" for k in range(len(before[0]))] + list(structure.states)
    states += [f"after{k}" for k in range(len(after[0]))]
    return control.ss(
        *_series(_series(before, rover), after),
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=states,
        name=structure.name.replace("-", "_"),
    )


def to_scipy(
    found: HasFit | FitResult | ModelStructure,
    speed: float | None = None,
    pade: int = 2,
    dt: float | None = None,
    sensors: Mapping[str, LowPass] | None = None,
) -> scipy.signal.StateSpace:
    """A model as `scipy.signal.StateSpace`: continuous, or with dt [s] discrete.

    Arguments as in `to_control`. With dt the input is held between samples and its delay is exact, also for
    a fraction of a sample (Astrom and Wittenmark 1997, section 2.3); `pade` then applies only to
    output delays.

    >>> rs.to_scipy(result.models["roll-yaw"], dt=0.01).dt
    0.01
    """
    from scipy.signal import StateSpace

    structure, at = _structure_and_speed(found, speed)
    before, rover, after = _parts(structure, at, pade, sensors or {})
    if dt is None:
        return StateSpace(*_series(_series(before, rover), after))
    if not dt > 0:
        raise ValueError(f"dt is {dt} s; it must be above 0")
    late = [structure.delay(name) for name in structure.inputs]
    return StateSpace(*_sampled(_series(rover, after), late, dt), dt=dt)


def _structure_and_speed(
    found: HasFit | FitResult | ModelStructure, speed: float | None
) -> tuple[ModelStructure, float]:
    """The structure and the speed [m/s] of the conversion."""
    fit: object = getattr(found, "fit", found)
    if isinstance(fit, ModelStructure):
        if speed is None:
            raise ValueError(f"the {fit.name} structure has no speed: give speed")
        return fit, speed
    if not isinstance(fit, FitResult):
        raise TypeError(f"{type(found).__name__} is neither a model nor a response")
    if fit.structure.name == "lumped" and speed not in (None, fit.speed):
        raise ValueError(f"the lumped model is valid at {fit.speed:.4g} m/s only, not at {speed} m/s")
    return fit.structure, fit.speed if speed is None else speed


def _parts(
    structure: ModelStructure, speed: float, order: int, sensors: Mapping[str, LowPass]
) -> tuple[System, System, System]:
    """Systems in series: delays of the inputs, the structure, delays and sensors of the outputs."""
    before = [_delay(structure.delay(name), order) for name in structure.inputs]
    after = [
        _series(_delay(structure.delay(name), order), _low_pass(sensors.get(name)))
        for name in structure.outputs
    ]
    return _parallel(before), structure.matrices(speed).state_space(), _parallel(after)


def pade_delay(tau: float, order: int) -> tuple[Array, Array]:
    """Numerator and denominator (order + 1,) in falling powers of s of the Pade form of exp(-s tau)."""
    n = order
    c = np.array(
        [
            factorial(2 * n - k)
            * factorial(n)
            / (factorial(2 * n) * factorial(k) * factorial(n - k))
            * tau**k
            for k in range(n, -1, -1)
        ]
    )
    return np.asarray(c * (-1.0) ** np.arange(n, -1, -1), float), c


def _delay(tau: float, order: int) -> System:
    if order < 0:
        raise ValueError(f"pade {order} must be 0 or more")
    return GAIN if tau <= 0 or order == 0 else _realised(*pade_delay(tau, order))


def _low_pass(known: LowPass | None) -> System:
    if known is None:
        return GAIN
    w0 = 2 * np.pi * known.cutoff_hz
    return _realised(np.array([w0**2]), np.array([1.0, np.sqrt(2) * w0, w0**2]))


def _realised(num: Array, den: Array) -> System:
    from scipy.signal import tf2ss

    system: System = tf2ss(num, den)
    return system


def _parallel(parts: Sequence[System]) -> System:
    """Single channels in parallel, block diagonal."""
    from scipy.linalg import block_diag

    a, b, c, d = (block_diag(*[p[k] for p in parts]) for k in range(4))
    return a, b, c, d


def _series(first: System, second: System) -> System:
    """The second driven by the first; states of the first come first."""
    a1, b1, c1, d1 = first
    a2, b2, c2, d2 = second
    a = np.block([[a1, np.zeros((len(a1), len(a2)))], [b2 @ c1, a2]])
    return a, np.vstack((b1, b2 @ d1)), np.hstack((d2 @ c1, c2)), d2 @ d1


def _sampled(system: System, late: Sequence[float], dt: float) -> System:
    """Exact discretisation of a system with held inputs, each delayed by its own time [s].

    x(k+1) = Phi x(k) + G0 u(k-n) + G1 u(k-n-1) for a delay of n to n + 1 samples; past values of u are
    additional states.
    """
    a, b, c, d = system
    nx, nu = b.shape
    whole = [int(np.floor(tau / dt + 1e-9)) for tau in late]
    rest = [
        max(tau - n * dt, 0.0) if tau - n * dt > 1e-9 * dt else 0.0
        for tau, n in zip(late, whole, strict=True)
    ]
    kept = [n + (part > 0) for n, part in zip(whole, rest, strict=True)]
    size = nx + sum(kept)
    # columns: all states, then all inputs
    step, out = np.zeros((size, size + nu)), np.zeros((len(c), size + nu))
    step[:nx, :nx], out[:, :nx] = held_input(a, b, dt)[0], c
    first = nx
    for i in range(nu):
        past = [size + i, *range(first, first + kept[i])]  # columns of u(k), u(k-1), ...
        new, old = past[whole[i]], past[kept[i]]
        carry, early = held_input(a, b[:, [i]], dt - rest[i])
        step[:nx, new] += early[:, 0]
        step[:nx, old] += (carry @ held_input(a, b[:, [i]], rest[i])[1])[:, 0]
        out[:, old] += d[:, i]
        for j in range(kept[i]):
            step[past[j + 1], past[j]] = 1.0
        first += kept[i]
    return step[:, :size], step[:, size:], out[:, :size], out[:, size:]
