"""A run of the virtual rover in this process: plant, sensors and the applet's wave at the loop rate.

There is no link, so a run depends on its arguments alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, LowPass, Recording, Signal, steered
from rover_sweep.logs.log import body_velocity
from rover_sweep.manoeuvre.sweep import Manoeuvre
from sitl.plant.plant import GRAVITY, Plant
from sitl.plant.sensors import Sensors
from sitl.plant.variant import PlantParameters

PHYSICS_HZ = 400
STILL, SETTLING = 2.0, 6.0  # s: standstill, then acceleration, before the manoeuvre
AFTER = 4.0  # s of straight driving after the manoeuvre


@dataclass(frozen=True)
class Firmware:
    """ArduRover's rates and low-passes [Hz]: SCHED_LOOP_RATE, INS_GYRO_FILTER, INS_ACCEL_FILTER, as "
    "shipped."""

    loop_hz: int = 50
    gyro_filter_hz: float = 4.0
    accel_filter_hz: float = 10.0

    def __post_init__(self) -> None:
        if PHYSICS_HZ % self.loop_hz:
            raise ValueError(f"loop_hz = {self.loop_hz} must divide {PHYSICS_HZ}")

    @property
    def filters(self) -> dict[str, LowPass]:
        """The known low-pass of each channel."""
        gyro = LowPass(self.gyro_filter_hz, "INS_GYRO_FILTER")
        return {"r": gyro, "p": gyro, "ay": LowPass(self.accel_filter_hz, "INS_ACCEL_FILTER")}


def virtual_drive(
    name: str,
    rover: PlantParameters,
    manoeuvre: Manoeuvre,
    speed: float,
    seed: int,
    firmware: Firmware | None = None,
) -> Recording:
    """The run as a log would give it: SI units, ISO axes, one row per main loop, true steering scale.

    speed [m/s]: in straight driving at the constant throttle; corners slow the rover down.
    """
    autopilot = firmware or Firmware()
    start = STILL + SETTLING
    end = start + manoeuvre.duration
    rows = _rows(
        rover,
        autopilot,
        seed,
        end + AFTER,
        _throttle(rover, speed),
        lambda t: float(manoeuvre.wave(t - start)),
    )
    recording = Recording(
        name,
        _channels(rows),
        (start, end),
        manoeuvre.kind,
        standstill=((0.0, STILL),),
        straight=((start - 1.0, start + manoeuvre.straight), (end - manoeuvre.straight, end + AFTER)),
        filters=autopilot.filters,
        firmware="virtual rover",
    )
    return steered(recording, rover.steering_trim_us, rover.rad_per_us)


def _throttle(rover: PlantParameters, speed: float) -> float:
    """PWM [us] that holds a speed [m/s] against rolling resistance."""
    wanted = speed + rover.rolling_resistance * GRAVITY * rover.speed_lag
    return float(round(rover.throttle_trim_us + wanted / rover.speed_per_us))


def _rows(
    rover: PlantParameters,
    firmware: Firmware,
    seed: int,
    duration: float,
    throttle: float,
    wave: Callable[[float], float],
) -> Array:
    """(n, 10): t, pwm, throttle, gyro x and z, accel y, roll, yaw, velocity north and east; FRD, NED."""
    plant = Plant(rover, seed)
    sensors = Sensors(rover, seed, PHYSICS_HZ, firmware.gyro_filter_hz, firmware.accel_filter_hz)
    inner, dt = PHYSICS_HZ // firmware.loop_hz, 1.0 / PHYSICS_HZ
    sensors.update(plant.state)
    rows = []
    for k in range(int(duration * firmware.loop_hz) + 1):
        t = k / firmware.loop_hz
        steering = rover.steering_trim_us + round(wave(t))
        drive_us = throttle if t >= STILL else rover.throttle_trim_us
        (gx, _, gz), (_, ay, _) = sensors.gyro, sensors.accel
        (roll, _, yaw), (north, east, _) = sensors.attitude, sensors.velocity
        rows.append((t, steering, drive_us, gx, gz, ay, roll, yaw, north, east))
        for _ in range(inner):
            plant.step(steering, drive_us, dt)
            sensors.update(plant.state)
    return np.array(rows)


def _channels(rows: Array) -> dict[str, Signal]:
    """Channels of a recording from `_rows`: r, a_y and psi change sign from FRD to ISO."""
    t, pwm, throttle, gx, gz, ay, roll, yaw, north, east = rows.T.copy()
    psi = np.unwrap(-yaw)
    return {
        "pwm": Signal(t, pwm, "us", "applet", hold=True),
        "throttle": Signal(t, throttle, "us", "throttle", hold=True),
        "r": Signal(t, -gz, "rad/s", "gyro z"),
        "p": Signal(t, gx, "rad/s", "gyro x"),
        "ay": Signal(t, -ay, "m/s^2", "accelerometer y"),
        "phi": Signal(t, roll, "rad", "estimator"),
        "psi": Signal(t, psi, "rad", "estimator"),
        **body_velocity(t, north, east, psi, "estimator"),
    }
