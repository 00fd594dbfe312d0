"""Effects that exudyn makes by its own bodies, joints and contacts, and those of forces beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from tests.engines.rover import EngineRover
from tests.engines.shared_laws import (
    AROUND,
    EVERYWHERE,
    PATH,
    SENSING,
    drag_torque,
    drags,
    drawn_lag,
    drawn_swing,
    outside_laws,
    own_numbers,
    periods,
    third_run,
    vehicle_laws,
)
from tests.foreign.chassis import GRAVITY
from tests.foreign.grade import PLACES
from tests.foreign.law import Extras, Law, peak_ay
from tests.foreign.rover import Rover

AT_ONCE = 0.02  # s: lag of a linkage that yields
OWN_PARTS = (  # of EVERYWHERE, as bodies and joints here
    "outside:pendulum",
    "outside:sliding_load",
    "outside:toe_compliance",
    "outside:slip_speed",
    "outside:limping_motor",
)


def _knee(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(mu=_mu(rover, size))


def _bend(rover: Rover, size: float, _extras: Extras) -> Rover:
    return cast(EngineRover, rover.of(mu=_mu(rover, size))).having(smooth=size)


def _mu(rover: Rover, size: float) -> float:
    return peak_ay(rover) / GRAVITY / size


def _toe(rover: Rover, size: float, extras: Extras) -> Rover:
    """Wheels yield by the share `size` of the large amplitude at its side force, with a delay."""
    lag = extras.get("lag", AT_ONCE)
    return cast(EngineRover, rover).having(toe=_yield(rover, size), toe_lag=lag)


def _yield(rover: Rover, size: float) -> float:
    """Share of the front slip angle's stiffness: angle lost times stiffness over side force."""
    return _per_newton(rover, size) * rover.numbers.Cf


def _per_newton(rover: Rover, size: float) -> float:
    """Toe per front side force [rad/N]."""
    n = rover.numbers
    return size * rover.amplitude * (n.a + n.b) / (n.m * peak_ay(rover) * n.b)


def _dry_hinges() -> tuple[Law, ...]:
    return tuple(
        replace(law, form="dry hinges", own=False) for law in vehicle_laws(("suspension_friction", "tanh"))
    )


LISTED: tuple[Law, ...] = (
    *(law for law in PATH if law.place != "compliance"),  # made by the wheels' trail below
    *AROUND,
    *SENSING,
    *_dry_hinges(),
    *vehicle_laws(("cross_slope", "plane"), ("front_rear_stiffness", "ratio"), ("yaw_damping", "moment")),
    Law("steering_compliance", "trail", "compliance", 0.08, 0.6, _toe, "rad/N", _per_newton),
    Law("tyre_saturation", "end of the zone", "tyre", 0.7, 1.5, _knee, "-", _mu),
    Law("tyre_saturation", "smooth zone", "tyre", 0.3, 1.3, _bend, "-", _mu),
    Law("yaw_damping", "locked rear axle", "yaw", 0.99, 1.0, own_numbers(spool="size"), "-", absolute=True),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws([one for one in EVERYWHERE if one not in OWN_PARTS]),
    Law(
        "outside:pendulum", "hanging load", "cargo", 0.04, 0.35,
        own_numbers(pendulum="size", pendulum_w="w"), extras=drawn_swing,
    ),
    Law("outside:sliding_load", "dry friction and stops", "cargo", 0.04, 0.35, own_numbers(sliding="size")),
    Law("outside:toe_compliance", "trail and bushings", "compliance", 0.1, 0.8, _toe, "-", _yield, drawn_lag),
    Law(
        "outside:slip_speed", "force over sliding speed", "tyre", 0.7, 1.0,
        own_numbers(slip_speed="size"), extras=third_run, absolute=True,
    ),
    Law("outside:limping_motor", "one wheel drags", "yaw", 0.01, 0.25, drags, "N m", drag_torque, periods),
)  # fmt: skip
__all__ = ["LISTED", "OUTSIDE", "PLACES"]
