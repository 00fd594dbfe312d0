"""What the bench asks of a physics engine, and the engines by their names.

An engine takes a rover, the steering command and the wanted speed, and returns the motion at the IMU. All
that firmware and sensors add comes later and is the same for each engine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from typing import Any

import numpy as np
from numba import njit
from numpy.random import Generator
from numpy.typing import NDArray

from tests.foreign.laws import Law
from tests.foreign.plant import GRAVITY, Numbers, load_factor, loose_pull
from tests.foreign.recorded import Drive, around, command, output_us, sensed, wanted_speed
from tests.foreign.rover import Rover, Size, draw_rover

CUT = 2.5  # standard deviations: nobody is further off


@dataclass(frozen=True)
class EngineRover(Rover):
    """own: numbers that only one engine has, {} where it is as everybody's."""

    own: Mapping[str, float] = field(default_factory=dict)

    def having(self, **own: float) -> EngineRover:
        """The rover with other numbers of its engine."""
        return replace(self, own={**self.own, **own})


def drawn_rover(rng: Generator, size: Size) -> EngineRover:
    """A rover without any effect, and its vehicle file."""
    plain = draw_rover(rng, size)
    rover = EngineRover(**{one.name: getattr(plain, one.name) for one in fields(plain)})
    return replace(rover, told=_known(rng, rover))


def _known(rng: Generator, rover: EngineRover) -> dict[str, Any]:
    """The vehicle file's numbers, SI units."""
    n, i = rover.numbers, rover.instruments
    base = n.a + n.b

    def off(sd: float) -> float:
        return float(np.clip(rng.normal(0.0, sd), -CUT * sd, CUT * sd))

    told = {
        "mass": n.m * (1 + off(0.01)),
        "sprung_mass": n.ms * (1 + off(0.01)),
        "cg_to_front_axle": n.a + off(0.02 * base),
        "cg_height_above_roll_centre": n.h * (1 + off(0.2)),
        "roll_inertia": n.Ixx * (1 + off(0.15)),
        "rad_per_us": rover.rad_per_us * (1 + off(0.03)),
        "imu_x": i.imu_x + off(0.02 * base),
        "imu_z": i.imu_z + off(0.02 * base),
    }
    told["cg_to_rear_axle"] = base * (1 + off(0.002)) - told["cg_to_front_axle"]
    # nobody's sprung mass outweighs the rover
    told["sprung_mass"] = min(told["sprung_mass"], 0.98 * told["mass"])
    if rng.uniform() < 0.4:
        told["yaw_inertia"] = n.Izz * (1 + off(0.1))
    return {key: float(f"{value:.4g}") for key, value in told.items()}


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
    columns of `tests.foreign.plant`: surface, wind, road; heading: rad, at rest. ISO axes (x forward, y
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


# ---- Forces that are added to an engine without the part that makes them.


@njit
def load_step(load: Array, across: float, n: Numbers, dt: float) -> float:
    """Advances a loose load, place [m] and speed [m/s] to the left, and returns its force [N] to the left.

    across: acceleration to the left where it hangs or lies, m/s^2. The engine's mass has the load at rest.
    """
    rate = -loose_pull(load[0], load[1], n) - across
    load[1] += dt * rate
    load[0] += dt * load[1]
    return -n.loose * n.m * rate


@njit
def load_roll(load: Array, force: float, n: Numbers) -> float:
    """Roll moment [N m] of a loose load by its force and, on a bed, by its weight."""
    weight = n.loose * n.m * GRAVITY * load[0] if n.loose_form == 2.0 else 0.0
    return -force * n.h - weight


@njit
def lost_share(lean: float, n: Numbers) -> float:
    """Share of the side force that an axle loses as its inner wheel lifts. lean: N that leave both inner
    wheels."""
    other = n.b if n.lift_form == 0.0 else n.a
    static, moved = n.m * GRAVITY * other / (n.a + n.b) / 2, n.lift * lean / 2
    inner = load_factor(static - moved, static, 0.0, 4.0)
    outer = load_factor(static + moved, static, 0.0, 4.0)
    return 1.0 - (inner + outer) / 2


def at_speed(rover: EngineRover, speed: float) -> EngineRover:
    """The rover with the tyres that it has at a speed [m/s]."""
    n = rover.numbers
    if not n.slip_speed:
        return rover
    share = (speed / n.speed_ref) ** n.slip_speed
    return rover.of(Cf=share * n.Cf, Cr=share * n.Cr)  # type: ignore[return-value]
