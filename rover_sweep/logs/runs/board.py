"""The identity of the vehicle that made a log."""

from __future__ import annotations

import re

from rover_sweep.logs.log import STEERING, Log, output_channel

# ArduPilot's banner ends with the board's name and its processor's unique id (source: AP_HAL
# Util::get_system_id, "CubeOrange 0028001F 3432510D 37343231"); the simulation has none.
BOARD = re.compile(r"^(\S+ (?:[0-9A-F]{8} ){2}[0-9A-F]{8})$")
SYSTEM = ("MAV_SYSID", "SYSID_THISMAV")  # after 4.6, before
OF_BOARD = (
    "INS_GYR_ID",
    "INS_ACC_ID",
    "COMPASS_DEV_ID",
    "INS_ACCSCAL_X",
    "INS_ACCSCAL_Y",
    "AHRS_ORIENTATION",
)


def identity(log: Log) -> dict[str, str]:
    """{"board", "system id" or parameter: value}, as far as logged."""
    boards = [board.group(1) for _, text in log.marks if (board := BOARD.match(text))]
    found = {"board": boards[-1]} if boards else {}
    system = next((log.parameters[name] for name in SYSTEM if name in log.parameters), log.system)
    if system:
        found["system id"] = f"{system:g}"
    n = output_channel(log.parameters, STEERING) or 1
    names = (*OF_BOARD, *(f"SERVO{n}_{end}" for end in ("TRIM", "MIN", "MAX", "REVERSED")))
    return found | {name: f"{log.parameters[name]:.6g}" for name in names if name in log.parameters}
