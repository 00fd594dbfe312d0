"""The logs of an ArduPilot rover: .BIN with factory logging or with the applet, and .tlog of several rates.

Axes are the firmware's: FRD, yaw clockwise from north. Rates are those measured on 4.6.3: steering at 10 Hz,
GPS at 5 Hz, IMU, ATT and XKF1 once a main loop.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from sitl.flash_log.dataflash_writer import DataFlashWriter, LogFormat
from sitl.flash_log.formats import FORMATS, MULTIPLIERS, UNITS
from sitl.geodesy import ORIGIN, latitude_longitude
from tests.engines.engine import Array
from tests.foreign.plant import DT, GRAVITY
from tests.recordings.signals import BOOT_S, Recorded

FIRMWARE = "ArduRover V4.6.3 (3fc7011a)"
MODE_NUMBERS = {"MANUAL": 0, "ACRO": 1, "AUTO": 10}
SWEP = LogFormat(
    250, "SWEP", "QHBfffff", "TimeUS,Run,St,T,Cmd,Out,VN,VE", "s--sYYnn", "F--00000"
)  # the applet's
SWEP_HZ, LOOP_HZ, OUTPUT_HZ, GPS_HZ = 84.0, 50.0, 10.0, 5.0
WEEK, UNUSED = 2345, [0] * 10
DROPPED = "dropped"  # flag: the autopilot counts the messages that it could not write (DSF.Dp)

Row = tuple[int, str, tuple[Any, ...]]  # step, message, values


def factory_bin(drive: Recorded, folder: Path, rng: Generator) -> str:
    """A .BIN of the default LOG_BITMASK."""
    return _flash(drive, folder / "drive.BIN", list(_messages(drive, rng)))


def applet_bin(drive: Recorded, folder: Path, rng: Generator) -> str:
    """The same with the applet's own messages while it sweeps."""
    rows = [*_messages(drive, rng), *_applet(drive, rng)]
    return _flash(drive, folder / "drive.BIN", rows)


def _flash(drive: Recorded, path: Path, rows: list[Row]) -> str:
    rows.sort(key=lambda row: row[0])
    with path.open("wb") as file:
        writer = DataFlashWriter(file, {**FORMATS, "SWEP": SWEP} if _swept(rows) else FORMATS)
        begin = round(BOOT_S * 1e6)
        for letter, label in UNITS.items():
            writer.write("UNIT", begin, ord(letter), label)
        for letter, factor in MULTIPLIERS.items():
            writer.write("MULT", begin, ord(letter), factor)
        for name, value in drive.parameters.items():
            writer.write("PARM", begin, name, value, value)
        writer.write("MSG", begin, FIRMWARE)
        mode = MODE_NUMBERS[drive.mode]
        writer.write("MODE", begin, mode, mode, 1)
        writer.write("ARM", begin, 1, 0, 0, 1)
        for step, name, values in rows:
            writer.write(name, round((BOOT_S + step * DT) * 1e6), *values)
    return str(path)


def _swept(rows: list[Row]) -> bool:
    return any(name == "SWEP" for _, name, _ in rows)


def _columns(drive: Recorded, at: Array, *names: str) -> list[list[float]]:
    return [drive.x[name][at].tolist() for name in names]


