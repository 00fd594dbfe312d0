"""Effects that MuJoCo makes by its own contacts, joints and bodies."""

from __future__ import annotations

from typing import cast

from tests.engines.rover import EngineRover
from tests.engines.shared_laws import (
    AROUND,
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
from tests.foreign.grade import PLACES as FOREIGN_PLACES
from tests.foreign.law import Extras, Law, peak_ay, turning_stiffness
from tests.foreign.rover import Rover

FRONT_SHARE = 0.8  # of the roll stiffness, where a front wheel lifts


def _cone(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(mu=_mu(rover, size))


def _mu(rover: Rover, size: float) -> float:
    return peak_ay(rover) / GRAVITY / size


def _coupled(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(diff_c=2 * size * turning_stiffness(rover) / rover.numbers.track**2)


def _coupling(rover: Rover, size: float) -> float:
    """Yaw damping without slip of the wheels, N m s/rad."""
    return size * turning_stiffness(rover) / rover.speed


def _bumps(rover: Rover, size: float, _extras: Extras) -> Rover:
    """Travel of a leg: 1/size of what the large amplitude asks for."""
    return cast(EngineRover, rover).having(bump=_travel(rover, size))


def _travel(rover: Rover, size: float) -> float:
    n = rover.numbers
    lean = n.ms * n.h * peak_ay(rover) / (n.kphi - n.ms * GRAVITY * n.h)
    return lean * n.track / 2 / size


def _toe(rover: Rover, size: float, extras: Extras) -> Rover:
    """Wheels yield by the share `size` of the large amplitude at its side force, with a delay."""
    return cast(EngineRover, rover).having(toe=_yield(rover, size), toe_lag=extras["lag"])


def _yield(rover: Rover, size: float) -> float:
    """Share of the front slip angle's stiffness: angle lost times stiffness over side force."""
    n = rover.numbers
    force = n.m * peak_ay(rover) * n.b / (n.a + n.b)
    return size * rover.amplitude * n.Cf / force


def _narrow(rover: Rover, size: float, _extras: Extras) -> Rover:
    """A narrow track on springs that carry the roll moment in front; its roll stiffness stays as it is."""
    track = lifted_track(rover, size)
    return cast(EngineRover, rover.of(track=track)).having(front_share=FRONT_SHARE)


def lifted_track(rover: Rover, size: float) -> float:
    """Track [m] at which a front wheel lifts at 1/size of a steady turn's a_y at the large amplitude."""
    return 4 * FRONT_SHARE * rover.numbers.h * peak_ay(rover) / size / GRAVITY


LISTED: tuple[Law, ...] = (
    *PATH,
    *AROUND,
    *SENSING,
    *vehicle_laws(
        ("suspension_friction", "tanh"), ("cross_slope", "plane"), ("front_rear_stiffness", "ratio")
    ),
    Law("tyre_saturation", "friction cone", "tyre", 0.7, 1.5, _cone, "-", _mu),
    Law("yaw_damping", "coupled wheels", "yaw", 0.05, 10.0, _coupled, "N m s/rad", _coupling),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws(("outside:cubic_hysteresis", "outside:resonant_linkage", "outside:aliased_vibration")),
    Law(
        "outside:pendulum", "hanging load", "cargo", 0.04, 0.35,
        own_numbers(pendulum="size", pendulum_w="w"), extras=drawn_swing,
    ),
    Law("outside:sliding_load", "dry friction and stops", "cargo", 0.04, 0.4, own_numbers(sliding="size")),
    Law("outside:flexing_mast", "IMU on a hinge", "imu", 0.08, 0.4, own_numbers(mast="size"), "s"),
    Law("outside:toe_compliance", "trail and bushings", "compliance", 0.1, 0.8, _toe, "-", _yield, drawn_lag),
    Law(
        "outside:slip_speed", "force over sliding speed", "tyre", 0.7, 1.0,
        own_numbers(slip_speed="size"), extras=third_run, absolute=True,
    ),
    Law("outside:bump_stops", "stops of the legs", "roll", 1.2, 4.0, _bumps, "m", _travel),
    Law("outside:wheel_lift", "contact opens", "tyre", 0.6, 1.6, _narrow, "m", lifted_track),
    Law("outside:limping_motor", "one wheel drags", "yaw", 0.01, 0.25, drags, "N m", drag_torque, periods),
)  # fmt: skip
PLACES: dict[str, tuple[str, ...]] = {**FOREIGN_PLACES, "outside:limping_motor": ("yaw moment", "speed")}
