"""What the bench asks of a physics engine, and the engines by their names.

An engine takes a rover, the steering command and the wanted speed, and returns the motion at the IMU. All
that firmware and sensors add comes later and is the same for each engine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tests.engines.rover import EngineRover
from tests.foreign.drive import Drive, command, output_us, wanted_speed
from tests.foreign.instruments import sensed
from tests.foreign.law import Law
from tests.foreign.rover import SIZES, Size
from tests.foreign.surroundings import around

Array = NDArray[np.float64]
Signals = Mapping[str, Array]
CHANNELS = ("r", "p", "ay", "vy", "speed", "phi", "psi")
MODULES = {  # package that it needs
    "foreign": ("tests.engines.foreign_engine", "numba"),
    "mujoco": ("tests.engines.mujoco_engine", "mujoco"),
    "commonroad": ("tests.engines.commonroad_engine", "vehiclemodels"),
    "slipx": ("tests.engines.slipx_engine", "slipx"),
    "exudyn": ("tests.engines.exudyn_engine", "exudyn"),
}


@dataclass(frozen=True)
class Engine:
    """An engine and the effects that it can conceal.

    signals(rover, command, wanted, around, heading): undisturbed CHANNELS (steps,) at the IMU at 1 kHz.
    command (steps,) rad as the servo gets it, left positive; wanted (steps,) m/s; around (steps, 7) in the
    columns of `tests.foreign.chassis`: surface, wind, road; heading: rad, at rest. ISO axes (x forward, y
    left, z up), SI units; a_y is the specific force, +V r in a steady left turn; phi is positive where the
    left side rises, as it does in a left turn.
    """

    name: str
    sizes: tuple[Size, ...]
    signals: Callable[[EngineRover, Array, Array, Array, float], Signals]
    listed: tuple[Law, ...]
    outside: tuple[Law, ...]
    places: Mapping[str, tuple[str, ...]]


def engine(name: str) -> Engine:
    """An engine of MODULES; ImportError where its package is missing."""
    return import_module(MODULES[name][0]).ENGINE  # type: ignore[no-any-return]


def driven(
    used: Engine, rover: EngineRover, drive: Drive, rng: Generator, noise: bool = True
) -> tuple[Array, Array, dict[str, Array]]:
    """(main loops (k,) [s], PWM (k,) [us], {channel: (steps,)}) of a run; noise: of road and sensors."""
    t_out, us = output_us(drive, rover, np.random.default_rng(int(drive.opened * 1e6)))
    ground = around(rover, drive, rng, noise)
    motion = used.signals(rover, command(drive, rover, t_out, us), wanted_speed(drive), ground, drive.heading)
    return t_out, us, sensed(motion, rover.instruments, rng, noise)


__all__ = ["CHANNELS", "MODULES", "SIZES", "Engine", "driven", "engine"]
