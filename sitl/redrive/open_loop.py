"""The plant alone, driven by a recorded steering staircase at a recorded speed."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from math import ceil
from pathlib import Path

import numpy as np

from sitl.plant.plant import Plant
from sitl.plant.sensors import Sensors
from sitl.plant.variant import PlantParameters
from sitl.redrive.course import Array, Course
from sitl.redrive.flight_log import FlightLog
from sitl.redrive.speed import SpeedFollower

PHYSICS_S = 0.0025  # longest step of the plant
LARGEST_ROLL, FASTEST_YAW = 1.5, 30.0  # rad, rad/s: beyond, the wheels are off the ground
OUTPUTS_S = 0.1  # between two RCOU, as ArduRover logs them
FACTORY_GYRO_HZ, FACTORY_ACCEL_HZ = 4.0, 10.0


def redrive(
    course: Course,
    parameters: PlantParameters,
    out: Path,
    seed: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Array:
    """Drives the course and writes the log to `out`, on the clock of the course.

    Returns the simulated speed (n,) m/s at the loops. `progress` receives the share done, 0 to 1.
    ValueError where the rover overturns.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = FlightLog(Path(folder), course.parameters, parameters.effects)
        speeds = _drive(course, parameters, log, seed, progress)
        out.write_bytes(log.close().read_bytes())
    return speeds


def _drive(
    course: Course, parameters: PlantParameters, log: FlightLog, seed: int, progress: Callable[[float], None]
) -> Array:
    plant = Plant(parameters, seed)
    plant.state.t, plant.state.psi = float(course.t[0]), course.heading
    steps = ceil(course.loop_s / PHYSICS_S - 1e-6)
    sensors = Sensors(parameters, seed, steps / course.loop_s, *_filters(course))
    follower = SpeedFollower(parameters, course.loop_s)
    rates = np.gradient(course.speed, course.t)
    sensors.update(plant.state)
    log.begin(float(course.t[0]))
    rows, marks = _applet_rows(course), iter(course.marks)
    row, mark = next(rows, None), next(marks, None)
    outputs_due, speeds = float(course.t[0]), np.zeros(course.t.size)
    # without the applet only this message has the steering: at the rate of the loop, stamped in the middle of
    # what is held, as readers take RCOU for samples of something finer
    dense, half = course.applet is None, 0.5 * course.loop_s
    for k, (t, end) in enumerate(zip(course.t[:-1].tolist(), course.t[1:].tolist(), strict=True)):
        steering = float(course.steering[k])
        if dense or t >= outputs_due:
            outputs_due = max(outputs_due + OUTPUTS_S, t)
            log.outputs(t + half if dense else t, steering)
        throttle = follower.throttle(float(course.speed[k]), float(rates[k]), plant.state.vx)
        for _ in range(steps):
            plant.step(steering, throttle, (end - t) / steps)
            sensors.update(plant.state)
        while mark is not None and mark[0] <= end:
            log.text(*mark)
            mark = next(marks, None)
        while row is not None and row[0] <= end:
            log.applet(*row, sensors)
            row = next(rows, None)
        _refuse_overturned(plant, end - float(course.t[0]))
        log.loop(end, sensors)
        speeds[k + 1] = plant.state.vx
        if k % 1000 == 0:
            progress(k / course.t.size)
    return speeds


def _refuse_overturned(plant: Plant, after: float) -> None:
    """ValueError where the simulated rover overturns or spins."""
    roll, yaw_rate = plant.state.phi, plant.state.r
    if not (abs(roll) < LARGEST_ROLL and abs(yaw_rate) < FASTEST_YAW):
        raise ValueError(
            f"the simulated rover overturns or spins {after:.1f} s into the drive (roll {roll:.3g} rad, yaw "
            f"rate {yaw_rate:.3g} rad/s); give it smaller effects, or numbers of a rover that holds the road"
        )


def _applet_rows(course: Course) -> Iterator[tuple[float, float, float, float, float]]:
    if course.applet is None:
        return iter(())
    a = course.applet
    rows: Iterator[tuple[float, float, float, float, float]] = zip(
        a.t.tolist(), a.run.tolist(), a.state.tolist(), a.clock.tolist(), a.out.tolist(), strict=True
    )
    return rows


def _filters(course: Course) -> tuple[float, float]:
    """Cut-offs [Hz] of the recorded rover's low-passes, gyro and accelerometer."""
    have = course.parameters
    return have.get("INS_GYRO_FILTER", FACTORY_GYRO_HZ), have.get("INS_ACCEL_FILTER", FACTORY_ACCEL_HZ)
