"""Reads a wheel's IMU: a CSV file with time and angle or rate, or telemetry of a vehicle on the wheel."""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np

from rover_sweep.bench.wheel_problem import Wheel
from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused, UsageError

_SECONDS = {
    "t": 1.0,
    "time": 1.0,
    "t_s": 1.0,
    "time_s": 1.0,
    "timestamp": 1.0,
    "seconds": 1.0,
    "time_ms": 1e-3,
    "timestamp_ms": 1e-3,
    "time_boot_ms": 1e-3,
    "time_us": 1e-6,
    "timeus": 1e-6,
    "time_usec": 1e-6,
    "timestamp_us": 1e-6,
    "timestamp_ns": 1e-9,
}
_DEGREE = float(np.pi / 180)
_ANGLES = {
    "angle": 1.0,
    "yaw": 1.0,
    "angle_rad": 1.0,
    "yaw_rad": 1.0,
    "angle_deg": _DEGREE,
    "yaw_deg": _DEGREE,
}
_RATES = {
    "rate": 1.0,
    "yaw_rate": 1.0,
    "yawrate": 1.0,
    "yawspeed": 1.0,
    "gyro_z": 1.0,
    "gz": 1.0,
    "gyrz": 1.0,
    "rate_rad_s": 1.0,
    "yaw_rate_rad_s": 1.0,
    "rate_deg_s": _DEGREE,
    "yaw_rate_deg_s": _DEGREE,
    "gyro_z_deg_s": _DEGREE,
}
ARRIVAL = 0.02  # s, uncertainty of two clocks aligned by the arrival of their messages


def read_wheel(path: Path, same_clock: bool) -> Wheel:
    """A CSV with a header of one time column and one of the angle or the rate. UsageError, DataRefused."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise UsageError(f"there is no file {path}; give the wheel's record with --wheel-imu FILE") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataRefused(f"{path} cannot be read: {error}") from error
    names = [name.strip().strip('"').lower() for name in lines[0].split(",")] if lines else []
    time = next((k for k, name in enumerate(names) if name in _SECONDS), None)
    angle = next((k for k, name in enumerate(names) if name in _ANGLES), None)
    rate = next((k for k, name in enumerate(names) if name in _RATES), None)
    column = angle if angle is not None else rate
    if time is None or column is None:
        raise DataRefused(
            f"{path} needs a header with a time (t, time_ms, time_us) and the wheel's angle (angle, "
            f"angle_deg, yaw) or rate (rate, rate_deg_s, gyro_z); it has {', '.join(names) or 'nothing'}"
        )
    rows = [row.split(",") for row in lines[1:] if row.strip()]
    if rows and len(rows[-1]) < len(names):  # cut off while it was written
        rows.pop()
    try:
        t = np.array([float(row[time]) for row in rows]) * _SECONDS[names[time]]
        value = np.array([float(row[column]) for row in rows])
    except (ValueError, IndexError) as error:
        raise DataRefused(f"{path}: a row is damaged ({error})") from error
    value *= _ANGLES[names[column]] if angle is not None else _RATES[names[column]]
    return _checked(path, t, value, angle is None, 0.0 if same_clock else inf)


def wheel_of_telemetry(path: Path, arrival_less_clock: float) -> Wheel:
    """ATTITUDE.yaw of a vehicle on the wheel. arrival_less_clock: our clock minus the rover's [s].

    The yaw of ArduPilot's EKF comes from the gyro before its low-pass filter, yawspeed from behind it.
    """
    from rover_sweep.logs.readers.tlog import open_tlog

    frames = open_tlog(path, frozenset({"ATTITUDE"})).messages.get("ATTITUDE")
    if frames is None:
        raise DataRefused(f"{path} has no ATTITUDE of the vehicle on the wheel")
    own = frames.rows["time_boot_ms"].astype(float) * 1e-3
    ahead = float(np.min(arrivals(path, frames.order) - own))
    yaw = np.unwrap(frames.rows["yaw"].astype(float))
    return _checked(path, own + ahead - arrival_less_clock, yaw, False, ARRIVAL)


def arrivals(path: Path, order: np.ndarray) -> Array:
    """When the frames that begin at these bytes of a .tlog came in, (n,) s of our clock."""
    data = path.read_bytes()
    return np.array([int.from_bytes(data[k - 8 : k], "big") for k in order.tolist()]) * 1e-6


def _checked(path: Path, t: Array, value: Array, is_rate: bool, clock: float) -> Wheel:
    keep = np.isfinite(t) & np.isfinite(value)
    t, value = t[keep], value[keep]
    keep = np.concatenate(([True], t[1:] > np.maximum.accumulate(t)[:-1])) if t.size else keep[:0]
    t, value = t[keep], value[keep]
    if t.size < 100:
        raise DataRefused(f"{path} has only {t.size} samples of the wheel in order of time")
    if float(np.median(np.diff(t))) > 0.05:
        raise DataRefused(
            f"{path} has a sample every {np.median(np.diff(t)):.2g} s; a servo needs one every 0.02 s (50 Hz)"
        )
    if not is_rate:
        value = np.unwrap(value)
    return Wheel(t, value, is_rate, clock)
