"""Converts messages of a telemetry log to channels in SI units and ISO axes, on the vehicle's clock.

A .tlog is stamped on arrival, so its stamps include the link's delays (pymavlink issue 661); time_boot_ms and
time_usec of the messages are used instead. Field units: https://mavlink.io/en/messages/common.html. In logs
of 4.6.3 ArduPilot counts both since boot, and time_usec of SERVO_OUTPUT_RAW in 32 bit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_sweep.data.geometry import MILLI_G
from rover_sweep.data.recording import Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import (
    STEERING,
    THROTTLE,
    Log,
    body_velocity,
    clock_notes,
    firmware_of,
    increasing,
    message_signals,
    output_channel,
    output_limits,
    refuse_disorder,
    sensor_filters,
    source_of,
    vehicle_of,
)
from rover_sweep.logs.readers.tlog import Frames, Tlog, open_tlog
from rover_sweep.logs.readers.vehicle_clock import CLOCKS, BootMessages, sessions

WANTED = frozenset(
    ("HEARTBEAT", "AUTOPILOT_VERSION", "ATTITUDE", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "HIGHRES_IMU")
    + (
        "LOCAL_POSITION_NED",
        "GLOBAL_POSITION_INT",
        "VFR_HUD",
        "GPS_RAW_INT",
        "SERVO_OUTPUT_RAW",
        "PARAM_VALUE",
        "STATUSTEXT",
    )
)
ARDUPILOT = 3  # MAV_AUTOPILOT; below, the vehicles of MAV_TYPE
KINDS = {
    10: "rover",
    11: "boat",
    12: "submarine",
    5: "antenna tracker",
    1: "plane",
    7: "blimp",
    2: "copter",
    3: "copter",
    4: "helicopter",
    13: "copter",
    14: "copter",
    15: "copter",
}
EVERY_STEP = 100.0  # Hz; a faster stream records each step of the staircase (Lua runs at 84 Hz)
STEERING_FIRST = 1
_PASSING = 2  # heartbeats of another vehicle that are ignored: a link records none after the first


def read_telemetry(
    path: Path, filters: Mapping[str, float] | None = None, system: int | None = None
) -> tuple[Log, ...]:
    """A .tlog as one `Log` for each start of the vehicle. DataRefused for an unusable file.

    system: MAVLink id of the vehicle, None for the one with most heartbeats.
    """
    tlog = open_tlog(path, WANTED)
    _refuse_damage(path, tlog)
    kind, own, others = messages_of_vehicle(path, tlog, system)
    starts = list(sessions(own))
    if not starts:
        raise DataRefused(
            f"{path.name} holds no ATTITUDE or IMU messages: request them from the vehicle while recording"
        )
    source, damage = source_of(path), (*others, *_reading_notes(tlog, len(starts)))
    names = [path.stem if len(starts) == 1 else f"{path.stem} start {i + 1}" for i in range(len(starts))]
    return tuple(_log(n, s, kind, filters, source, damage) for n, s in zip(names, starts, strict=True))


def _refuse_damage(path: Path, tlog: Tlog) -> None:
    if tlog.size == 0:
        raise DataRefused(f"{path.name} is empty (0 bytes): record the telemetry again")
    if tlog.frame_count == 0:
        raise DataRefused(f"{path.name} is not a telemetry log: its {tlog.size} bytes hold no MAVLink frame")
    if tlog.damaged > tlog.frame_count or 2 * tlog.bad_bytes > tlog.size:
        raise DataRefused(
            f"{path.name} is damaged: {tlog.damaged} frames have wrong bytes, {tlog.frame_count} are "
            f"complete, and {tlog.bad_bytes} of {tlog.size} bytes are outside frames; use another copy "
            "or the .BIN"
        )


def _reading_notes(tlog: Tlog, starts: int) -> Iterator[Note]:
    if tlog.damaged:
        share = tlog.damaged / (tlog.damaged + tlog.frame_count)
        yield Note(
            "warning",
            f"{100 * share:.2g} % of the frames of the telemetry log ({tlog.damaged}) have wrong bytes and "
            "were skipped, as if the link had lost them",
        )
    elif tlog.bad_bytes:
        yield Note(
            "warning",
            f"{tlog.bad_bytes} bytes of the telemetry log are outside complete frames and were skipped",
        )
    if starts > 1:
        yield Note("info", f"The vehicle restarted {starts - 1} times during the recording")


def messages_of_vehicle(
    path: Path, tlog: Tlog, wanted: int | None = None
) -> tuple[str, dict[str, Frames], tuple[Note, ...]]:
    """(kind, messages, notes) of the vehicle of that system id, else of that with most heartbeats."""
    hearts = tlog.messages.get("HEARTBEAT")
    if hearts is None or not np.any(hearts.rows["autopilot"] == ARDUPILOT):
        raise DataRefused(
            f"{path.name} holds no heartbeat of an ArduPilot vehicle in {tlog.frame_count} frames"
        )
    hearts = hearts.where(hearts.rows["autopilot"] == ARDUPILOT)
    counts = np.bincount(hearts.system, minlength=256)
    system = int(counts.argmax()) if wanted is None else wanted
    recorded_systems = [
        int(number) for number in np.flatnonzero((counts > _PASSING) | (counts == counts.max()))
    ]
    if not counts[system]:
        names = ", ".join(f"system {number}" for number in recorded_systems)
        raise DataRefused(
            f"{path.name} holds no heartbeat of system {system}, only of {names}; give --system one of them"
        )
    hearts = hearts.where(hearts.system == system)
    component = np.bincount(hearts.component).argmax()
    kind = int(hearts.rows["type"][-1])
    own = {n: f.where((f.system == system) & (f.component == component)) for n, f in tlog.messages.items()}
    notes: tuple[Note, ...] = ()
    others = " and ".join(f"system {number}" for number in recorded_systems if number != system)
    if others and wanted is None:
        text = (
            f"The telemetry log holds several vehicles: system {system}, which is used, and {others}, which "
            "is ignored; choose with --system N"
        )
        notes = (Note("warning", text),)
    return KINDS.get(kind, f"vehicle of MAV_TYPE {kind}"), {n: f for n, f in own.items() if len(f)}, notes


def _log(
    name: str,
    session: BootMessages,
    kind: str,
    override: Mapping[str, float] | None,
    source: tuple[str, str],
    damage: tuple[Note, ...],
) -> Log:
    parameters, marks = session.parameters(), tuple(session.texts())
    filters, notes = sensor_filters(parameters, override)
    clocks = {n: session.seconds(n) for n in (*CLOCKS, "SERVO_OUTPUT_RAW") if n in session.messages}
    refuse_disorder(name, clocks)
    attitudes = attitude(session)
    signals = _imu(session) | attitudes | ground_velocity(session, attitudes.get("psi"))
    recorded = output_channel(parameters, STEERING)
    steering = _output(session, recorded or STEERING_FIRST)
    throttle = _output(session, output_channel(parameters, THROTTLE) or 3)
    if throttle is not None:
        signals["throttle"] = replace(throttle, hold=True)
    firmware = firmware_of(marks)
    if not firmware and "AUTOPILOT_VERSION" in session.messages:
        number = int(session.messages["AUTOPILOT_VERSION"].rows["flight_sw_version"][-1])
        firmware = f"V{number >> 24 & 255}.{number >> 16 & 255}.{number >> 8 & 255}"
    clock = max((n for n in CLOCKS if n in session.messages), key=lambda n: _count(session, n))
    t, (arrival,) = increasing(session.seconds(clock), session.messages[clock].arrival)
    if recorded is None and steering is not None:
        notes += (Note("info", "The telemetry log does not show which output steers: servo 1 is assumed"),)
    return Log(
        name=name,
        signals=signals,
        steering=(steering,) if steering is not None else (),
        arrivals=(t, arrival),
        marks=marks,
        parameters=parameters,
        filters={c: f for c, f in filters.items() if c in signals},
        limits=output_limits(parameters, recorded or STEERING_FIRST),
        vehicle=vehicle_of(firmware) if vehicle_of(firmware) not in ("", "rover") else kind,
        firmware=firmware,
        notes=(*damage, *notes, *clock_notes(clocks)),
        sources=(source,),
        system=int(next(iter(session.messages.values())).system[0]),
        witnesses=_witnesses(session, signals),
    )


def _signals(
    session: BootMessages, name: str, channels: Mapping[str, tuple[str, float, str]]
) -> dict[str, Signal]:
    """Channels from one message. channels: {channel: (field, factor, unit)}."""
    rows = session.messages[name].rows
    return message_signals(name, session.seconds(name), channels, lambda field: rows[field])


def _count(session: BootMessages, name: str) -> int:
    return len(session.messages[name]) if name in session.messages else 0


def _imu(session: BootMessages) -> dict[str, Signal]:
    """r, p [rad/s], ay [m/s^2] from the most frequent IMU message; r, p from ATTITUDE if more frequent."""
    names = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2")
    best = max(names, key=lambda n: _count(session, n))
    found: dict[str, Signal] = {}
    if _count(session, best):
        rate, force = (1.0, 1.0) if best == "HIGHRES_IMU" else (1e-3, MILLI_G)
        channels = {
            "r": ("zgyro", -rate, "rad/s"),
            "p": ("xgyro", rate, "rad/s"),
            "ay": ("yacc", -force, "m/s^2"),
        }
        found = _signals(session, best, channels)
    if _count(session, "ATTITUDE") > 1.5 * _count(session, best):
        found |= _signals(
            session, "ATTITUDE", {"r": ("yawspeed", -1.0, "rad/s"), "p": ("rollspeed", 1.0, "rad/s")}
        )
    return found


def attitude(session: BootMessages) -> dict[str, Signal]:
    """phi and psi [rad]; psi unwrapped, left positive."""
    if "ATTITUDE" not in session.messages:
        return {}
    return _signals(session, "ATTITUDE", {"phi": ("roll", 1.0, "rad"), "psi": ("yaw", -1.0, "rad")})


def ground_velocity(session: BootMessages, psi: Signal | None) -> dict[str, Signal]:
    """speed and vy [m/s] from the velocity north and east; else speed from VFR_HUD."""
    local, world = _count(session, "LOCAL_POSITION_NED"), _count(session, "GLOBAL_POSITION_INT")
    if psi is not None and max(local, world) > 1:
        name, factor = ("LOCAL_POSITION_NED", 1.0) if local >= world else ("GLOBAL_POSITION_INT", 0.01)
        rows = session.messages[name].rows
        t, (vn, ve) = increasing(
            session.seconds(name), rows["vx"].astype(float) * factor, rows["vy"].astype(float) * factor
        )
        return body_velocity(t, vn, ve, np.interp(t, psi.t, psi.x), f"{name}.vx,vy")
    if _count(session, "VFR_HUD") > 1:
        return _signals(session, "VFR_HUD", {"speed": ("groundspeed", 1.0, "m/s")})
    return {}


FIX, UNKNOWN = 3, 65535  # GPS_RAW_INT: fix_type of a position in three dimensions; vel or cog not known


def _witnesses(session: BootMessages, signals: Mapping[str, Signal]) -> dict[str, Signal]:
    """Speed and course of the GPS receiver, and the yaw rate of another IMU, to compare."""
    found: dict[str, Signal] = {}
    if "GPS_RAW_INT" in session.messages:
        rows = session.messages["GPS_RAW_INT"].rows
        good = (rows["fix_type"] >= FIX) & (rows["vel"] < UNKNOWN) & (rows["cog"] < UNKNOWN)
        speed, course = rows["vel"][good] * 0.01, -np.radians(rows["cog"][good] * 0.01)
        t, (speed, course) = increasing(session.seconds("GPS_RAW_INT")[good], speed, course)
        found["gps_speed"] = Signal(t, speed, "m/s", "GPS_RAW_INT.vel")
        found["gps_course"] = Signal(t, course, "rad", "GPS_RAW_INT.cog")
    used = signals["r"].source.split(".")[0] if "r" in signals else ""
    if _count(session, "SCALED_IMU2") > 1 and used != "SCALED_IMU2":
        found["r2"] = _signals(session, "SCALED_IMU2", {"r": ("zgyro", -1e-3, "rad/s")})["r"]
    return {name: signal for name, signal in found.items() if signal.t.size}


def _output(session: BootMessages, channel: int) -> Signal | None:
    """A servo output [us] from SERVO_OUTPUT_RAW.

    The staircase may be as fine as the stream (40 Hz from a loop at 50 Hz), so samples are interpolated;
    holding them would add half an interval of delay. Only a stream that records every step is held.
    """
    frames = session.messages.get("SERVO_OUTPUT_RAW")
    if frames is None:
        return None
    of_port = frames.rows["port"] == (channel - 1) // 16
    if not np.any(of_port):
        return None
    x = frames.rows[f"servo{(channel - 1) % 16 + 1}_raw"].astype(float)
    t, (x,) = increasing(session.seconds("SERVO_OUTPUT_RAW")[of_port], x[of_port])
    signal = Signal(t, x, "us", f"SERVO_OUTPUT_RAW.servo{channel}_raw", origin="commanded")
    return replace(signal, hold=signal.rate > EVERY_STEP)
