"""Effects that need nothing of an engine but its interface: steering path, surroundings, sensors."""

from __future__ import annotations

from collections.abc import Collection
from typing import cast

from numpy.random import Generator

from tests.engines.engine import EngineRover
from tests.foreign.laws import SENSORS, STEERING, VEHICLE, Applied, Extras, Law
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.plant import GRAVITY
from tests.foreign.rover import Rover

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


def drawn_swing(rng: Generator) -> dict[str, float]:
    """The frequency of a pendulum [rad/s]."""
    return {"w": float(rng.uniform(4.5, 9.0))}


def drawn_lag(rng: Generator) -> dict[str, float]:
    """The lag of bushings [s]."""
    return {"lag": float(rng.uniform(0.1, 0.25))}


def periods(rng: Generator) -> dict[str, float]:
    """The time between two drags [s]."""
    return {"period": float(rng.uniform(0.6, 1.6))}


def third_run(_rng: Generator) -> dict[str, float]:
    """The run in which it acts."""
    return {"run": 3.0}
