"""Effects that need nothing of an engine but its interface: steering path, surroundings, sensors."""

from __future__ import annotations

from collections.abc import Collection

from tests.foreign.law import Law
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.sensor_laws import SENSORS
from tests.foreign.steering_laws import STEERING
from tests.foreign.vehicle_laws import VEHICLE

EVERYWHERE = (  # outside every list, and made in each engine that has no part for it
    "outside:cubic_hysteresis",
    "outside:resonant_linkage",
    "outside:flexing_mast",
    "outside:yaw_drag",
    "outside:aliased_vibration",
    "outside:wheel_unbalance",
    "outside:pendulum",
    "outside:sliding_load",
    "outside:toe_compliance",
    "outside:slip_speed",
    "outside:bump_stops",
    "outside:limping_motor",
)


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
