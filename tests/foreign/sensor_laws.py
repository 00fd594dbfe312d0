"""Laws of the list in the instruments."""

from __future__ import annotations

from tests.foreign.law import Applied, Extras, Law, a_sign, share_of_base
from tests.foreign.rover import Rover


def _tilt(about: int) -> Applied:
    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        angles = list(rover.instruments.tilt)
        angles[about] += extras["sign"] * size
        return rover.sensing(tilt=tuple(angles))

    return apply


def _forward(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.sensing(imu_x=rover.instruments.imu_x + extras["sign"] * share_of_base(rover, size))


def _up(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.sensing(imu_z=rover.instruments.imu_z + extras["sign"] * share_of_base(rover, size))


def _sensors() -> list[Law]:
    laws = [
        Law("imu_tilt", axis, "imu", 0.06, 0.2, _tilt(k), "rad", extras=a_sign, own=True, absolute=k == 0)
        for k, axis in enumerate(("roll", "pitch"))
    ]
    laws += [
        Law(
            "sensor_filter",
            f"gyros {form}",
            "imu",
            0.02,
            0.12,
            _gyro_lag(form),
            "s",
            own=form == "second order",
        )
        for form in ("second order", "first order", "delay")
    ]
    return [
        *laws,
        Law(
            "sensor_filter",
            "accelerometer first order",
            "imu",
            0.02,
            0.12,
            lambda r, s, e: r.sensing(accel_lag=s),
            "s",
        ),
        Law(
            "sensor_scale",
            "gyros",
            "imu",
            0.06,
            0.35,
            lambda r, s, e: r.sensing(gyro_scale=1 + e["sign"] * s),
            extras=a_sign,
            own=True,
        ),
        Law(
            "sensor_scale",
            "accelerometer",
            "imu",
            0.06,
            0.35,
            lambda r, s, e: r.sensing(accel_scale=1 + e["sign"] * s),
            extras=a_sign,
        ),
        Law("imu_offset", "forward", "imu", 0.06, 0.5, _forward, "m", share_of_base, extras=a_sign, own=True),
        Law("imu_offset", "up", "imu", 0.06, 0.4, _up, "m", share_of_base, extras=a_sign, own=True),
        Law(
            "velocity_lag",
            "first order",
            "ekf",
            0.03,
            0.3,
            lambda r, s, e: r.sensing(velocity_lag=s),
            "s",
            own=True,
        ),
        Law(
            "velocity_lag",
            "delay",
            "ekf",
            0.03,
            0.3,
            lambda r, s, e: r.sensing(velocity_lag=s, velocity_form="delay"),
            "s",
        ),
    ]


def _gyro_lag(form: str) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.sensing(gyro_lag=size, gyro_form=form)

    return apply


SENSORS: tuple[Law, ...] = tuple(_sensors())
