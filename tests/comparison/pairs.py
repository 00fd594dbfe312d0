"""Rovers that drive as recorded ones did: pairs of recordings and simulation for the comparison.

Both sides are the simulated rover of `sitl` (its laws share no code with the identification), driven with the
steering and speed of committed recordings. The vehicle file has errors like those of scales, a ruler and a
swing. `python -m tests.engines.pairs` draws pairs of other engines and grades the comparison.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.screening import screened
from rover_sweep.redrive.recorded_course import course_of
from sitl.plant.variant import PlantParameters
from sitl.redrive.open_loop import redrive

RECORDED = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c"
VARIED = (
    "front_cornering_stiffness", "rear_cornering_stiffness", "yaw_inertia", "roll_stiffness",
    "roll_damping", "servo_lag", "friction",
)  # fmt: skip


def varied(rover: PlantParameters, random: np.random.Generator) -> PlantParameters:
    """The rover with other tyres, springs, inertia and servo, each by a factor of .9 to 1.15."""
    return replace(rover, **{name: getattr(rover, name) * random.uniform(0.9, 1.15) for name in VARIED})


def drive(
    rover: PlantParameters, course_from: Sequence[Path], folder: Path, seed: int, share: float = 1.0
) -> list[Path]:
    """Recordings of the rover with the steering and a share of the speed of others."""
    folder.mkdir(parents=True)
    out = []
    for k, source in enumerate(course_from):
        course = course_of(screened(read_logs(str(source))[0]))
        target = folder / f"{folder.name}-{source.stem}.BIN"
        redrive(replace(course, speed=share * course.speed), rover, target, seed + k)
        out.append(target)
    return out


def vehicle_file(rover: PlantParameters, random: np.random.Generator) -> str:
    """The rover as its owner measured it."""

    def measured(name: str, value: float, error: float) -> str:
        return f"{name} = {{ value = {value + error * random.standard_normal():.5g}, sd = {error:.3g} }}"

    lines = ["[vehicle]", 'name = "drawn"']
    lines.append(measured("mass", rover.mass, 0.01))
    lines.append(measured("sprung_mass", rover.sprung_mass, 0.02))
    lines.append(measured("cg_to_front_axle", rover.cg_to_front_axle, 0.002))
    lines.append(measured("cg_to_rear_axle", rover.cg_to_rear_axle, 0.002))
    lines.append(measured("cg_height_above_roll_centre", rover.cg_height_above_roll_centre, 0.002))
    lines.append(measured("roll_inertia", rover.roll_inertia, 0.0008))
    lines.append(measured("yaw_inertia", rover.yaw_inertia, 0.003))
    lines += ["[steering]", f"trim_us = {rover.steering_trim_us}"]
    lines.append(measured("rad_per_us", rover.rad_per_us, 0.01 * rover.rad_per_us))
    lines += ["[imu]", f"position = {list(rover.imu_position)}"]
    return "\n".join(lines)
