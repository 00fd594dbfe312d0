"""CSV files like the public ones: a small car, short trials, motion capture, no IMU; all made here.

A linear single-track car in V_y and r, by scipy's lsim, written apart from the project's models.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

STEP = 0.002  # s
Law = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class SmallCar:
    """A 1:10 car. c: N/rad per axle; delay: s; limit: rad, of the wheels; lag: s, of the servo."""

    m: float = 3.0
    izz: float = 0.05
    a: float = 0.16
    b: float = 0.16
    c: float = 45.0
    delay: float = 0.06
    limit: float = 10.0
    lag: float = 0.0

    def drive(self, command: np.ndarray, speed: float) -> dict[str, np.ndarray]:
        """V_y, r and a_y (n,) at the CG from the commanded angle (n,) [rad], every `STEP` s."""
        before = np.full(int(2.0 / STEP), command[0])  # so that a trial begins in a steady turn
        late = int(round(self.delay / STEP))
        held = np.concatenate((before, np.full(late, command[0]), command))[: before.size + command.size]
        wheel = np.clip(held, *self.ends)
        if self.lag:
            keep = np.exp(-STEP / self.lag)
            wheel = signal.lfilter([1 - keep], [1, -keep], wheel)
        m, i, a, b, c = self.m, self.izz, self.a, self.b, self.c
        f = np.array([[-2 * c / m / speed, -speed - (a - b) * c / m / speed],
                      [-(a - b) * c / i / speed, -(a * a + b * b) * c / i / speed]])  # fmt: skip
        g = np.array([[c / m], [a * c / i]])
        h = np.array([[1.0, 0.0], [0.0, 1.0], [f[0, 0], f[0, 1] + speed]])
        y = signal.lsim((f, g, h, np.array([[0.0], [0.0], [c / m]])), wheel, np.arange(wheel.size) * STEP)[1]
        y = y[before.size :]
        return {"vy": y[:, 0], "r": y[:, 1], "ay": y[:, 2]}

    @property
    def ends(self) -> tuple[float, float]:
        """Both ends of the wheels' travel, rad."""
        return -self.limit, self.limit


def sine(hz: float, size: float = 0.12) -> Law:
    """A sine of one frequency, as in some public sets."""
    return lambda t: size * np.sin(2 * np.pi * hz * t)


def step(size: float, at: float = 1.0) -> Law:
    """One step to one side, held to the end of the trial."""
    return lambda t: np.where(t > at, size, 0.0)


def by_hand(seed: int, size: float = 0.15) -> Law:
    """A driver: held angles of random length, joined by ramps."""
    random = np.random.default_rng(seed)
    knots = np.cumsum(random.uniform(0.3, 0.9, 200))
    values = size * random.uniform(-1, 1, knots.size)
    return lambda t: np.interp(t, knots, values)


@dataclass(frozen=True)
class Recorder:
    """How trials are recorded. rate: Hz; smooth: samples of a Savitzky-Golay filter, 0 for none.

    noise: {channel: rms before the filter}. channels: recorded besides speed and steering.
    """

    rate: float = 100.0
    smooth: int = 0
    channels: tuple[str, ...] = ("r", "ay")
    noise: float = 0.02

    def write(
        self,
        path: Path,
        car: SmallCar,
        laws: Sequence[Law],
        seconds: float,
        speed: float | Sequence[float] = 2.0,
    ) -> str:
        """The trials as one CSV with the columns t, steer, v, trial and the channels."""
        random = np.random.default_rng(5)
        t = np.arange(0, seconds, STEP)
        every = int(round(1 / (STEP * self.rate)))
        lines = [",".join(("t", "steer", "v", "trial", *self.channels))]
        for k, law in enumerate(laws, 1):
            v = speed if isinstance(speed, int | float) else speed[k - 1]
            found = car.drive(law(t), v)
            noisy = {c: found[c] + self.noise * random.standard_normal(t.size) for c in self.channels}
            if self.smooth:
                noisy = {c: signal.savgol_filter(x, self.smooth, 2) for c, x in noisy.items()}
            columns = (t, law(t), np.full(t.size, v), np.full(t.size, k), *(noisy[c] for c in self.channels))
            rows = np.column_stack(columns)[::every]
            lines += [",".join(f"{x:.6g}" for x in row) for row in rows]
        path.write_text("\n".join(lines) + "\n")
        return str(path)
