"""The test plan of the study: manoeuvres, grounds, speeds and seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep
from rover_sweep.study.published import SPEED, SWEEP
from rover_sweep.study.virtual_drive import Firmware, virtual_drive
from sitl.plant.variant import PlantParameters, load_variant

SWEEPS = 3
FAST = 4.0  # m/s
# Figure 7 has its steps at 2.4 and 4.8 s. The amplitudes of the doublets are not published; at 4 m/s the
# sweep's 150 us would take the tyres past half of their grip.
DOUBLET = Doublet(amplitude=150.0, pulse=2.4, pause=2.4, count=2, straight=2.4)
FAST_DOUBLET = Doublet(amplitude=100.0, pulse=2.4, pause=2.4, count=2, straight=2.4)
CHECKS: Mapping[str, str] = {
    "asphalt": f"doublet on asphalt, {SPEED:g} m/s",
    "grass": f"doublet on artificial grass, {SPEED:g} m/s",
    "fast": f"doublet on asphalt, {FAST:g} m/s",
}
Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class StudyRuns:
    """All runs. checks: the doublets by the keys of CHECKS, which no fit uses."""

    asphalt: PlantParameters
    grass: PlantParameters
    firmware: Firmware
    sweeps: tuple[Recording, ...]
    checks: Mapping[str, Recording]


def drive_all(seed: int, progress: Progress) -> StudyRuns:
    """Drives the whole plan on the published rover. The seed gives every run its own noise and road."""
    asphalt, grass, firmware = load_variant("paper_asphalt"), load_variant("paper_grass"), Firmware()
    sweep = Sweep(SWEEP["amplitude"], SWEEP["w_min"], SWEEP["w_max"], SWEEP["t_rec"])
    plan: list[tuple[str, PlantParameters, Manoeuvre, float]] = [
        *((f"sweep {k + 1} on asphalt", asphalt, sweep, SPEED) for k in range(SWEEPS)),
        (CHECKS["asphalt"], asphalt, DOUBLET, SPEED),
        (CHECKS["grass"], grass, DOUBLET, SPEED),
        (CHECKS["fast"], asphalt, FAST_DOUBLET, FAST),
    ]
    recordings = []
    for k, (name, rover, manoeuvre, speed) in enumerate(plan):
        progress(k / len(plan), f"driving {name}")
        recordings.append(virtual_drive(name, rover, manoeuvre, speed, 1000 * seed + k, firmware))
    checks = dict(zip(CHECKS, recordings[SWEEPS:], strict=True))
    return StudyRuns(asphalt, grass, firmware, tuple(recordings[:SWEEPS]), checks)


def geometry(rover: PlantParameters) -> Geometry:
    """The numbers that the authors knew: fixed rows of Tables 2 and 3, and a swing test without error."""
    forward, _, down = rover.imu_position
    return Geometry(
        mass=rover.mass,
        a=rover.cg_to_front_axle,
        b=rover.cg_to_rear_axle,
        sprung_mass=rover.sprung_mass,
        h=rover.cg_height_above_roll_centre,
        roll_inertia=rover.roll_inertia,
        yaw_inertia=rover.yaw_inertia,
        imu_x=forward,
        imu_z=rover.cg_height_above_roll_centre - down,
    )
