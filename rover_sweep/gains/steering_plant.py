"""The controller's plant: road-wheel angle to filtered yaw rate, sampled in the main loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.gains.steering_chain import Autopilot
from rover_sweep.identification.conversion import to_scipy
from rover_sweep.identification.structure.state_space import ModelStructure


@dataclass(frozen=True, eq=False)
class SampledPlant:
    """x(k+1) = a x(k) + b u(k - delay_steps), y(k) = c x(k), from the road-wheel angle u [rad], held over
    `period` [s], to the filtered yaw rate y [rad/s]. delay_steps: whole periods of delay; a and b include the
    rest of the delay."""

    a: Array
    b: Array
    c: Array
    delay_steps: int
    period: float
    speed: float
    label: str = ""

    @property
    def gain(self) -> float:
        """Steady y/u, 1/s."""
        return float(self.c @ np.linalg.solve(np.eye(len(self.a)) - self.a, self.b))

    @property
    def stable(self) -> bool:
        return bool(np.all(np.abs(np.linalg.eigvals(self.a)) < 1.0))

    def response(self, w: Array) -> NDArray[np.complex128]:
        """Frequency response (n,) at w (n,) rad/s, up to pi / period."""
        z = np.exp(1j * w * self.period)
        system = z[:, None, None] * np.eye(len(self.a)) - self.a
        x = np.linalg.solve(
            system, np.broadcast_to(self.b.astype(complex)[:, None], (w.size, len(self.b), 1))
        )
        return np.asarray(x[:, :, 0] @ self.c.astype(complex) * z**-self.delay_steps)


def sampled_plant(
    structure: ModelStructure,
    speed: float,
    autopilot: Autopilot,
    hidden: Sequence[LowPass] = (),
    label: str = "",
) -> SampledPlant:
    """The plant at a speed [m/s]. hidden: low-passes before the autopilot's own.

    Raises ValueError if the yaw rate follows the steering without any lag (an algebraic loop).
    """
    sensors = {"r": LowPass(autopilot.gyro_hz, "INS_GYRO_FILTER")} if autopilot.gyro_hz > 0 else {}
    delay_steps, rest = _split_delay(structure, autopilot.period)
    system = to_scipy(rest, speed, dt=autopilot.period, sensors=sensors)
    row = structure.outputs.index("r")
    if abs(system.D[row, 0]) > 1e-12:
        raise ValueError(f"in the {structure.name} model the yaw rate follows the steering without lag")
    a, b, c = np.asarray(system.A), np.asarray(system.B)[:, 0], np.asarray(system.C)[row]
    for low_pass in hidden:
        a, b, c = _with_low_pass(a, b, c, low_pass, autopilot.period)
    return SampledPlant(*_observable(a, b, c), delay_steps, autopilot.period, speed, label)


def _split_delay(structure: ModelStructure, period: float) -> tuple[int, ModelStructure]:
    """Whole periods of the steering's delay, and the structure with the rest of the delay."""
    name = structure.input_delays.get(structure.inputs[0])
    if name is None:
        return 0, structure
    delay_steps = int(np.floor(structure.values[name] / period + 1e-9))
    return delay_steps, structure.with_values({name: max(structure.values[name] - delay_steps * period, 0.0)})


def _with_low_pass(
    a: Array, b: Array, c: Array, low_pass: LowPass, period: float
) -> tuple[Array, Array, Array]:
    """The system with a second-order low-pass at its output, by Tustin's rule as in ArduPilot's filters."""
    from scipy.signal import butter, tf2ss

    cutoff = min(low_pass.cutoff_hz, 0.4 / period)
    fa, fb, fc, fd = tf2ss(*butter(2, cutoff, fs=1 / period))
    n, m = len(a), len(fa)
    combined = np.block([[a, np.zeros((n, m))], [fb @ c[None, :], fa]])
    return combined, np.concatenate((b, np.zeros(m))), np.concatenate((fd[0, 0] * c, fc[0]))


def _observable(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """The system without unobservable states, such as the filters of other outputs."""
    observed, grown = np.abs(c) > 0, True
    while grown:
        wider = observed | (np.abs(a[observed]) > 0).any(axis=0)
        grown, observed = bool(np.any(wider != observed)), wider
    return a[np.ix_(observed, observed)], b[observed], c[observed]
