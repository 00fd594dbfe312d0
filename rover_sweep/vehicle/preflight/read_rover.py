"""Reads the values that the checks judge. Changes nothing: it restores the rates of the streams."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import nan
from pathlib import Path
from typing import Any

from firmware_params.param_files import read, shipped
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message, constant, kind, message_id
from rover_sweep.vehicle.link.streams import (
    IDENTIFICATION_RATES,
    Stream,
    StreamMonitor,
    StreamQuality,
    intervals,
    put_back,
    request_all,
)
from rover_sweep.vehicle.parameters.read_write import read_present
from rover_sweep.vehicle.preflight.clock_comparison import ClockMonitor, estimate
from rover_sweep.vehicle.preflight.observed import Battery, ClockComparison, Estimator, Gps, Observation
from rover_sweep.vehicle.run.controls import pump
from rover_sweep.vehicle.setup import pending_reboot
from rover_sweep.vehicle.setup.applet_upload import await_applet
from rover_sweep.vehicle.setup.survey import survey

_ASKED = ("SYS_STATUS", "BATTERY_STATUS", "GPS_RAW_INT", "RC_CHANNELS", "EKF_STATUS_REPORT", "SYSTEM_TIME")
_NAMES = (
    *("INS_GYRO_FILTER", "INS_ACCEL_FILTER", "SCHED_LOOP_RATE", "STAT_BOOTCNT", "SCR_ENABLE"),
    *("LOG_BITMASK", "LOG_BACKEND_TYPE", "LOG_DISARMED"),
    *("FS_THR_ENABLE", "FS_THR_VALUE", "FS_ACTION", "RCMAP_ROLL", "RCMAP_THROTTLE", "SWP_CHAN", "SWP_WMAX"),
    *("BATT_LOW_VOLT", "BATT_CRT_VOLT", "BATT_ARM_VOLT"),
    *(f"RC{n}_OPTION" for n in range(1, 17)),
    *("FRAME_CLASS", *(f"SERVO{n}_FUNCTION" for n in range(1, 17))),
)
_SETTLED, _MEASURED = 0.5, 2.0  # s of the vehicle's clock: ArduPilot slows streams during transfers
_JUDGED = 10.0  # Hz: a slower stream sends too few messages in that time
_SCRIPTS_START = 20.0  # s after boot within which scripts start
_ANSWER = 1.0  # s


def look(link: Link, folder: Path, w_max: float | None = None) -> Observation:
    """Read all values, in about 5 s on a fast link. LinkError for anything but an ArduPilot Rover.

    folder: where the runs will be recorded. w_max: top frequency of the planned sweep [rad/s]; if not given,
    the applet's (SWP_WMAX).
    """
    latest = _messages(link)
    has = read_present(link, _NAMES)
    if has.get("SCR_ENABLE") == 1 and link.clock.now < _SCRIPTS_START:
        await_applet(link, _SCRIPTS_START - link.clock.now)
    found = survey(link, read(shipped("identification")))
    sticks = [f"RC{int(has.get(name, usual))}" for name, usual in (("RCMAP_ROLL", 1), ("RCMAP_THROTTLE", 3))]
    has |= read_present(link, [f"{stick}_{what}" for stick in sticks for what in ("TRIM", "DZ")])
    granted, quality, clock = _measured(link, has.get("SCHED_LOOP_RATE", 50.0))
    return Observation(
        survey=found,
        parameters=has,
        w_max=w_max or has.get("SWP_WMAX", 0.0) or Sweep().w_max,
        armed=link.armed,
        mode=link.mode,
        streams=granted,
        quality=quality,
        clock=clock,
        pending=pending_reboot.waiting(folder, found.vehicle, has.get("STAT_BOOTCNT", 0.0)),
        disk=(_free(folder), folder.name or str(folder)),
        link=link.quality,
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
