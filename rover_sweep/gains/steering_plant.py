"""What the controller sees: a model's yaw rate sampled by the main loop, behind steering and gyro filter."""

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
    """x(k+1) = a x(k) + b u(k - late), y(k) = c x(k): road-wheel angle [rad] held over `period` s to the
    filtered yaw rate [rad/s]. What a delay has beside `late` whole periods is within a and b."""

    a: Array
    b: Array
    c: Array
    late: int
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
        return np.asarray(x[:, :, 0] @ self.c.astype(complex) * z**-self.late)


def sampled_plant(
    structure: ModelStructure,
    speed: float,
    autopilot: Autopilot,
    hidden: Sequence[LowPass] = (),
    label: str = "",
) -> SampledPlant:
    """The plant at a speed [m/s]. hidden: low-passes in front of the autopilot's own.

    Raises ValueError where the yaw rate follows the steering without any lag, so that a loop could not be
    computed in order.
    """
    sensors = {"r": LowPass(autopilot.gyro_hz, "INS_GYRO_FILTER")} if autopilot.gyro_hz > 0 else {}
    late, rest = _whole(structure, autopilot.period)
    system = to_scipy(rest, speed, dt=autopilot.period, sensors=sensors)
    row = structure.outputs.index("r")
    if abs(system.D[row, 0]) > 1e-12:
        raise ValueError(f"in the {structure.name} model the yaw rate follows the steering at once")
    a, b, c = np.asarray(system.A), np.asarray(system.B)[:, 0], np.asarray(system.C)[row]
    for low_pass in hidden:
        a, b, c = _behind(a, b, c, low_pass, autopilot.period)
    return SampledPlant(*_reduced(a, b, c), late, autopilot.period, speed, label)


def _whole(structure: ModelStructure, period: float) -> tuple[int, ModelStructure]:
    """Whole periods of the steering's delay, and the structure with what is left of it."""
    name = structure.input_delays.get(structure.inputs[0])
    if name is None:
        return 0, structure
    late = int(np.floor(structure.values[name] / period + 1e-9))
    return late, structure.with_values({name: max(structure.values[name] - late * period, 0.0)})


def _behind(a: Array, b: Array, c: Array, low_pass: LowPass, period: float) -> tuple[Array, Array, Array]:
    """With a further second-order low-pass at the output, by Tustin's rule as ArduPilot's own filters."""
    from scipy.signal import butter, tf2ss

    cutoff = min(low_pass.cutoff_hz, 0.4 / period)
    fa, fb, fc, fd = tf2ss(*butter(2, cutoff, fs=1 / period))
    n, m = len(a), len(fa)
    whole = np.block([[a, np.zeros((n, m))], [fb @ c[None, :], fa]])
    return whole, np.concatenate((b, np.zeros(m))), np.concatenate((fd[0, 0] * c, fc[0]))


def _reduced(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """Without states that the output does not see, such as the filters of other outputs."""
    seen, grown = np.abs(c) > 0, True
    while grown:
        wider = seen | (np.abs(a[seen]) > 0).any(axis=0)
        grown, seen = bool(np.any(wider != seen)), wider
    return a[np.ix_(seen, seen)], b[seen], c[seen]
