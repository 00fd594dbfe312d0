"""Effects that exudyn makes by its own bodies, joints and contacts, and those of forces beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from numpy.random import Generator

from tests.engines.rover import EngineRover
from tests.engines.shared_laws import AROUND, EVERYWHERE, PATH, SENSING, outside_laws, vehicle_laws
from tests.foreign.chassis import GRAVITY
from tests.foreign.grade import PLACES
from tests.foreign.law import Applied, Extras, Law, peak_ay
from tests.foreign.rover import Rover

AT_ONCE = 0.02  # s: lag of a linkage that yields
OWN_PARTS = (  # of EVERYWHERE, as bodies and joints here
    "outside:pendulum",
    "outside:sliding_load",
    "outside:toe_compliance",
    "outside:slip_speed",
    "outside:limping_motor",
)


def _own(**names: str) -> Applied:
    """size as a number of the engine, and those of extras. names: {number of the engine: "size" or extra}."""

    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        values = {name: size if key == "size" else extras[key] for name, key in names.items()}
        return cast(EngineRover, rover).having(**values)

    return apply


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


def _drag(rover: Rover, size: float, extras: Extras) -> Rover:
    return cast(EngineRover, rover).having(drag=_torque(rover, size), drag_period=extras["period"])


def _torque(rover: Rover, size: float) -> float:
    """Share of the weight as a braking force of one wheel, as its torque [N m]."""
    return size * rover.numbers.m * GRAVITY * rover.instruments.wheel_radius


def _swing(rng: Generator) -> dict[str, float]:
    return {"w": float(rng.uniform(4.5, 9.0))}


def _lag(rng: Generator) -> dict[str, float]:
    return {"lag": float(rng.uniform(0.1, 0.25))}


def _period(rng: Generator) -> dict[str, float]:
    return {"period": float(rng.uniform(0.6, 1.6))}


def _third_run(_rng: Generator) -> dict[str, float]:
    return {"run": 3.0}


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
    Law("yaw_damping", "locked rear axle", "yaw", 0.99, 1.0, _own(spool="size"), "-", absolute=True),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws([one for one in EVERYWHERE if one not in OWN_PARTS]),
    Law(
        "outside:pendulum", "hanging load", "cargo", 0.04, 0.35,
        _own(pendulum="size", pendulum_w="w"), extras=_swing,
    ),
    Law("outside:sliding_load", "dry friction and stops", "cargo", 0.04, 0.35, _own(sliding="size")),
    Law("outside:toe_compliance", "trail and bushings", "compliance", 0.1, 0.8, _toe, "-", _yield, _lag),
    Law(
        "outside:slip_speed", "force over sliding speed", "tyre", 0.7, 1.0,
        _own(slip_speed="size"), extras=_third_run, absolute=True,
    ),
    Law("outside:limping_motor", "one wheel drags", "yaw", 0.01, 0.25, _drag, "N m", _torque, _period),
)  # fmt: skip
__all__ = ["LISTED", "OUTSIDE", "PLACES"]
