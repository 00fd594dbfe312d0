"""Numbers of the paper: Ivler, Gowans and Marfise 2022, Tables 1 to 7.

Values are as printed; `DOUBTS` explains the doubtful ones. Percentages are Cramer-Rao bound and
insensitivity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, LowPass, Recording, Signal, steered
from rover_sweep.logs.log import body_velocity
from rover_sweep.manoeuvre.sweep import Manoeuvre
from sitl.plant.plant import GRAVITY, Plant
from sitl.plant.sensors import Sensors
from sitl.plant.variant import PlantParameters

PAPER = (
    "Ivler, Gowans and Marfise, System identification of rover dynamics: a comparison of three model "
    "structures, Int. J. Modelling, Identification and Control 40 (1), 2022, pp. 70-83"
)


@dataclass(frozen=True)
class Printed:
    """A parameter of Tables 2 to 4. value in SI units; cr, insensitivity [%], None if it was fixed."""

    value: float
    cr: float | None = None
    insensitivity: float | None = None

    @property
    def free(self) -> bool:
        """Whether the authors identified it."""
        return self.cr is not None


@dataclass(frozen=True)
class TimeDomain:
    """A row of Tables 6 and 7: j_rms in units that the paper does not state; tic from 0 to 1."""

    j_rms: float
    tic: float


# Table 1: amplitude [us], w_min, w_max [rad/s], T_rec [s]
SWEEP: Mapping[str, float] = {"amplitude": 150.0, "w_min": 0.3, "w_max": 25.0, "t_rec": 55.0}

# Tables 2, 3 and 4: what was free and what Table 4 set to zero; C is per axle, front and rear tied
PARAMETERS: Mapping[str, Mapping[str, Printed]] = {
    "bicycle": {
        "C": Printed(22.6, 3.76, 1.85),
        "Izz": Printed(0.085, 14.4, 5.56),
        "tau": Printed(0.072, 7.97, 3.04),
    },
    "roll-yaw": {
        "C": Printed(35.34, 4.42, 1.62),
        "Izz": Printed(0.056, 8.10, 3.17),
        "k_phi": Printed(10.4, 3.81, 1.82),
        "b_phi": Printed(0.828, 8.88, 3.91),
        "tau": Printed(0.088, 7.97, 3.04),
    },
    "lumped": {
        "Y_v": Printed(0.0),
        "Y_p": Printed(1.80, 30.2, 7.98),
        "Y_r": Printed(0.0),
        "Y_phi": Printed(0.0),
        "Y_delta": Printed(71.5, 28.5, 3.40),
        "L_v": Printed(0.0),
        "L_p": Printed(-17.5, 19.3, 2.64),
        "L_r": Printed(-6.50, 16.1, 0.652),
        "L_phi": Printed(0.0),
        "L_delta": Printed(31.1, 16.4, 0.625),
        "N_v": Printed(-1.87, 33.0, 10.2),
        "N_p": Printed(36.6, 15.2, 2.19),
        "N_r": Printed(-9.13, 18.0, 0.832),
        "N_phi": Printed(71.52, 28.5, 3.4),
        "N_delta": Printed(32.0, 25.7, 1.09),
        "tau": Printed(0.0711, 5.22, 1.52),
    },
}
SPEED = 2.4  # m/s, Tables 2 to 4; Tables 5 and 6 say 2.1 m/s
SWING_TEST = {"Izz": 0.064, "Ixx": 0.008}  # kg m^2, section 2.2

# Section 5: bands used in the fits, rad/s, from a coherence of at least 0.6
BANDS: Mapping[str, tuple[float, float]] = {
    "r": (0.2, 25.0),
    "ay": (0.2, 25.0),
    "vydot": (3.0, 25.0),
    "p": (0.6, 20.0),
}

# Table 5: cost J of each response, and the average
COSTS: Mapping[str, Mapping[str, float]] = {
    "bicycle": {"r": 86.0, "ay": 66.8, "vydot": 99.7, "average": 84.2},
    "roll-yaw": {"r": 51.6, "ay": 22.1, "vydot": 121.5, "p": 58.0, "average": 63.3},
    "lumped": {"r": 7.69, "ay": 15.0, "vydot": 20.8, "p": 45.1, "average": 22.1},
}

# Table 6 (asphalt, 2.1 m/s) and Table 7 (artificial grass; asphalt at 4 m/s)
VERIFICATION: Mapping[str, Mapping[str, TimeDomain]] = {
    "asphalt": {
        "bicycle": TimeDomain(0.84, 0.18),
        "roll-yaw": TimeDomain(0.40, 0.10),
        "lumped": TimeDomain(0.64, 0.17),
    },
    "grass": {
        "bicycle": TimeDomain(0.886, 0.22),
        "roll-yaw": TimeDomain(0.56, 0.19),
        "lumped": TimeDomain(0.810, 0.24),
    },
    "fast": {
        "bicycle": TimeDomain(2.7, 0.18),
        "roll-yaw": TimeDomain(1.41, 0.15),
        "lumped": TimeDomain(3.3, 0.45),
    },
}
PEAK_YAW_RATE = (40.0, 45.0)  # deg/s at +-150 us, section 4

DOUBTS: Mapping[str, str] = {
    "N_phi": "has the same figures as Y_δ: one of the two is a copying error, more likely Y_δ",
    "tau": "Table 3 has the same bounds of τ as Table 2",
    "grass": (
        "section 8.1 ranks the lumped model last by its cost; Table 7 has the bicycle's cost (0.886) above "
        "the lumped model's (0.810), while the TIC agrees with the text"
    ),
    "Izz": (
        "section 6.1 calls 0.085 within 25 % of 0.064 kg m²: it is 33 % above it, 25 % of the identified "
        "value"
    ),
}


# A run of the virtual rover in this process: plant, sensors and the applet's wave at the loop rate.
#
# There is no link, so a run depends on its arguments alone.


PHYSICS_HZ = 400
STILL, SETTLING = 2.0, 6.0  # s: standstill, then acceleration, before the manoeuvre
AFTER = 4.0  # s of straight driving after the manoeuvre


@dataclass(frozen=True)
class Firmware:
    """ArduRover's rates and low-passes [Hz]: SCHED_LOOP_RATE, INS_GYRO_FILTER, INS_ACCEL_FILTER, as
    shipped."""

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
        "pwm": Signal(t, pwm, "us", "applet", hold=True, origin="commanded"),
        "throttle": Signal(t, throttle, "us", "throttle", hold=True),
        "r": Signal(t, -gz, "rad/s", "gyro z"),
        "p": Signal(t, gx, "rad/s", "gyro x"),
        "ay": Signal(t, -ay, "m/s^2", "accelerometer y"),
        "phi": Signal(t, roll, "rad", "estimator"),
        "psi": Signal(t, psi, "rad", "estimator"),
        **body_velocity(t, north, east, psi, "estimator"),
    }