def _messages(drive: Recorded, rng: Generator) -> Iterator[Row]:
    """What the firmware logs besides scripts."""
    at = drive.rows(LOOP_HZ, rng)
    for k, p, r, ax, ay, az in zip(
        at.tolist(), *_columns(drive, at, "p", "r", "ax", "ay", "az"), strict=True
    ):
        yield k, "IMU", (0, p, 0.0, -r, ax, -ay, -az, 0, 0, 35.0, 1, 1, 1000, 1000)
    at = drive.rows(LOOP_HZ, rng)
    of_estimator = _columns(drive, at, "phi", "psi", "north", "west", "x", "y")
    for k, phi, psi, north, west, x, y in zip(at.tolist(), *of_estimator, strict=True):
        angles = degrees(phi), 0.0, degrees(-psi) % 360.0
        yield k, "ATT", (0.0, angles[0], 0.0, angles[1], 0.0, angles[2], 3)
        yield k, "XKF1", (0, *angles, north, -west, 0.0, 0.0, x, -y, 0.0, 0.0, 0.0, 0.0, ORIGIN[2])
    at = drive.rows(OUTPUT_HZ, rng)
    of_pilot = _columns(drive, at, "us", "stick", "throttle", "north", "west", "psi", "ax", "ay", "r")
    for k, us, stick, throttle, north, west, psi, ax, ay, r in zip(at.tolist(), *of_pilot, strict=True):
        forward = _forward(north, west, psi)
        yield k, "RCOU", (round(us), 1500, round(throttle), 0, *UNUSED)
        yield k, "RCIN", (round(stick), 1500, round(throttle), 1500, *UNUSED)
        yield k, "THR", (round((throttle - 1500) / 4), (throttle - 1500) / 4, 0.0, forward, ax)
        yield k, "STER", (round(9 * (stick - 1500)), 9 * (us - 1500), 0.0, -ay, 0.0, degrees(-r))
    at = drive.rows(GPS_HZ, rng)
    for k, speed, course, x, y in zip(
        at.tolist(), *_columns(drive, at, "ground", "course", "x", "y"), strict=True
    ):
        latitude, longitude = latitude_longitude(x, -y)
        place = (latitude, longitude, ORIGIN[2], speed, degrees(-course) % 360.0)
        yield k, "GPS", (0, 3, round(k * DT * 1000), WEEK, 10, 1.21, *place, 0.0, 0.0, 1)
    at = drive.rows(1.0, rng)
    missing = 0
    for k in at.tolist():
        missing += round(30 * drive.lost) if DROPPED in drive.flags else 0
        yield k, "DSF", (missing, 0, 8000, 9000, 16000, 12000)


def _forward(north: float, west: float, psi: float) -> float:
    return float(north * np.cos(psi) + west * np.sin(psi))


def _applet(drive: Recorded, rng: Generator) -> Iterator[Row]:
    """Rows of the applet about each sweep, with the states that it goes through, and its texts."""
    at = drive.rows(SWEP_HZ, rng)
    us, north, west = (drive.x[name][at] for name in ("us", "north", "west"))
    for number, (begin, end) in enumerate(drive.piloted.swept, 1):
        states = np.array([begin - 2.0, begin, begin + 3.0, begin + 5.0, end - 5.0, end - 3.0, end])
        inside = np.flatnonzero((at * DT > states[0]) & (at * DT < end))
        if not inside.size:
            continue
        yield int(at[inside[0]]), "MSG", (f"SWP: run {number} start sweep",)
        for k in inside.tolist():
            now = at[k] * DT
            state = 2 + int(np.searchsorted(states, now, "right"))
            moved = float(us[k])
            clock = max(0.0, now - begin)
            yield int(at[k]), "SWEP", (number, state, clock, moved, moved, float(north[k]), float(-west[k]))
        yield int(at[inside[-1]]) + 1, "MSG", (f"SWP: run {number} done",)


# ---- Telemetry logs.

MILLI_G = GRAVITY * 1e-3
BASE_S = 1.7e9  # s since 1970 of the ground station's clock at the boot
ROVER, ARDUPILOT = 10, 3


