"""Effects that slipx makes itself, and those of forces beside it."""

from __future__ import annotations

from typing import cast

from tests.engines.rover import EngineRover
from tests.engines.shared_laws import EVERYWHERE, PATH, SENSING, outside_laws, vehicle_laws
from tests.foreign.chassis import GRAVITY
from tests.foreign.grade import PLACES
from tests.foreign.law import Extras, Law, peak_ay, share_of_base
from tests.foreign.rover import Rover


def _spool(rover: Rover, size: float, _extras: Extras) -> Rover:
    return cast(EngineRover, rover).having(spool=size)


def _relaxing(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(sigma=share_of_base(rover, size))


def _narrow(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(track=lifted_track(rover, size))


def lifted_track(rover: Rover, size: float) -> float:
    """Track [m] at which the inner wheels lift at 1/size of a steady turn's a_y at the large amplitude."""
    n = rover.numbers
    return 2 * (n.h + n.roll_axis) * peak_ay(rover) / size / GRAVITY


LISTED: tuple[Law, ...] = (
    *(law for law in PATH if law.place != "compliance"),  # no force comes back into the steering
    *SENSING,
    *vehicle_laws(("tyre_saturation", "Magic Formula"), ("front_rear_stiffness", "ratio"), ("side_wind", "")),
    Law("yaw_damping", "spool", "yaw", 0.99, 1.0, _spool, "-", absolute=True),
    Law("tyre_relaxation", "slip angle", "tyre", 0.06, 1.5, _relaxing, "m", share_of_base),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws(EVERYWHERE),
    Law("outside:wheel_lift", "load to zero", "tyre", 0.6, 1.8, _narrow, "m", lifted_track),
)
__all__ = ["LISTED", "OUTSIDE", "PLACES"]
