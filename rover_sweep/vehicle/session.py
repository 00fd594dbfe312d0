"""A session: connect, prepare the vehicle, drive the planned runs, fetch the logs. Yields events.

What lies in the folder afterwards: connect.tlog (until the first run), NAME.tlog of each run, the
vehicle's .BIN logs as logNUMBER.BIN (fetch.tlog is the traffic of fetching them), and session.json,
which says what is what.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from firmware_params.check import WantedParameter, compare
from rover_sweep import __version__
from rover_sweep.errors import LinkError
from rover_sweep.identify.sweep import Manoeuvre
from rover_sweep.vehicle.applet import await_applet, reboot, restart_scripts, upload
from rover_sweep.vehicle.controls import pump
from rover_sweep.vehicle.events import (
    Connected,
    Event,
    Notice,
    ParameterSet,
    Rebooting,
    RunFinished,
    SessionFinished,
    StreamsSet,
)
from rover_sweep.vehicle.identity import Vehicle, check_applet, identify_vehicle, untried
from rover_sweep.vehicle.link import Link
from rover_sweep.vehicle.log_download import LogEntry, LogSaved, MavlinkLogs
from rover_sweep.vehicle.mavlink import constant
from rover_sweep.vehicle.parameters import read, read_present, write
from rover_sweep.vehicle.recorder import Session
from rover_sweep.vehicle.run import RunSettings, run
from rover_sweep.vehicle.streams import IDENTIFICATION_RATES, request_all, stop

_SCRIPTS_START = 20.0  # s after boot within which scripts begin to run


@dataclass(frozen=True)
class PlannedRun:
    """One run of a session; name is that of its .tlog."""

    name: str
    manoeuvre: Manoeuvre


@dataclass(frozen=True)
class Plan:
    """What a session does. parameters: those that are set where they differ (with a reboot where one
    needs it). applet: file to bring onto a vehicle that does not run it. logs: fetch the .BIN logs."""

    runs: tuple[PlannedRun, ...]
    settings: RunSettings = field(default_factory=RunSettings)
    parameters: tuple[WantedParameter, ...] = ()
    applet: Path | None = None
    logs: bool = True


def drive(url: str, folder: Path, plan: Plan) -> Iterator[Event]:
    """Carry the plan out on the vehicle at `url`, recording into `folder`."""
    session = Session.create(folder)
    with Link.open(url, session.tlog("connect")) as link:
        vehicle = identify_vehicle(link)
        if warning := untried(vehicle):
            yield Notice("warning", warning)
        yield from _prepare(link, plan)
        check_applet(link)
        yield Connected(url, vehicle)
        logs = MavlinkLogs(link)
        before = logs.logs() if plan.logs else ()
        yield from _start_streams(link)
        yield from _await_estimator(link)
        finished: list[RunFinished] = []
        for planned in plan.runs:
            for event in run(
                link, planned.manoeuvre, planned.name, session.tlog(planned.name), plan.settings
            ):
                yield event
                if isinstance(event, RunFinished):
                    finished.append(event)
                    _describe(session, vehicle, plan, finished, ())
        stop(link, IDENTIFICATION_RATES)
        saved: list[Path] = []
        if plan.logs:
            link.record_to(session.tlog("fetch"))
            yield from _fetch(logs, before, folder, saved)
    _describe(session, vehicle, plan, finished, saved)
    yield SessionFinished(folder, tuple(finished), tuple(saved))


def _prepare(link: Link, plan: Plan) -> Iterator[Event]:
    """Parameters and applet as wanted, with at most two reboots."""
    if link.armed:
        raise LinkError("the rover is armed; disarm it before a session prepares it")
    wanted = compare(read_present(link, [p.name for p in plan.parameters]), plan.parameters)
    because = []
    for difference in wanted:
        if difference.found is None:
            yield Notice("warning", difference.sentence)
            continue
        written = write(link, difference.name, difference.wanted)
        yield ParameterSet(written.name, written.old, written.value, difference.needs_reboot)
        because += [difference.name] if difference.needs_reboot else []
    if because:
        yield Rebooting(tuple(because))
        reboot(link)
    patience = _SCRIPTS_START if link.clock.now < _SCRIPTS_START else 0.0
    if plan.applet is not None and not await_applet(link, patience):
        yield from _bring_applet(link, plan.applet)


def _bring_applet(link: Link, applet: Path) -> Iterator[Event]:
    place = upload(link, applet)
    yield Notice("info", f"the applet was copied to {place}")
    restart_scripts(link)
    if not await_applet(link):
        yield Rebooting((applet.name,))
        reboot(link)
        await_applet(link)


def _start_streams(link: Link) -> Iterator[Event]:
    streams = request_all(link, read(link, "SCHED_LOOP_RATE"))
    yield StreamsSet(streams)
    for stream in streams:
        if stream.advice:
            yield Notice("warning", stream.advice)


def _await_estimator(link: Link, patience: float = 90.0) -> Iterator[Event]:
    """Wait until the EKF uses GPS. The real firmware arms before that, some 20 s early in SITL, and
    speed and heading change their source in the middle of a run that began then."""
    start, told = link.clock.now, False
    while not _estimator_ready(link):
        if link.clock.now - start > patience:
            yield Notice(
                "warning", f"the EKF has no position after {patience:.0f} s; speeds are not to be trusted"
            )
            return
        if not told:
            yield Notice("info", "waiting for the EKF to use GPS")
            told = True
        pump(link, 1.0)


def _estimator_ready(link: Link) -> bool:
    """Whether velocity and absolute position are estimated (EKF_STATUS_REPORT)."""
    report = link.request_message("EKF_STATUS_REPORT")
    if report is None:
        return False
    flags = int(report.flags)
    wanted = constant("EKF_VELOCITY_HORIZ") | constant("EKF_POS_HORIZ_ABS")
    return flags & wanted == wanted and not flags & constant("EKF_CONST_POS_MODE")


def _fetch(
    logs: MavlinkLogs, before: tuple[LogEntry, ...], folder: Path, saved: list[Path]
) -> Iterator[Event]:
    """Download the logs that are new or have grown since `before`."""
    known = set(before)
    for entry in logs.logs():
        if entry in known:
            continue
        for event in logs.download(entry, folder / f"log{entry.number}.BIN"):
            yield event
            if isinstance(event, LogSaved):
                saved.append(event.path)


def _describe(
    session: Session,
    vehicle: Vehicle,
    plan: Plan,
    finished: list[RunFinished],
    logs: tuple[Path, ...] | list[Path],
) -> None:
    manoeuvres = {planned.name: planned.manoeuvre for planned in plan.runs}
    session.describe(
        {
            "format": "rover-sweep session 1",
            "rover_sweep": __version__,
            "written": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "vehicle": asdict(vehicle),
            "settings": asdict(plan.settings),
            "parameters": {p.name: p.value for p in plan.parameters},
            "runs": [
                {
                    **asdict(event),
                    "tlog": event.tlog.name,
                    "span_unit": "s since boot",
                    "manoeuvre": asdict(manoeuvres[event.name]),
                }
                for event in finished
            ],
            "logs": [path.name for path in logs],
        }
    )
