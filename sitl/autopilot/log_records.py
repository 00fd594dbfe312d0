"""Log records of the embedded rover, at the rates of ArduRover.

IMU, ATT, XKF1 every main loop; RCIN, RCOU, STER, THR at 10 Hz; GPS with each fix; DSF at 1 Hz; GYR and ACC
with every IMU sample where bit 19 of LOG_BITMASK is set. The bits are those of Rover/defines.h.
"""

from __future__ import annotations

from math import atan2, cos, degrees, hypot, sin

from sitl.autopilot.rover import GPS_MS, Rover
from sitl.geodesy import ORIGIN, latitude_longitude
from sitl.plant.sensors import GpsFix

ATTITUDE_FAST, GPS, THROTTLE, IMU, STEERING, RC, IMU_RAW = (
    1 << 0,
    1 << 2,
    1 << 4,
    1 << 7,
    1 << 13,
    1 << 14,
    1 << 19,
)
IMU_TEMPERATURE = 35.0
GPS_WEEK, WEEK_MS = 2345, 7 * 86400 * 1000
FIX_3D, SATELLITES, HDOP = 3, 10, 1.21


def heading(yaw: float) -> float:
    """Degrees 0..360 of a yaw in rad."""
    return degrees(yaw) % 360.0


class LogRecords:
    """Writes one rover's records; `loop` after every main loop."""

    def __init__(self, rover: Rover) -> None:
        self.rover = rover
        self._gps: GpsFix | None = None
        rover.on_sample = self._sample

    def loop(self) -> None:
        """The records that are due after this main loop."""
        rover = self.rover
        mask = int(rover.parameters["LOG_BITMASK"])
        if rover.due(1):
            rover.log.statistics()
        if rover.log.active:
            self._every_loop(mask)
            if rover.due(10):
                self._ten_hertz(mask)
            if mask & GPS and rover.sensors.gps is not self._gps and rover.now_ms >= GPS_MS:
                self._gps = rover.sensors.gps
                self._fix(self._gps)

    def _sample(self) -> None:
        """GYR and ACC, unfiltered, at the plant's rate."""
        rover = self.rover
        if not int(rover.parameters["LOG_BITMASK"]) & IMU_RAW or (writer := rover.log.writer) is None:
            return
        writer.write("GYR", rover.now_us, 0, rover.now_us, *rover.sensors.gyro_raw)
        writer.write("ACC", rover.now_us, 0, rover.now_us, *rover.sensors.accel_raw)

    def _every_loop(self, mask: int) -> None:
        rover, writer = self.rover, self.rover.log.writer
        if writer is None:
            return
        sensors, now = rover.sensors, rover.now_us
        roll, pitch, yaw = sensors.attitude
        roll, pitch, yaw = degrees(roll), degrees(pitch), heading(yaw)
        if mask & ATTITUDE_FAST:
            writer.write("ATT", now, 0.0, roll, 0.0, pitch, 0.0, yaw, 3)
            if rover.origin_set:
                vn, ve, vd = sensors.velocity
                pn, pe, pd = sensors.position
                writer.write(
                    "XKF1",
                    rover.log.stamp("XKF1"),
                    0,
                    roll,
                    pitch,
                    yaw,
                    vn,
                    ve,
                    vd,
                    vd,
                    pn,
                    pe,
                    pd,
                    0.0,
                    0.0,
                    0.0,
                    ORIGIN[2],
                )
        if mask & IMU:
            rate = round(sensors.rate_hz)
            writer.write(
                "IMU", now, 0, *sensors.gyro, *sensors.accel, 0, 0, IMU_TEMPERATURE, 1, 1, rate, rate
            )

    def _ten_hertz(self, mask: int) -> None:
        rover, log = self.rover, self.rover.log
        p, sensors, servos = rover.parameters, rover.sensors, rover.servos
        if mask & THROTTLE:
            throttle_in = rover.radio.angle(int(p["RCMAP_THROTTLE"]), 100.0)
            log.write("THR", int(throttle_in), servos.throttle, 0.0, forward_speed(rover), sensors.accel[0])
        if mask & STEERING:
            steering_in = rover.radio.angle(int(p["RCMAP_ROLL"]), 4500.0)
            turn = degrees(sensors.gyro[2])
            log.write("STER", int(steering_in), servos.steering, 0.0, sensors.accel[1], 0.0, turn)
        if mask & RC:
            log.write("RCIN", *rover.radio.pwm[:14])
            log.write("RCOU", *servos.pwm[:14])

    def _fix(self, fix: GpsFix | None) -> None:
        if fix is None:
            return
        latitude, longitude = latitude_longitude(fix.position[0], fix.position[1])
        vn, ve, vd = fix.velocity
        course = heading(atan2(ve, vn))
        time_of_week = round(fix.t * 1000) % WEEK_MS
        place = (latitude, longitude, ORIGIN[2] - fix.position[2])
        speed = (hypot(vn, ve), course, vd)
        self.rover.log.write(
            "GPS", 0, FIX_3D, time_of_week, GPS_WEEK, SATELLITES, HDOP, *place, *speed, 0.0, 1
        )


def forward_speed(rover: Rover) -> float:
    """Estimated speed along the heading, m/s."""
    vn, ve, _ = rover.sensors.velocity
    yaw = rover.sensors.attitude[2]
    return vn * cos(yaw) + ve * sin(yaw)
