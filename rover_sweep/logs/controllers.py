"""The steering rate and speed controllers in a log: PIDS and PIDA of a .BIN, PID_TUNING of a .tlog.

`Rover/Log.cpp` Log_Write_Attitude logs both with bit 0 (main loop) or bit 1 (10 Hz) of LOG_BITMASK; the turn
rates are in rad/s, positive right. `Rover/GCS_Mavlink.cpp` send_pid_tuning sends those of GCS_PID_MASK, the
turn rates in deg/s. Fields: libraries/AP_Logger/LogStructure.h of ArduRover 4.6.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rover_sweep.data.controller_log import LEAST_SECONDS, ControllerLog
from rover_sweep.data.recording import Array, Signal
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.log import increasing
from rover_sweep.logs.read import existing_log
from rover_sweep.logs.readers.dataflash import DataFlash, open_parts
from rover_sweep.logs.readers.dataflash_channels import logged_parameters, refuse_damage, velocity
from rover_sweep.logs.readers.tlog import open_tlog
from rover_sweep.logs.readers.tlog_channels import WANTED, attitude, ground_velocity, messages_of_vehicle
from rover_sweep.logs.readers.vehicle_clock import BootMessages, sessions

STEER_AXIS, SPEED_AXIS = 5, 4  # PID_TUNING_AXIS of the two
_COLUMNS = ("target", "actual", "p", "i", "d", "ff")


@dataclass(frozen=True, eq=False)
class Controllers:
    """steering: the steering rate controller for each set of parameters, at least one; speed: the speed
    controller, none if it was not logged."""

    steering: tuple[ControllerLog, ...]
    speed: tuple[ControllerLog, ...]


def read_controllers(path: Path) -> Controllers:
    """The controllers in a .BIN or .tlog. DataRefused for a log without the steering's, and how to log it."""
    suffix = existing_log(str(path)).suffix.lower()
    if suffix not in (".bin", ".tlog"):
        raise UsageError(f"{path.name}: give a .BIN or .tlog of a drive in ACRO or AUTO")
    steering, speed = _of_flash(path) if suffix == ".bin" else _of_telemetry(path)
    if not steering:
        raise DataRefused(
            f"{path.name}: the steering rate controller ran for less than {LEAST_SECONDS:g} s; MANUAL and "
            "HOLD bypass it: drive in ACRO or AUTO"
        )
    return Controllers(tuple(steering), tuple(speed))


def _of_flash(path: Path) -> tuple[list[ControllerLog], list[ControllerLog]]:
    parts = open_parts(path)
    refuse_damage(path, parts)
    if not any(part.has("PIDS", "Tar", "Act", "FF") for part in parts):
        raise DataRefused(
            f"{path.name} holds no PIDS messages of the steering rate controller: set bit 0 of "
            "LOG_BITMASK (fast attitude; the default 65535 has it) and drive in ACRO or AUTO"
        )
    found: tuple[list[ControllerLog], list[ControllerLog]] = ([], [])
    for flash in parts:
        changes = logged_parameters(flash)
        for name, logs in zip(("PIDS", "PIDA"), found, strict=True):
            if flash.has(name, "Tar", "Act", "FF"):
                logs += _flash_log(path.stem, flash, name).running().stretches(changes)
    return found


def _flash_log(name: str, flash: DataFlash, message: str) -> ControllerLog:
    columns = [flash.column(message, c) for c in ("Tar", "Act", "P", "I", "D", "FF")]
    if flash.has(message, "DFF"):
        columns[-1] = columns[-1] + flash.column(message, "DFF")
    t, kept = increasing(flash.seconds(message), *columns)
    speed = velocity(flash).get("speed")
    if flash.has("THR", "Speed"):  # the controller's own, though at 10 Hz
        at, (own,) = increasing(flash.seconds("THR"), flash.column("THR", "Speed"))
        speed = Signal(at, own, "m/s", "THR.Speed")
    modes = None
    if flash.has("MODE", "ModeNum"):
        modes = flash.seconds("MODE"), flash.column("MODE", "ModeNum")
    return _log(name, t, kept, speed, modes)


def _of_telemetry(path: Path) -> tuple[list[ControllerLog], list[ControllerLog]]:
    tlog = open_tlog(path, WANTED | {"PID_TUNING"})
    _, own, _ = messages_of_vehicle(path, tlog)
    if "PID_TUNING" not in own:
        raise DataRefused(
            f"{path.name} holds no PID_TUNING messages: set GCS_PID_MASK to 3 (steering and speed) and drive "
            "in ACRO or AUTO, or give the .BIN of the drive"
        )
    found: tuple[list[ControllerLog], list[ControllerLog]] = ([], [])
    for session in sessions(own):
        if "PID_TUNING" in session.messages:
            for axis, logs in zip((STEER_AXIS, SPEED_AXIS), found, strict=True):
                logs += _telemetry_log(path.stem, session, axis).running().stretches(_heard(session))
    return found


def _telemetry_log(name: str, session: BootMessages, axis: int) -> ControllerLog:
    rows = session.messages["PID_TUNING"].rows
    own = rows["axis"] == axis
    columns = [rows[c][own].astype(float) for c in ("desired", "achieved", "P", "I", "D", "FF")]
    if axis == STEER_AXIS:
        columns[:2] = [np.radians(c) for c in columns[:2]]
    t, kept = increasing(session.seconds("PID_TUNING")[own], *columns)
    modes = None
    if "HEARTBEAT" in session.messages:
        hearts = session.messages["HEARTBEAT"].rows
        modes = session.seconds("HEARTBEAT"), hearts["custom_mode"].astype(float)
    speed = ground_velocity(session, attitude(session).get("psi")).get("speed")
    return _log(name, t, kept, speed, modes)


def _heard(session: BootMessages) -> list[tuple[float, str, float]]:
    """(time [s], name, value) of each parameter in the order received."""
    if "PARAM_VALUE" not in session.messages:
        return []
    rows = session.messages["PARAM_VALUE"].rows
    names = (name.decode("ascii", "replace") for name in rows["param_id"].tolist())
    return list(
        zip(session.seconds("PARAM_VALUE").tolist(), names, rows["param_value"].tolist(), strict=True)
    )


def _log(
    name: str,
    t: Array,
    columns: Sequence[Array],
    speed: Signal | None,
    modes: tuple[Array, Array] | None = None,
) -> ControllerLog:
    """The log. modes: times (k,) [s] and numbers (k,) of the vehicle's modes from then on."""
    if speed is None or speed.t.size < 2:
        raise DataRefused(
            f"{name} holds no speed (THR, XKF1 or GPS; LOCAL_POSITION_NED or VFR_HUD): log one of them too"
        )
    known = dict(zip(_COLUMNS, columns, strict=True))
    mode = np.empty(0)
    if modes is not None and modes[0].size:
        mode = modes[1][np.maximum(np.searchsorted(modes[0], t, "right") - 1, 0)]
    made = ControllerLog(name, t, **known, speed=np.interp(t, speed.t, speed.x), parameters={}, mode=mode)
    return made.where(np.all([np.isfinite(c) for c in (*columns, made.speed)], axis=0))
