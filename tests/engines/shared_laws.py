"""Effects of several engines: of steering path, surroundings and sensors, and of bodies and contacts."""

from __future__ import annotations

from collections.abc import Collection
from typing import cast

import numpy as np
from numba import njit

from tests.engines.engine import Array, EngineRover
from tests.foreign.laws import SENSORS, STEERING, VEHICLE, Applied, Extras, Law, per_newton
from tests.foreign.outside_laws import LAG, OUTSIDE_LAWS, PERIOD, SWING, third_run
from tests.foreign.plant import DT, GRAVITY, STEERING_STATES, Numbers, steering_step
from tests.foreign.rover import Rover

AT_ONCE = 0.02  # s: lag of a linkage that yields
EVERYWHERE = (
    "outside:cubic_hysteresis", "outside:resonant_linkage", "outside:flexing_mast", "outside:yaw_drag",
    "outside:aliased_vibration", "outside:wheel_unbalance", "outside:pendulum", "outside:sliding_load",
    "outside:toe_compliance", "outside:slip_speed", "outside:bump_stops", "outside:limping_motor",
)  # fmt: skip


def vehicle_laws(*wanted: tuple[str, str]) -> tuple[Law, ...]:
    """Laws of tests/foreign by (effect, form); "" for all its forms. KeyError for an unknown one."""
    found = []
    for effect, form in wanted:
        some = [law for law in VEHICLE if law.effect == effect and form in ("", law.form)]
        if not some:
            raise KeyError((effect, form))
        found += some
    return tuple(found)


def outside_laws(wanted: Collection[str]) -> tuple[Law, ...]:
    """Laws outside every list by their ids."""
    return tuple(law for law in OUTSIDE_LAWS if law.effect in wanted)


PATH: tuple[Law, ...] = (*STEERING, *vehicle_laws(("roll_steer", "front axle")))
AROUND: tuple[Law, ...] = vehicle_laws(("surface_change", ""), ("side_wind", ""))
SENSING: tuple[Law, ...] = SENSORS


def own_numbers(**names: str) -> Applied:
    """size as a number of the engine, and those of extras. names: {number of the engine: "size" or extra}."""

    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        values = {name: size if key == "size" else extras[key] for name, key in names.items()}
        return cast(EngineRover, rover).having(**values)

    return apply


def drags(rover: Rover, size: float, extras: Extras) -> Rover:
    """A wheel that drags from time to time."""
    return cast(EngineRover, rover).having(drag=drag_torque(rover, size), drag_period=extras["period"])


def drag_torque(rover: Rover, size: float) -> float:
    """Share of the weight as a braking force of one wheel, as its torque [N m]."""
    return size * rover.numbers.m * GRAVITY * rover.instruments.wheel_radius


def yielding(rover: Rover, size: float) -> float:
    """Share of the front slip angle's stiffness that a yielding wheel loses by `per_newton`."""
    return per_newton(rover, size) * rover.numbers.Cf


def toes(rover: Rover, size: float, extras: Extras) -> Rover:
    """Wheels yield by the share `size` of the large amplitude at its side force, with a delay."""
    lag = extras.get("lag", AT_ONCE)
    return cast(EngineRover, rover).having(toe=yielding(rover, size), toe_lag=lag)


# effects of engines whose loads, tyres and wheels are bodies and contacts
OWN_PARTS: tuple[Law, ...] = (
    Law("outside:pendulum", "hanging load", "cargo", 0.04, 0.35,
        own_numbers(pendulum="size", pendulum_w="w"), extras=SWING),
    Law("outside:toe_compliance", "trail and bushings", "compliance", 0.1, 0.8, toes, "-", yielding, LAG),
    Law("outside:slip_speed", "force over sliding speed", "tyre", 0.7, 1.0, own_numbers(slip_speed="size"),
        extras=third_run, absolute=True),
    Law("outside:limping_motor", "one wheel drags", "yaw", 0.01, 0.25, drags, "N m", drag_torque, PERIOD),
)  # fmt: skip


def chassis_inertia(rover: EngineRover) -> tuple[float, float, float, float]:
    """(CG of the chassis ahead of that of the whole [m], its I_xx, I_yy, I_zz); the wheels have one mass."""
    n = rover.numbers
    wheel = (n.m - n.ms) / 4
    loose = rover.own.get("pendulum", 0.0) + rover.own.get("sliding", 0.0)
    ahead = -2 * wheel * (n.a - n.b) / n.ms
    unsprung_yaw = 4 * wheel * (n.track / 2) ** 2 + 2 * wheel * (n.a**2 + n.b**2)
    izz = max(n.Izz - unsprung_yaw - n.ms * ahead**2, 0.3 * n.Izz)
    iyy = max(1.05 * izz - n.Ixx, n.ms * (0.25 * (n.a + n.b)) ** 2)
    return ahead, n.Ixx * (1 - 0.5 * loose), iyy, izz


@njit
def steered(command: Array, wanted: Array, n: Numbers) -> Array:
    """Road-wheel angle (steps,) rad before roll steer, where no force comes back into the steering."""
    out, servo = np.empty(command.size), np.zeros(STEERING_STATES)
    for k in range(command.size):
        out[k] = steering_step(servo, command[k], wanted[k], 0.0, 0.0, n, DT)
    return out
