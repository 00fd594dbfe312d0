"""Converts messages of a DataFlash log to channels in SI units and ISO axes.

ArduPilot logs in FRD axes (x forward, y right, z down) and yaw clockwise from north, so r, a_y, V_y
and psi change sign; p and phi do not. Message names and units are those of ArduRover 3.1 to 4.6.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import (
    STEERING,
    THROTTLE,
    Log,
    body_velocity,
    clock_notes,
    finite_signal,
    firmware_of,
    increasing,
    joined_steering,
    message_signals,
    output_channel,
    output_limits,
    refuse_disorder,
    sensor_filters,
    source_of,
    vehicle_of,
)
from rover_sweep.logs.readers.dataflash import DataFlash, open_parts
from rover_sweep.logs.readers.vehicle_clock import applet_output, applet_rows, main_loops

Rows = NDArray[np.void]

DAMAGE_LIMIT = 0.5  # share of lost bytes; above it the log is more hole than drive
# Breaks per message; above it the numbers are unreliable: messages have no checksum, and a flipped bit is a
# break only in 3 of about 45 bytes, so 15 times as many messages have a wrong number. A block of a card that
# was lost is one break.
BREAK_LIMIT = 1e-3
RAW_POST_FILTER, RAW_PRE_AND_POST = 1 << 2, 1 << 3  # bits of INS_RAW_LOG_OPT


def read_dataflash(path: Path, filters: Mapping[str, float] | None = None) -> tuple[Log, ...]:
    """A .BIN file as one `Log` for each log in it, usually one.

    DataRefused for a file that is empty, not a log, or damaged.
    """
    parts = open_parts(path)
    refuse_damage(path, parts)
    parts = tuple(part for part in parts if _holds_messages(part))
    names = [path.stem if len(parts) == 1 else f"{path.stem} log {i + 1}" for i in range(len(parts))]
    source = source_of(path)
    return tuple(_log(n, part, filters, source) for n, part in zip(names, parts, strict=True))


def _log(name: str, flash: DataFlash, filters: Mapping[str, float] | None, source: tuple[str, str]) -> Log:
    parameters = {name: value for _, name, value in logged_parameters(flash)}
    marks: tuple[tuple[float, str], ...] = ()
    if flash.has_text("MSG", "Message"):
        marks = tuple(zip(flash.seconds("MSG").tolist(), flash.text("MSG", "Message"), strict=True))
    firmware = firmware_of(marks)
    gyro, raw_gyro = _gyro(flash, parameters)
    accel, raw_accel = _accel(flash, parameters)
    raw = frozenset(("r", "p") if raw_gyro else ()) | frozenset(("ay",) if raw_accel else ())
    known, notes = sensor_filters(parameters, filters, raw)
    signals = gyro | accel | _attitude(flash) | velocity(flash)
    channel = output_channel(parameters, STEERING) or 1
    coarse = _output(flash, channel)
    throttle = _output(flash, output_channel(parameters, THROTTLE) or 3)
    if throttle is not None:
        signals["throttle"] = replace(throttle, hold=True)
    swept = applet_output(flash, "SWET")
    if swept is not None:
        signals["throttle"] = joined_steering(swept, throttle)
    fine, loops = applet_output(flash, "SWEP"), None
    if flash.has("IMU"):
        loops, _ = increasing(flash.seconds("IMU", _first_instance(flash, "IMU", "I")))
    steering = tuple(s for s in (fine and joined_steering(fine, coarse), coarse) if s is not None)
    if steering and (measured := servo_position(flash, channel, steering[0])) is not None:
        signals["servo"], note = measured
        notes = (*notes, note)
    return Log(
        name=name,
        signals=signals,
        steering=steering,
        applet=applet_rows(flash, "SWEP"),
        throttle_applet=applet_rows(flash, "SWET"),
        loops=None if loops is None else main_loops(loops, parameters),
        marks=marks,
        parameters=parameters,
        filters={c: f for c, f in known.items() if c in signals},
        limits=output_limits(parameters, channel),
        vehicle=vehicle_of(firmware),
        firmware=firmware,
        notes=(*notes, *_reading_notes(name, flash)),
        sources=(source,),
        witnesses=_witnesses(flash, signals),
    )


def logged_parameters(flash: DataFlash) -> list[tuple[float, str, float]]:
    """(time [s], name, value) of each parameter in the order logged, without values that are not finite."""
    if not (flash.has("PARM", "Value") and flash.has_text("PARM", "Name")):
        return []
    values = flash.rows("PARM", "Value")["Value"].astype(float).tolist()
    named = zip(flash.seconds("PARM").tolist(), flash.text("PARM", "Name"), values, strict=True)
    return [logged for logged in named if math.isfinite(logged[2])]


def refuse_damage(path: Path, parts: tuple[DataFlash, ...]) -> None:
    size = sum(part.data.size for part in parts)
    if size == 0:
        raise DataRefused(f"{path.name} is empty (0 bytes): download the log from the vehicle again")
    if not any(_holds_messages(part) for part in parts):
        raise DataRefused(
            f"{path.name} is not a DataFlash log: its {size} bytes hold no messages; "
            "give a .BIN of an ArduPilot rover"
        )
    lost = sum(part.bad_bytes - part.tail_bytes for part in parts)
    if lost > DAMAGE_LIMIT * size:
        raise DataRefused(
            f"{path.name} is damaged: {lost} of {size} bytes "
            f"({100 * lost / size:.0f} %) belong to no message; copy it from the vehicle again"
        )
    breaks, count = sum(part.breaks for part in parts), sum(part.message_count for part in parts)
    if breaks > 1 + BREAK_LIMIT * count:
        raise DataRefused(
            f"{path.name} is damaged in {breaks} places among {count} messages ({lost} of {size} bytes), so "
            "numbers in other messages are also wrong; copy it from the vehicle again"
        )


def _holds_messages(flash: DataFlash) -> bool:
    return any(flash.count(name) for name in flash.formats if name != "FMT")


def _reading_notes(log: str, flash: DataFlash) -> Iterator[Note]:
    lost = flash.bad_bytes - flash.tail_bytes
    if lost:
        yield Note("warning", _loss_words(flash, lost))
    if flash.tail_bytes:
        yield Note("info", f"The log ends in the middle of a message ({flash.tail_bytes} bytes left over)")
    if flash.has("DSF", "Dp") and (dropped := int(np.ptp(flash.rows("DSF", "Dp")["Dp"]))):
        yield Note(
            "warning",
            f"The autopilot could not write {dropped} log messages during this log (DSF.Dp): "
            "log fewer messages (LOG_BITMASK) or use a faster card",
        )
    names = [n for n in ("IMU", "GYR", "XKF1", "SWEP", "RCOU") if flash.count(n)]
    labels = {n: next((c for c in ("I", "C") if c in flash.formats[n].numbers), "") for n in names}
    stamps = {n: _stamps(flash, n, _first_instance(flash, n, labels[n])) for n in names}
    refuse_disorder(log, stamps)
    yield from clock_notes(stamps)


PLACES = 3  # that are listed, the longest


def _loss_words(flash: DataFlash, lost: int) -> str:
    """How many bytes were skipped, and where."""
    places = flash.losses()
    longest = sorted(sorted(places, key=lambda place: place[0] - place[1])[:PLACES])
    shown = ", ".join(f"{after - before:.2f} s at {before:.1f} s" for before, after, _ in longest)
    more = f" and {len(places) - PLACES} more" if len(places) > PLACES else ""
    share = f"{100 * lost / flash.data.size:.1g} %"
    return f"{lost} damaged bytes ({share}) were skipped, which lost {shown}{more}; the rest is used"


def _first_instance(flash: DataFlash, name: str, instance: str, *columns: str, number: int = 0) -> Rows:
    """The times and `columns` of one sensor or EKF core; logs before 4.1 have no instance column."""
    if instance not in flash.formats[name].numbers:
        return _timed(flash, name, *columns)
    rows = _timed(flash, name, instance, *columns)
    chosen = rows[instance] == number
    return rows if chosen.all() else rows[chosen]


def _timed(flash: DataFlash, name: str, *columns: str) -> Rows:
    """All messages of a name with their times and `columns` alone, as a long log does not fit otherwise."""
    layout = flash.formats[name]
    stamp = (layout.stamp[0],) if layout.stamp is not None else ()
    sampled = tuple(c for c in ("SampleUS",) if c in layout.numbers)
    return flash.rows(name, *(stamp + sampled + columns or layout.columns))


def _stamps(flash: DataFlash, name: str, rows: Rows) -> Array:
    """Times (n,) [s] of the rows; of raw samples the time of sampling, not of writing."""
    if "SampleUS" in flash.formats[name].numbers:
        return rows["SampleUS"].astype(float) * 1e-6
    return flash.seconds(name, rows)


def _signals(
    flash: DataFlash, name: str, rows: Rows, channels: Mapping[str, tuple[str, float, str]]
) -> dict[str, Signal]:
    """Channels from one message type. channels: {channel: (column, factor, unit)}."""
    return message_signals(name, _stamps(flash, name, rows), channels, lambda c: flash.column(name, c, rows))


def _gyro(flash: DataFlash, parameters: Mapping[str, float]) -> tuple[dict[str, Signal], bool]:
    """r and p [rad/s]; True if they are unfiltered raw samples."""
    channels = {"r": ("GyrZ", -1.0, "rad/s"), "p": ("GyrX", 1.0, "rad/s")}
    for name in _imu_messages(parameters, "GYR"):
        if flash.has(name, "GyrX", "GyrZ"):
            rows = _first_instance(flash, name, "I", "GyrX", "GyrZ")
            return _signals(flash, name, rows, channels), name == "GYR"
    return {}, False


def _accel(flash: DataFlash, parameters: Mapping[str, float]) -> tuple[dict[str, Signal], bool]:
    """ay [m/s^2]; True if it is unfiltered."""
    for name in _imu_messages(parameters, "ACC"):
        if flash.has(name, "AccY"):
            rows = _first_instance(flash, name, "I", "AccY")
            return _signals(flash, name, rows, {"ay": ("AccY", -1.0, "m/s^2")}), name == "ACC"
    return {}, False


def _imu_messages(parameters: Mapping[str, float], raw: str) -> tuple[str, ...]:
    """Message names, best first: raw samples, unless INS_RAW_LOG_OPT makes them filtered.

    With both kinds logged, filtered ones have higher instance numbers (source:
    AP_InertialSensor_Backend::log_gyro_raw), so instance 0 is always raw.
    """
    options = int(parameters.get("INS_RAW_LOG_OPT", 0))
    filtered = bool(options & RAW_POST_FILTER) and not options & RAW_PRE_AND_POST
    return ("IMU",) if filtered else (raw, "IMU")


def _attitude(flash: DataFlash) -> dict[str, Signal]:
    """phi and psi [rad]; psi unwrapped, left positive."""
    if not flash.has("ATT", "Roll", "Yaw"):
        return {}
    degree = np.pi / 180
    channels = {"phi": ("Roll", degree, "rad"), "psi": ("Yaw", -degree, "rad")}
    return _signals(flash, "ATT", _timed(flash, "ATT", "Roll", "Yaw"), channels)


def velocity(flash: DataFlash) -> dict[str, Signal]:
    """speed and vy [m/s] from the EKF's velocity and yaw; without EKF, speed from GPS."""
    for name in ("XKF1", "NKF1", "EKF1"):
        if flash.has(name, "VN", "VE", "Yaw"):
            core = 0
            if flash.has("XKF4", "PI"):  # the core that was primary most of the time
                core = int(np.bincount(flash.rows("XKF4", "PI")["PI"].astype(np.int64).clip(0)).argmax())
            rows = _first_instance(flash, name, "C", "VN", "VE", "Yaw", number=core)
            t, (vn, ve, yaw) = increasing(
                flash.seconds(name, rows), *(flash.column(name, c, rows) for c in ("VN", "VE", "Yaw"))
            )
            return body_velocity(t, vn, ve, -np.radians(yaw), f"{name}.VN,VE,Yaw")
    if flash.has("GPS", "Spd"):
        rows = _first_instance(flash, "GPS", "I", "Spd")
        return _signals(flash, "GPS", rows, {"speed": ("Spd", 1.0, "m/s")})
    return {}


