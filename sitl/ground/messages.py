"""The embedded rover's MAVLink messages: units, signs and clock fields as ArduRover 4.6.3 sends them.

Integers are cut towards zero as its C casts do. One IMU, no compass: SCALED_IMU2 is accepted as a stream
but never sent, as on a vehicle with one IMU. LOCAL_POSITION_NED is absent until the EKF has an origin.
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, pi, sin
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.log_records import FIX_3D, GPS_WEEK, HDOP, IMU_TEMPERATURE, SATELLITES, WEEK_MS, heading
from sitl.autopilot.radio import CHANNEL_COUNT
from sitl.autopilot.rover import GPS_MS, HOLD, MANUAL, Rover
from sitl.autopilot.version import OFFICIAL_RELEASE, VERSION
from sitl.geodesy import ORIGIN, latitude_longitude
from sitl.plant.variant import GRAVITY

Message = Any  # pymavlink's classes carry no types
GPS_EPOCH_UNIX_MS = 315_964_800_000 - 18_000  # 1980-01-06 and 18 leap seconds
MILLI_G = 1000.0 / GRAVITY
ROVER_TYPE, ARDUPILOT = mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
EKF_READY, EKF_WITHOUT_GPS = 831, 165
SENSORS = 1 << 0 | 1 << 1 | 1 << 5 | 1 << 11 | 1 << 15 | 1 << 16 | 1 << 21 | 1 << 24
PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK


def heartbeat(rover: Rover) -> Message:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    base |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED if rover.mode == MANUAL else 0
    base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if rover.armed else 0
    status = mavlink.MAV_STATE_STANDBY if rover.mode == HOLD else mavlink.MAV_STATE_ACTIVE
    if rover.failsafe_triggered:
        status = mavlink.MAV_STATE_CRITICAL
    return mavlink.MAVLink_heartbeat_message(ROVER_TYPE, ARDUPILOT, base, rover.mode, status, 3)


def sys_status(rover: Rover) -> Message:
    healthy = SENSORS if rover.now_ms >= GPS_MS else SENSORS & ~(1 << 5)
    if rover.radio.lost(rover.now_ms):
        healthy &= ~(1 << 16)
    enabled = SENSORS | (PREARM if rover.parameters["ARMING_CHECK"] else 0)
    if enabled & PREARM and (rover.armed or rover.prearm_passed):
        healthy |= PREARM
    return mavlink.MAVLink_sys_status_message(
        SENSORS | PREARM, enabled, healthy, 0, 12600, -1, 100, 0, 0, 0, 0, 0, 0
    )


def system_time(rover: Rover) -> Message:
    unix_us = (GPS_EPOCH_UNIX_MS + GPS_WEEK * WEEK_MS) * 1000 + rover.now_us
    return mavlink.MAVLink_system_time_message(unix_us if rover.now_ms >= GPS_MS else 0, rover.now_ms)


def _imu(rover: Rover) -> tuple[int, ...]:
    """mG and mrad/s, FRD, and no compass."""
    (ax, ay, az), (gx, gy, gz) = rover.sensors.accel, rover.sensors.gyro
    acceleration = (int(ax * MILLI_G), int(ay * MILLI_G), int(az * MILLI_G))
    return (*acceleration, int(gx * 1000.0), int(gy * 1000.0), int(gz * 1000.0), 0, 0, 0)


def raw_imu(rover: Rover) -> Message:
    return mavlink.MAVLink_raw_imu_message(rover.now_us, *_imu(rover), 0, int(IMU_TEMPERATURE * 100))


def scaled_imu(rover: Rover) -> Message:
    return mavlink.MAVLink_scaled_imu_message(rover.now_ms, *_imu(rover), int(IMU_TEMPERATURE * 100))


def scaled_imu2(rover: Rover) -> None:
    """There is no second IMU."""


def highres_imu(rover: Rover) -> Message:
    accelerometer_and_gyro = 0x3F
    unused = (0.0,) * 6
    return mavlink.MAVLink_highres_imu_message(
        rover.now_us,
        *rover.sensors.accel,
        *rover.sensors.gyro,
        *unused,
        IMU_TEMPERATURE,
        accelerometer_and_gyro | 0x1000,
    )


def attitude(rover: Rover) -> Message:
    roll, pitch, yaw = rover.sensors.attitude
    wrapped = (yaw + pi) % (2 * pi) - pi
    return mavlink.MAVLink_attitude_message(rover.now_ms, roll, pitch, wrapped, *rover.sensors.gyro)


def attitude_quaternion(rover: Rover) -> Message:
    return mavlink.MAVLink_attitude_quaternion_message(
        rover.now_ms, *quaternion(*rover.sensors.attitude), *rover.sensors.gyro
    )


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """w, x, y, z of the rotation yaw, then pitch, then roll."""
    cr, sr = cos(roll / 2), sin(roll / 2)
    cp, sp = cos(pitch / 2), sin(pitch / 2)
    cy, sy = cos(yaw / 2), sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def local_position_ned(rover: Rover) -> Message | None:
    if not rover.origin_set:
        return None
    return mavlink.MAVLink_local_position_ned_message(
        rover.log.stamp("XKF1") // 1000, *rover.sensors.position, *rover.sensors.velocity
    )


def global_position_int(rover: Rover) -> Message:
    ready = rover.origin_set
    north, east, down = rover.sensors.position if ready else (0.0, 0.0, 0.0)
    vn, ve, vd = rover.sensors.velocity if ready else (0.0, 0.0, 0.0)
    latitude, longitude = latitude_longitude(north, east) if ready else (0.0, 0.0)
    height = int((ORIGIN[2] - down) * 1000)
    speeds = (int(vn * 100), int(ve * 100), int(vd * 100))
    course = int(heading(rover.sensors.attitude[2]) * 100)
    return mavlink.MAVLink_global_position_int_message(
        rover.now_ms, int(latitude * 1e7), int(longitude * 1e7), height, int(-down * 1000), *speeds, course
    )


def gps_raw_int(rover: Rover) -> Message:
    fix = rover.sensors.gps
    if fix is None or rover.now_ms < GPS_MS:
        return mavlink.MAVLink_gps_raw_int_message(0, 1, 0, 0, 0, 9999, 9999, 0, 0, 0)
    latitude, longitude = latitude_longitude(fix.position[0], fix.position[1])
    vn, ve, _ = fix.velocity
    height = int((ORIGIN[2] - fix.position[2]) * 1000)
    place = (int(latitude * 1e7), int(longitude * 1e7), height)
    speed = (int(hypot(vn, ve) * 100), int(heading(atan2(ve, vn)) * 100))
    return mavlink.MAVLink_gps_raw_int_message(
        round(fix.t * 1e3) * 1000, FIX_3D, *place, int(HDOP * 100), 200, *speed, SATELLITES
    )


def servo_output_raw(rover: Rover) -> Message:
    wrapped = rover.log.stamp("RCOU") & 0xFFFFFFFF  # 32 bits: back to 0 after 71 minutes
    return mavlink.MAVLink_servo_output_raw_message(wrapped, 0, *rover.servos.pwm[:16])


def rc_channels(rover: Rover) -> Message:
    count = CHANNEL_COUNT if rover.radio.seen else 0
    return mavlink.MAVLink_rc_channels_message(rover.now_ms, count, *rover.radio.pwm[:16], 0, 0, 255)


def vfr_hud(rover: Rover) -> Message:
    vn, ve, vd = rover.sensors.velocity
    course = int(heading(rover.sensors.attitude[2]))
    throttle = abs(int(rover.servos.throttle))
    return mavlink.MAVLink_vfr_hud_message(0.0, hypot(vn, ve), course, throttle, ORIGIN[2], -vd)


def ekf_status_report(rover: Rover) -> Message:
    flags = EKF_READY if rover.origin_set else EKF_WITHOUT_GPS
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.01, 0.01, 0.01, 0.01, 0.0, 0.0)


def autopilot_version(rover: Rover) -> Message:
    major, minor, patch = VERSION
    number = major << 24 | minor << 16 | patch << 8 | OFFICIAL_RELEASE
    able = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    able |= mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    custom = list(b"embedded")
    return mavlink.MAVLink_autopilot_version_message(able, number, 0, 0, 0, custom, custom, custom, 0, 0, 0)


BUILDERS: dict[int, Callable[[Rover], Message | None]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: raw_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU: scaled_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: scaled_imu2,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: highres_imu,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: servo_output_raw,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: rc_channels,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
}
"""Maker of each message id; it returns None when no message is due."""

STREAM_GROUPS: dict[int, str] = {
    mavlink.MAVLINK_MSG_ID_RAW_IMU: "RAW_SENS",
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: "RAW_SENS",
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: "EXT_STAT",
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: "EXT_STAT",
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: "POSITION",
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: "POSITION",
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: "RC_CHAN",
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: "RC_CHAN",
    mavlink.MAVLINK_MSG_ID_ATTITUDE: "EXTRA1",
    mavlink.MAVLINK_MSG_ID_VFR_HUD: "EXTRA2",
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: "EXTRA3",
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: "EXTRA3",
}
"""The SR0_ parameter that gives a message's default rate; messages that are not here are off by default."""


def default_interval_ms(rover: Rover, message_id: int) -> int | None:
    """Interval of a message that nobody asked for; 0 not sent, None where the vehicle does not have it."""
    if message_id not in BUILDERS:
        return None
    if message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
        return 1000
    group = STREAM_GROUPS.get(message_id)
    rate = rover.parameters[f"SR0_{group}"] if group else 0
    return int(1000 / rate) if rate > 0 else 0
