"""Effects that CommonRoad's multi-body model makes itself, and those of forces beside it."""

from __future__ import annotations

from typing import cast

from tests.engines.rover import EngineRover
from tests.engines.shared_laws import EVERYWHERE, PATH, SENSING, outside_laws, vehicle_laws
from tests.foreign.grade import PLACES as FOREIGN_PLACES
from tests.foreign.law import Extras, Law
from tests.foreign.rover import Rover


def _soft(rover: Rover, size: float, _extras: Extras) -> Rover:
    return cast(EngineRover, rover).having(soft_axle=size)


def _plysteer(rover: Rover, size: float, _extras: Extras) -> Rover:
    return cast(EngineRover, rover).having(plysteer=size)


LISTED: tuple[Law, ...] = (
    *PATH,
    *SENSING,
    *vehicle_laws(
        ("suspension_friction", "tanh"),
        ("tyre_saturation", "Magic Formula"),
        ("yaw_damping", "moment"),
        ("side_wind", ""),
    ),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws((*EVERYWHERE, "outside:wheel_lift")),
    Law("outside:soft_axle", "sideways bushings", "axles", 1.5, 12.0, _soft, "-"),
    Law("outside:plysteer", "side force by the sign of roll", "tyre", 0.01, 0.3, _plysteer, "-"),
)
PLACES: dict[str, tuple[str, ...]] = {
    **FOREIGN_PLACES,
    "outside:soft_axle": ("side force", "roll moment"),
    "outside:plysteer": ("side force", "roll moment"),
}
