"""Effects that slipx makes itself, and those of forces beside it."""

from __future__ import annotations

from typing import cast

from tests.engines.rover import EngineRover
from tests.engines.shared_laws import PATH, SENSING, outside_laws, vehicle_laws
from tests.foreign.grade import PLACES
from tests.foreign.law import Extras, Law, share_of_base
from tests.foreign.rover import Rover


def _spool(rover: Rover, size: float, _extras: Extras) -> Rover:
    return cast(EngineRover, rover).having(spool=size)


def _relaxing(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(sigma=share_of_base(rover, size))


LISTED: tuple[Law, ...] = (
    *(law for law in PATH if law.place != "compliance"),  # no force comes back into the steering
    *SENSING,
    *vehicle_laws(("tyre_saturation", "Magic Formula"), ("front_rear_stiffness", "ratio"), ("side_wind", "")),
    Law("yaw_damping", "spool", "yaw", 0.99, 1.0, _spool, "-", absolute=True),
    Law("tyre_relaxation", "slip angle", "tyre", 0.06, 1.5, _relaxing, "m", share_of_base),
)
OUTSIDE: tuple[Law, ...] = outside_laws(
    (
        "outside:cubic_hysteresis",
        "outside:resonant_linkage",
        "outside:flexing_mast",
        "outside:yaw_drag",
        "outside:aliased_vibration",
        "outside:wheel_unbalance",
    )
)
__all__ = ["LISTED", "OUTSIDE", "PLACES"]
