"""Healthy rovers of three sizes, diagnosed: nothing may be named.

The simulated rover of `sitl`, as delivered and 1.6 and 2.6 times as long, each with other tyres, springs,
servo and noise, drives two default sweeps and a doublet with the steering and speed of committed recordings.
Its owner has measured it without an error.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import rover_sweep as rs
from sitl.plant.variant import PlantParameters, load_variant
from tests.comparison.pairs import drive, varied

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"
RUNS = tuple(NOMINAL / f"{run}.BIN" for run in ("run1", "run2", "run4"))  # 120 us, 240 us, doublet
LENGTHS = (1.0, 1.6, 2.6)  # times the nominal rover: about 3, 11 and 47 kg
TRUE = {
    "Cf": "front_cornering_stiffness",
    "Cr": "rear_cornering_stiffness",
    "Izz": "yaw_inertia",
    "k_phi": "roll_stiffness",
    "b_phi": "roll_damping",
}


@dataclass(frozen=True)
class Examined:
    """A healthy rover's diagnosis. inside: {parameter: the printed interval holds the truth}."""

    verdict: str
    names: tuple[str, ...]
    inside: dict[str, bool]


def healthy_rover(seed: int) -> PlantParameters:
    """Of one of LENGTHS: alike in shape, density and gravity, then varied."""
    random = np.random.default_rng(seed)
    s = LENGTHS[seed % len(LENGTHS)]
    rover = load_variant("nominal")
    powers = {  # of the length
        3.0: ("mass", "sprung_mass", "front_cornering_stiffness", "rear_cornering_stiffness"),
        1.0: ("cg_to_front_axle", "cg_to_rear_axle", "cg_height_above_roll_centre"),
        5.0: ("yaw_inertia", "roll_inertia"),
        4.0: ("roll_stiffness", "road_yaw_moment", "road_roll_moment"),
        4.5: ("roll_damping",),
    }
    large = {name: getattr(rover, name) * s**power for power, names in powers.items() for name in names}
    large |= {name: getattr(rover, name) * s**3 for name in ("drive_force_limit", "road_force")}
    large["imu_position"] = tuple(s * x for x in rover.imu_position)
    return varied(replace(rover, **large), random)


def exact_vehicle_file(rover: PlantParameters) -> str:
    """The rover's own numbers as a vehicle file."""
    measured = (
        "mass", "sprung_mass", "cg_to_front_axle", "cg_to_rear_axle", "cg_height_above_roll_centre",
        "roll_inertia", "yaw_inertia",
    )  # fmt: skip
    lines = ["[vehicle]", 'name = "healthy"', *(f"{name} = {getattr(rover, name)!r}" for name in measured)]
    lines += ["[steering]", f"trim_us = {rover.steering_trim_us}", f"rad_per_us = {rover.rad_per_us!r}"]
    return "\n".join([*lines, "[imu]", f"position = {list(rover.imu_position)}", ""])


def examined(seed: int, runs: Sequence[Path] = RUNS) -> Examined:
    """One rover, driven and diagnosed; the last run is held out."""
    rover = healthy_rover(seed)
    with tempfile.TemporaryDirectory() as folder:
        logs = drive(rover, runs, Path(folder) / "runs", 1000 * seed)
        vehicle = Path(folder) / "rover.toml"
        vehicle.write_text(exact_vehicle_file(rover))
        used, held_out = (rs.read(*map(str, some), vehicle=vehicle) for some in (logs[:-1], logs[-1:]))
        found = rs.diagnose(used, held_out)
    true = {name: getattr(rover, field) for name, field in TRUE.items()}
    inside = {
        name: (v.low or 0.0) <= true[name] <= (v.high or np.inf)
        for name, v in found.parameters.items()
        if name in true
    }
    return Examined(found.verdict, tuple(f.effect for f in found.findings), inside)
