"""A rover that several engines can build, and what its owner knows of it.

The owner's errors are those of people: one standard deviation is 1 % of what is weighed, .02 of the wheelbase
for a place found with a ruler, 20 % of the height above the roll axis, 15 % of the roll inertia, 3 % of
rad_per_us; the yaw inertia is known to 10 % to two owners in five.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.random import Generator

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