def telemetry(hz: float, parameters: bool, drive: Recorded, folder: Path, rng: Generator) -> str:
    """A .tlog with attitude, IMU and steering at this rate; parameters: the ground station fetched them."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames: list[tuple[float, bytes]] = []

    def said(t: float, name: str, /, **fields: Any) -> None:
        message = getattr(dialect, f"MAVLink_{name.lower()}_message")(**fields)
        delay = 0.03 + rng.exponential(0.01)
        frames.append((t + delay, message.pack(link)))
        link.seq = (link.seq + 1) % 256

    if not parameters:
        drive = replace(drive, parameters={})
    for n, (name, value) in enumerate(drive.parameters.items()):
        known = {"param_type": 9, "param_count": len(drive.parameters), "param_index": n}
        said(BOOT_S, "PARAM_VALUE", param_id=name.encode(), param_value=float(value), **known)
    said(BOOT_S, "STATUSTEXT", severity=6, text=FIRMWARE.encode())
    for step, name, fields in sorted(_frames(hz, drive, rng), key=lambda f: f[0]):
        said(BOOT_S + step * DT, name, **fields)
    path = folder / "drive.tlog"
    frames.sort(key=lambda f: f[0])
    path.write_bytes(b"".join(struct.pack(">Q", round((BASE_S + t) * 1e6)) + frame for t, frame in frames))
    return str(path)


def _frames(hz: float, drive: Recorded, rng: Generator) -> Iterator[tuple[int, str, dict[str, Any]]]:
    def stamps(step: int) -> tuple[int, int]:
        return round((BOOT_S + step * DT) * 1e3), round((BOOT_S + step * DT) * 1e6)

    mode = {"type": ROVER, "autopilot": ARDUPILOT, "base_mode": 129, "custom_mode": MODE_NUMBERS[drive.mode]}
    for k in drive.rows(1.0, rng).tolist():
        yield k, "HEARTBEAT", {**mode, "system_status": 4, "mavlink_version": 3}
    at = drive.rows(hz, rng)
    none = {"xmag": 0, "ymag": 0, "zmag": 0, "ygyro": 0}
    for k, p, r, ax, ay, az in zip(
        at.tolist(), *_columns(drive, at, "p", "r", "ax", "ay", "az"), strict=True
    ):
        force = {"xacc": _short(ax / MILLI_G), "yacc": _short(-ay / MILLI_G), "zacc": _short(-az / MILLI_G)}
        turn = {"xgyro": _short(1e3 * p), "zgyro": _short(-1e3 * r)}
        yield k, "RAW_IMU", {"time_usec": stamps(k)[1], **force, **turn, **none}
    at = drive.rows(hz, rng)
    for k, phi, psi, p, r in zip(at.tolist(), *_columns(drive, at, "phi", "psi", "p", "r"), strict=True):
        yaw = (-psi + np.pi) % (2 * np.pi) - np.pi
        angles = {"roll": phi, "pitch": 0.0, "yaw": yaw, "rollspeed": p, "pitchspeed": 0.0, "yawspeed": -r}
        yield k, "ATTITUDE", {"time_boot_ms": stamps(k)[0], **angles}
    at = drive.rows(hz, rng)
    for k, us, throttle, stick in zip(
        at.tolist(), *_columns(drive, at, "us", "throttle", "stick"), strict=True
    ):
        pulses = {f"servo{n}_raw": 0 for n in range(1, 9)}
        pulses |= {"servo1_raw": round(us), "servo3_raw": round(throttle)}
        yield k, "SERVO_OUTPUT_RAW", {"time_usec": stamps(k)[1], "port": 0, **pulses}
        inputs = {f"chan{n}_raw": 0 for n in range(1, 19)} | {
            "chan1_raw": round(stick),
            "chan3_raw": round(throttle),
        }
        yield k, "RC_CHANNELS", {"time_boot_ms": stamps(k)[0], "chancount": 8, "rssi": 200, **inputs}
    at = drive.rows(min(hz, 10.0), rng)
    columns = _columns(drive, at, "north", "west", "x", "y", "psi")
    for k, north, west, x, y, psi in zip(at.tolist(), *columns, strict=True):
        latitude, longitude = latitude_longitude(x, -y)
        place = {"lat": round(1e7 * latitude), "lon": round(1e7 * longitude), "alt": 0, "relative_alt": 0}
        moved = {"vx": round(100 * north), "vy": round(-100 * west), "vz": 0}
        heading = round(100 * (degrees(-psi) % 360.0)) % 36000
        yield k, "GLOBAL_POSITION_INT", {"time_boot_ms": stamps(k)[0], **place, **moved, "hdg": heading}
        said = {"airspeed": 0.0, "heading": heading // 100, "throttle": 40, "alt": 0.0, "climb": 0.0}
        yield k, "VFR_HUD", {"groundspeed": float(np.hypot(north, west)), **said}
    at = drive.rows(GPS_HZ, rng)
    for k, speed, course, x, y in zip(
        at.tolist(), *_columns(drive, at, "ground", "course", "x", "y"), strict=True
    ):
        latitude, longitude = latitude_longitude(x, -y)
        place = {"lat": round(1e7 * latitude), "lon": round(1e7 * longitude), "alt": 0}
        fix = {"fix_type": 3, "eph": 121, "epv": 200, "satellites_visible": 10}
        moved = {"vel": round(100 * speed), "cog": round(100 * (degrees(-course) % 360.0)) % 36000}
        yield k, "GPS_RAW_INT", {"time_usec": stamps(k)[1], **fix, **place, **moved}


def _short(value: float) -> int:
    return round(min(max(value, -32768.0), 32767.0)) if np.isfinite(value) else 0
