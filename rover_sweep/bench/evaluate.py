"""Evaluates a bench's folder, right after the bench or later."""

from __future__ import annotations

from math import copysign
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.bench.bench_folder import (
    DESCRIPTION,
    TELEMETRY,
    WHEEL_CSV,
    WHEEL_TLOG,
    AngleReading,
    BenchFolder,
)
from rover_sweep.bench.bench_result import BenchResult
from rover_sweep.bench.by_hand import Readings, by_hand
from rover_sweep.bench.by_wheel import by_wheel
from rover_sweep.bench.wheel_file import arrivals, read_wheel, wheel_of_telemetry
from rover_sweep.bench.wheel_problem import Command, Wheel
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.errors import DataRefused


def evaluate(
    folder: BenchFolder, vehicle: Vehicle | None, wheel: Path | None = None, same_clock: bool | None = None
) -> BenchResult:
    """What a bench found. wheel: a file of the wheel's IMU in place of the folder's; same_clock: whether it
    is on the rover's clock, as the folder says if None. DataRefused where it holds too little."""
    content = folder.description()
    trim = float(content["steering_output"]["trim"])
    sign = copysign(1.0, vehicle.rad_per_us.value) if vehicle and vehicle.rad_per_us else None
    used = content.get("wheel")
    if wheel is None and not used:
        return by_hand(_in_order(folder.readings()), trim)
    if vehicle is not None and vehicle.trim_us is not None:
        trim = vehicle.trim_us.value
    command, ahead = _command(folder, content, trim)
    if same_clock is None:
        same_clock = bool(used and used.get("same_clock"))
    return by_wheel(command, _wheel(folder, wheel, same_clock, ahead), sign)


def _in_order(readings: tuple[AngleReading, ...]) -> Readings:
    """As they were taken; an angle is beside the PWM that was seen, or where none was, asked for."""
    if not readings:
        raise DataRefused("no angle was read in this bench, so there is nothing to evaluate")
    pwm = np.array([r.pwm for r in readings])
    return Readings(pwm, np.array([r.angle for r in readings]), readings[0].pwm - readings[0].offset)


def _command(folder: BenchFolder, content: dict[str, Any], trim: float) -> tuple[Command, float]:
    """The steering output on the rover's clock, and what that clock is behind ours [s]."""
    from rover_sweep.logs.readers.tlog import open_tlog
    from rover_sweep.logs.readers.vehicle_clock import CLOCKS, sessions

    path = folder.path / TELEMETRY
    if not path.is_file():
        raise DataRefused(f"{folder.path} has no {TELEMETRY}: the steering was not recorded")
    log = open_tlog(path, frozenset({"SERVO_OUTPUT_RAW", *CLOCKS}))
    held = [s for s in sessions(log.messages) if "SERVO_OUTPUT_RAW" in s.messages]
    if not held:
        raise DataRefused(f"{path} has no SERVO_OUTPUT_RAW with a clock: the steering was not recorded")
    session = held[-1]
    frames = session.messages["SERVO_OUTPUT_RAW"]
    t = session.seconds("SERVO_OUTPUT_RAW")
    servo = content["steering_output"]["servo"]
    pwm = frames.rows[f"servo{servo}_raw"].astype(float)
    ahead = float(np.min(arrivals(path, frames.order) - t))
    keep = np.concatenate(([True], np.diff(t) > 0)) & (pwm > 0)
    if keep.sum() < 2:
        raise DataRefused(f"{path} holds no PWM of SERVO{servo}, which steers according to {DESCRIPTION}")
    return Command(t[keep], pwm[keep], trim), ahead


def _wheel(folder: BenchFolder, given: Path | None, same_clock: bool, ahead: float) -> Wheel:
    if given is not None:
        return read_wheel(given, same_clock)
    if (folder.path / WHEEL_TLOG).is_file():
        return wheel_of_telemetry(folder.path / WHEEL_TLOG, ahead)
    if not (folder.path / WHEEL_CSV).is_file():
        raise DataRefused(
            f"{folder.path} has no record of the wheel; give it with "
            f"`bench --from {folder.path} --wheel-imu FILE`"
        )
    return read_wheel(folder.path / WHEEL_CSV, same_clock)
