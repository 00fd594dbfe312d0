"""Reads the values that the checks judge. Changes nothing: it restores the rates of the streams."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from statistics import linear_regression, median
from typing import Any, Literal

from firmware_params.param_files import read, shipped
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.vehicle.link.connection import vehicle_seconds
from rover_sweep.vehicle.link.inbox import LinkQuality
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message, constant, kind, message_id
from rover_sweep.vehicle.link.statustext import Said
from rover_sweep.vehicle.link.streams import (
    IDENTIFICATION_RATES,
    Stream,
    StreamMonitor,
    StreamQuality,
    intervals,
    put_back,
    request_all,
)
from rover_sweep.vehicle.link.transport import Line
from rover_sweep.vehicle.parameters import read_present
from rover_sweep.vehicle.run.controls import pump
from rover_sweep.vehicle.setup import SCRIPTS_START, Survey, await_applet, survey, waiting

# Values read from a rover before a run. The checks judge these values and read nothing.
#
# NaN: the vehicle does not report it. None: the message did not arrive.


@dataclass(frozen=True)
class Battery:
    """SYS_STATUS, BATTERY_STATUS. volts [V]; remaining: share of the capacity, 0..1."""

    volts: float = nan
    remaining: float = nan


@dataclass(frozen=True)
class Gps:
    """GPS_RAW_INT. fix: GPS_FIX_TYPE (3: 3D fix); hdop: horizontal dilution of precision [-]."""

    fix: int
    satellites: int
    hdop: float = nan


@dataclass(frozen=True)
class Estimator:
    """EKF_STATUS_REPORT. flags: EKF_STATUS_FLAGS; worst: largest variance of velocity, position and compass
    (1: the limit of the innovation test)."""

    flags: int
    worst: float = 0.0


@dataclass(frozen=True)
class Prearm:
    """The autopilot's own checks before arming. passed: SYS_STATUS reports that all pass; off: it makes none;
    reasons: its texts on those that fail, without "PreArm: "."""

    passed: bool
    off: bool = False
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class ClockComparison:
    """Time stamps of messages against their arrival, over `span` s of the vehicle's clock.

    rate: seconds of the vehicle's clock per second of ours. jitter: delay after the earliest message [s],
    95th percentile. drift: of our clock against the vehicle's [s/s]; bound: its uncertainty from the jitter.
    behind_utc: this computer's UTC minus GPS time [s]. offset: arrival minus the vehicle's clock [s], of the
    earliest message.
    """

    span: float
    rate: float
    jitter: float
    drift: float
    bound: float
    behind_utc: float = nan
    offset: float = nan


@dataclass(frozen=True)
class Observation:
    """All observed values. w_max: top frequency of the planned sweep [rad/s]. channels: PWM of RC_CHANNELS by
    number [us], empty without a receiver; a receiver that lost its radio keeps the last values. radio,
    logging: whether the firmware reports that it hears the radio, that it can log. pending: parameters that
    were set and wait for a reboot. disk: (free bytes, name) of the folder. link: quality of the link during
    the reading. prearm: None where the rover is armed or does not report its checks."""

    survey: Survey
    parameters: Mapping[str, float]
    w_max: float
    armed: bool
    mode: int
    streams: tuple[Stream, ...] = ()
    quality: tuple[StreamQuality, ...] = ()
    clock: ClockComparison | None = None
    battery: Battery | None = None
    gps: Gps | None = None
    estimator: Estimator | None = None
    channels: Mapping[int, int] | None = None
    radio: bool | None = None
    logging: bool | None = None
    pending: tuple[str, ...] = ()
    disk: tuple[int, str] = (0, "")
    link: LinkQuality | None = None
    prearm: Prearm | None = None

    def parameter(self, name: str) -> float:
        """A parameter of the rover, NaN if the rover does not have it."""
        return self.parameters.get(name, nan)


# The result of one check before a run: the observed value and, if there is one, a remedy.


State = Literal["good", "doubtful", "bad", "unknown"]


@dataclass(frozen=True)
class Remedy:
    """words: what it does. reboot: it needs a reboot afterwards. by_hand: only a person can do it. sets: the
    parameters that it sets, (name, value)."""

    words: str
    reboot: bool = False
    by_hand: bool = False
    sets: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Check:
    """The result of a check. name: stable, lower case (link, firmware, applet, parameters, filters,
    loop_rate, ekf, gps, battery, rc, switch, rc_options, disk, streams, source, mode, prearm); seen: the
    observed value in a few words; sentence: what it means."""

    name: str
    state: State
    seen: str
    sentence: str = ""
    remedy: Remedy | None = None


# The vehicle's clock compared with ours: when messages were sent, and when they arrived.


_LEAST = 20  # messages


@dataclass
class ClockMonitor:
    """A listener of a link on `line`. pairs: (vehicle's time, arrival) of each message [s]. behind_utc: this
    computer's UTC minus GPS time [s], NaN if unknown."""

    line: Line
    pairs: list[tuple[float, float]] = field(default_factory=list)
    behind_utc: float = nan

    def __call__(self, message: Message) -> None:
        seconds = vehicle_seconds(message)
        if seconds is not None:
            self.pairs.append((seconds, self.line.monotonic()))
        if kind(message) == "SYSTEM_TIME" and message.time_unix_usec:
            self.behind_utc = self.line.wall() - message.time_unix_usec * 1e-6


def estimate(pairs: Sequence[tuple[float, float]], behind_utc: float = nan) -> ClockComparison | None:
    """Rate, drift and jitter from (vehicle, arrival) pairs [s]; None if there are too few or no time passed.

    The slope of a line through all pairs gives the rate. A message is never early, so the earliest message of
    each half corrects the drift. Its bound comes from the median delay after the earliest message.
    """
    if len(pairs) < _LEAST or pairs[-1][0] <= pairs[0][0] or pairs[-1][1] <= pairs[0][1]:
        return None
    span = pairs[-1][0] - pairs[0][0]
    slope = linear_regression(*zip(*pairs, strict=True)).slope
    late = [arrival - slope * vehicle for vehicle, arrival in pairs]
    quickest, middle = min(late), len(late) // 2
    drift = slope - 1 + (min(late[middle:]) - min(late[:middle])) / (span / 2)
    return ClockComparison(
        span=span,
        rate=span / (pairs[-1][1] - pairs[0][1]),
        jitter=sorted(late)[int(0.95 * (len(late) - 1))] - quickest,
        drift=drift,
        bound=2 * (median(late) - quickest) / (span / 2),
        behind_utc=behind_utc,
        offset=min(arrival - vehicle for vehicle, arrival in pairs),
    )


_ASKED = ("SYS_STATUS", "BATTERY_STATUS", "GPS_RAW_INT", "RC_CHANNELS", "EKF_STATUS_REPORT", "SYSTEM_TIME")
_NAMES = (
    *("INS_GYRO_FILTER", "INS_ACCEL_FILTER", "SCHED_LOOP_RATE", "STAT_BOOTCNT", "SCR_ENABLE"),
    *("LOG_BITMASK", "LOG_BACKEND_TYPE", "LOG_DISARMED"),
    *("FS_THR_ENABLE", "FS_THR_VALUE", "FS_ACTION", "RCMAP_ROLL", "RCMAP_THROTTLE", "SWP_CHAN", "SWP_WMAX"),
    *("MODE_CH", "ARMING_CHECK"),
    *("RC_OVERRIDE_TIME", "SWP_LAPSE", "SWP_BACK", "SWP_V_MIN"),
    *("BATT_LOW_VOLT", "BATT_CRT_VOLT", "BATT_ARM_VOLT"),
    *(f"RC{n}_OPTION" for n in range(1, 17)),
    *("FRAME_CLASS", *(f"SERVO{n}_FUNCTION" for n in range(1, 17))),
)
_NEWER = ("BATT_WATT_MAX", "MOT_REV_DELAY")
_NEWER_SINCE = (4, 7)
_SETTLED, _MEASURED = 0.5, 2.0  # s of the vehicle's clock: ArduPilot slows streams during transfers
_JUDGED = 10.0  # Hz: a slower stream sends too few messages in that time
_ANSWER = 1.0  # s


def look(link: Link, folder: Path, w_max: float | None = None) -> Observation:
    """Read all values, in about 5 s on a fast link. LinkError for anything but an ArduPilot Rover.

    folder: where the runs will be recorded. w_max: top frequency of the planned sweep [rad/s]; if not given,
    the applet's (SWP_WMAX).
    """
    latest = _messages(link)
    has = read_present(link, (*_NAMES, *(_NEWER if link.version >= _NEWER_SINCE else ())))
    if has.get("SCR_ENABLE") == 1 and link.clock.now < SCRIPTS_START:
        await_applet(link, SCRIPTS_START - link.clock.now)
    found = survey(link, read(shipped("identification")))
    sticks = [f"RC{int(has.get(name, usual))}" for name, usual in (("RCMAP_ROLL", 1), ("RCMAP_THROTTLE", 3))]
    has |= read_present(link, [f"{stick}_{what}" for stick in sticks for what in ("TRIM", "DZ")])
    with _asked_to_check(link) as reasons:
        granted, quality, clock = _measured(link, has.get("SCHED_LOOP_RATE", 50.0))
        prearm = None if link.armed else _prearm(link.request_message("SYS_STATUS"), reasons)
    return Observation(
        survey=found,
        parameters=has,
        w_max=w_max or has.get("SWP_WMAX", 0.0) or Sweep().w_max,
        armed=link.armed,
        mode=link.mode,
        streams=granted,
        quality=quality,
        clock=clock,
        pending=waiting(folder, found.vehicle, has.get("STAT_BOOTCNT", 0.0)),
        disk=(_free(folder), folder.name or str(folder)),
        link=link.quality,
        prearm=prearm,
        **_values(latest),
    )


def _messages(link: Link) -> dict[str, Message]:
    """The newest of each message that the checks read, requested all at once."""
    latest: dict[str, Message] = {}

    def keep(message: Message) -> None:
        if kind(message) in _ASKED:
            latest[kind(message)] = message

    with link.listening(keep):
        wanted = [
            name for name in _ASKED if link.command("MAV_CMD_REQUEST_MESSAGE", float(message_id(name))) == 0
        ]
        deadline = link.line.monotonic() + link.quality.wait(_ANSWER)
        while any(name not in latest for name in wanted) and link.line.monotonic() < deadline:
            link.receive(0.1)
    return latest


def _values(latest: Mapping[str, Message]) -> dict[str, Any]:
    """Fields of `Observation` from messages."""
    status, cells = latest.get("SYS_STATUS"), latest.get("BATTERY_STATUS")
    gps, ekf, rc = (latest.get(name) for name in ("GPS_RAW_INT", "EKF_STATUS_REPORT", "RC_CHANNELS"))
    return {
        "battery": _battery(status, cells),
        "radio": _healthy(status, "MAV_SYS_STATUS_SENSOR_RC_RECEIVER"),
        "logging": _healthy(status, "MAV_SYS_STATUS_LOGGING"),
        "gps": None
        if gps is None
        else Gps(int(gps.fix_type), int(gps.satellites_visible), nan if gps.eph == 0xFFFF else gps.eph / 100),
        "estimator": None
        if ekf is None
        else Estimator(
            int(ekf.flags), max(ekf.velocity_variance, ekf.pos_horiz_variance, ekf.compass_variance)
        ),
        "channels": None
        if rc is None
        else {n: int(getattr(rc, f"chan{n}_raw")) for n in range(1, min(rc.chancount, 18) + 1)},
    }


def _battery(status: Message | None, cells: Message | None) -> Battery | None:
    if status is None:
        return None
    volts = nan if status.voltage_battery in (0, 0xFFFF) else status.voltage_battery / 1000
    remaining = status.battery_remaining if cells is None else cells.battery_remaining
    return Battery(volts, nan if remaining < 0 else remaining / 100)


def _healthy(status: Message | None, name: str) -> bool | None:
    """Health of a MAV_SYS_STATUS_SENSOR in SYS_STATUS; None if the firmware does not report it."""
    bit = constant(name)
    if status is None or not status.onboard_control_sensors_present & bit:
        return None
    return bool(status.onboard_control_sensors_health & bit)


_PREARM, _CRITICAL = "PreArm: ", 2  # AP_Arming::check_failed, 4.6.3: a check that counts has this severity


@contextmanager
def _asked_to_check(link: Link) -> Iterator[list[str]]:
    """Let a disarmed autopilot make its checks before arming, and collect its texts inside the block.

    It arms nothing: GCS_MAVLINK::handle_command_run_prearm_checks, 4.6.3. It repeats its texts of its own
    accord every 30 s. SYS_STATUS is up to 1 s older (Rover::one_second_loop).
    """
    reasons: list[str] = []

    def keep(text: Said) -> None:
        reason = text.text.removeprefix(_PREARM)
        if reason != text.text and text.severity <= _CRITICAL and reason not in reasons:
            reasons.append(reason)

    with link.listening(lambda _: None, keep):
        if not link.armed:
            link.command("MAV_CMD_RUN_PREARM_CHECKS")
        yield reasons


def _prearm(status: Message | None, reasons: Sequence[str]) -> Prearm | None:
    """From SYS_STATUS (GCS::update_sensor_status_flags, 4.6.3) and the texts; None without an outcome."""
    bit = constant("MAV_SYS_STATUS_PREARM_CHECK")
    if status is None or not status.onboard_control_sensors_present & bit:
        return Prearm(False, reasons=tuple(reasons)) if reasons else None
    enabled = bool(status.onboard_control_sensors_enabled & bit)
    return Prearm(bool(status.onboard_control_sensors_health & bit), not enabled, tuple(reasons))


def _measured(
    link: Link, loop_rate: float
) -> tuple[tuple[Stream, ...], tuple[StreamQuality, ...], ClockComparison | None]:
    """Set the streams to the rates for identification, measure them, and restore them."""
    with _restored_streams(link):
        granted = request_all(link, loop_rate)
        wanted = frozenset(s.message for s in granted if s.hz >= _JUDGED)
        monitor, clock = StreamMonitor(wanted), ClockMonitor(link.line)
        link.request_message("SYSTEM_TIME")
        pump(link, max(_SETTLED, link.quality.latency or 0.0))
        start, deadline = link.clock.now, link.line.monotonic() + 2 * _MEASURED
        with link.listening(monitor), link.listening(clock):
            while link.clock.now - start < _MEASURED and link.line.monotonic() < deadline:
                link.receive(0.2)
        return granted, monitor.quality(), estimate(clock.pairs, clock.behind_utc)


@contextmanager
def _restored_streams(link: Link) -> Iterator[None]:
    before = intervals(link, IDENTIFICATION_RATES)
    try:
        yield
    finally:
        put_back(link, before)


def _free(folder: Path) -> int:
    """Free bytes on the disk where `folder` is or will be."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    return shutil.disk_usage(there).free