FIX = 3  # GPS.Status of a position in three dimensions


def _witnesses(flash: DataFlash, signals: Mapping[str, Signal]) -> dict[str, Signal]:
    """Speed, course and yaw rate from other sensors than those of `signals`, to compare."""
    found: dict[str, Signal] = {}
    if flash.has("GPS", "Spd", "GCrs", "Status"):
        rows = _first_instance(flash, "GPS", "I", "Spd", "GCrs", "Status")
        rows = rows[rows["Status"] >= FIX]
        channels = {"gps_speed": ("Spd", 1.0, "m/s"), "gps_course": ("GCrs", -np.pi / 180, "rad")}
        found |= _signals(flash, "GPS", rows, channels)
        if signals.get("speed", found["gps_speed"]).source == found["gps_speed"].source:
            del found["gps_speed"]
    if flash.has("WENC", "Dist0"):
        rows = _timed(flash, "WENC", "Dist0")
        t, (far,) = increasing(flash.seconds("WENC", rows), flash.column("WENC", "Dist0", rows))
        if t.size > 2:
            found["wheel_speed"] = Signal(t, np.gradient(far, t), "m/s", "WENC.Dist0")
    if flash.has("IMU", "I", "GyrZ"):
        rows = _first_instance(flash, "IMU", "I", "GyrZ", number=1)
        if rows.size:
            found["r2"] = replace(
                _signals(flash, "IMU", rows, {"r": ("GyrZ", -1.0, "rad/s")})["r"], source="IMU[1].GyrZ"
            )
    return {name: finite for name, s in found.items() if (finite := finite_signal(s)).t.size}


def _output(flash: DataFlash, channel: int) -> Signal | None:
    """A servo output [us] from RCOU.

    It is logged at 10 Hz at any loop rate, so it samples a much finer staircase. Interpolation suits these
    samples better than `hold`, which would cost 2.4 dB and 50 ms at 4 Hz.
    """
    for column in (f"C{channel}", f"Ch{channel}", f"Chan{channel}"):
        if flash.has("RCOU", column):
            rows = _timed(flash, "RCOU", column)
            sent = _signals(flash, "RCOU", rows, {"pwm": (column, 1.0, "us")})["pwm"]
            return replace(sent, origin="commanded")
    return None


# Servo telemetry (CSRV).


STEP = 0.005  # s, grid of the command
LAGS = (0.0, *np.geomspace(0.005, 0.3, 14))  # s
DELAYS = np.arange(0.0, 0.2, STEP)  # s
MOST = 6000  # samples of the position that are fitted
LEAST_FIT = 0.9  # of the variance of the position; less is another servo
LEAST_SAMPLES = 20


def servo_position(flash: DataFlash, output: int, command: Signal) -> tuple[Signal, Note] | None:
    """(position [us], note with its lag and delay) of the servo on an output (1-based) with a command [us].

    None if the log has no position that follows the command. DroneCAN counts servos from 1, PiccoloCAN and
    4.7 from 0.
    """
    if not flash.has("CSRV", "Id", "Pos"):
        return None
    number, position = flash.column("CSRV", "Id"), flash.column("CSRV", "Pos")
    best: tuple[float, Signal, float, float] | None = None
    for servo in (output, output - 1):
        own = (number == servo) & np.isfinite(position)
        t, (x,) = increasing(flash.seconds("CSRV")[own], position[own])
        inside = (t >= command.t[0]) & (t <= command.t[-1])
        if inside.sum() >= LEAST_SAMPLES and np.ptp(x[inside]) > 0 and np.ptp(command.x) > 0:
            share, scale, offset, lag, delay = _fitted(t[inside], x[inside], command)
            if share >= LEAST_FIT and (best is None or share > best[0]):
                position_us = Signal(t, (x - offset) / scale, "us", "CSRV.Pos", origin="measured")
                best = share, position_us, lag, delay
    if best is None:
        return None
    share, signal, lag, delay = best
    rest = math.sqrt(1 - share) * float(np.std(signal.x))
    return signal, Note(
        "info",
        f"The servo follows the steering output with a delay of {1e3 * delay:.0f} ms and a lag of "
        f"{1e3 * lag:.0f} ms (rest {rest:.1f} us rms), measured by its telemetry (CSRV)",
    )


def _fitted(t: Array, x: Array, command: Signal) -> tuple[float, float, float, float, float]:
    """(explained share of the variance, scale, offset, lag [s], delay [s]) of positions x (n,) at t (n,)."""
    from scipy.signal import lfilter  # slow to import, and most logs have no such telemetry

    every = max(t.size // MOST, 1)
    t, x = t[::every], x[::every]
    grid = np.arange(command.t[0], command.t[-1] + STEP, STEP)
    wanted = command.on(grid)
    best = (-math.inf, 1.0, 0.0, 0.0, 0.0)
    for lag in LAGS:
        decay = math.exp(-STEP / lag) if lag else 0.0
        lagged = lfilter([1 - decay], [1.0, -decay], wanted, zi=[decay * wanted[0]])[0]
        for delay in DELAYS:
            u = np.interp(t - delay, grid, lagged)
            spread = float(np.var(u))
            if spread == 0.0:
                continue
            scale = float(np.mean((u - u.mean()) * (x - x.mean()))) / spread
            share = scale**2 * spread / float(np.var(x))
            if share > best[0] and scale != 0.0:
                best = share, scale, float(x.mean() - scale * u.mean()), float(lag), float(delay)
    return best
