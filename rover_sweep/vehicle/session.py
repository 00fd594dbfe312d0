"""A session: connect, prepare the vehicle, drive the planned runs, fetch the logs. Yields events.

What lies in the folder afterwards: connect.tlog (until the first run), NAME.tlog of each run, the
vehicle's .BIN logs as logNUMBER.BIN (fetch.tlog is the traffic of fetching them), and session.json,
which says what is what.
"""

from __future__ import annotations

import contextlib
import datetime
from collections.abc import Generator, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from firmware_params.check import WantedParameter, compare
from rover_sweep import __version__
from rover_sweep.errors import UsageError
from rover_sweep.identify.sweep import Manoeuvre
from rover_sweep.vehicle.controls import pump
from rover_sweep.vehicle.events import (
    Connected,
    Event,
    Interrupted,
    Notice,
    RunFinished,
    SessionFinished,
    StreamsSet,
)
from rover_sweep.vehicle.identity import Vehicle, check_applet, identify_vehicle, untried
from rover_sweep.vehicle.install import install
from rover_sweep.vehicle.link import Link
from rover_sweep.vehicle.log_download import LogEntry, LogSaved, MavlinkLogs
from rover_sweep.vehicle.manoeuvre import refuse_undersampled
from rover_sweep.vehicle.mavlink import constant
from rover_sweep.vehicle.parameters import read, read_present
from rover_sweep.vehicle.recorder import Session
from rover_sweep.vehicle.run import RunSettings, run
from rover_sweep.vehicle.streams import IDENTIFICATION_RATES, request_all, stop
from rover_sweep.vehicle.transport import Line


@dataclass(frozen=True)
class PlannedRun:
    """One run of a session; name is that of its .tlog."""

    name: str
    manoeuvre: Manoeuvre


@dataclass(frozen=True)
class Plan:
    """What a session does. parameters: those that are set where they differ (with a reboot where one
    needs it); checked: those that are only compared, a warning each. applet: file to bring onto a vehicle
    that does not run it. logs: fetch the .BIN logs."""

    runs: tuple[PlannedRun, ...]
    settings: RunSettings = field(default_factory=RunSettings)
    parameters: tuple[WantedParameter, ...] = ()
    checked: tuple[WantedParameter, ...] = ()
    applet: Path | None = None
    logs: bool = True


def drive(url: str, folder: Path, plan: Plan, line: Line | None = None) -> Generator[Event, None, None]:
    """Carry the plan out on the vehicle at `url`, recording into `folder`. line: see `Link.open`.

    Ctrl-C (or KeyboardInterrupt thrown in) during a run ends that run and all further ones, and the
    logs are fetched; so does a run that was stopped on a rover that this program arms.
    """
    session = Session.create(folder)
    with Link.open(url, session.tlog("connect"), line=line) as link:
        vehicle = identify_vehicle(link)
        if warning := untried(vehicle):
            yield Notice("warning", warning)
        yield from install(link, plan.parameters, plan.applet)
        _refuse_amplitudes(check_applet(link), plan)
        for planned in plan.runs:
            refuse_undersampled(planned.manoeuvre, read(link, "SCHED_LOOP_RATE"))
        yield Connected(url, vehicle)
        for difference in compare(read_present(link, [p.name for p in plan.checked]), plan.checked):
            yield Notice("warning", difference.sentence)
        logs = MavlinkLogs(link)
        before = logs.logs() if plan.logs else ()
        yield from _start_streams(link)
        yield from _await_estimator(link)
        finished: list[RunFinished] = []
        for planned in plan.runs:
            go_on = yield from _run(link, planned, session.tlog(planned.name), plan.settings, finished)
            _describe(session, vehicle, plan, finished, ())
            if not go_on:
                break
        stop(link, IDENTIFICATION_RATES)
        saved: list[Path] = []
        if plan.logs and (yield from _disarmed(link, plan.settings.patience)):
            link.record_to(session.tlog("fetch"))
            yield from _fetch(logs, before, folder, saved)
    _describe(session, vehicle, plan, finished, saved)
    yield SessionFinished(folder, tuple(finished), tuple(saved))


def _refuse_amplitudes(present: Mapping[str, float], plan: Plan) -> None:
    """Before anything moves: the applet would refuse these at the switch."""
    limit = plan.settings.extra.get("pwm_max", present["SWP_PWM_MAX"])
    for planned in plan.runs:
        if planned.manoeuvre.peak > limit:
            raise UsageError(
                f"{planned.name} asks for {planned.manoeuvre.peak:g} us, but the rover's SWP_PWM_MAX "
                f"allows {limit:g} us; take less, or raise SWP_PWM_MAX if the steering moves freely that far"
            )


def _run(
    link: Link, planned: PlannedRun, tlog: Path, settings: RunSettings, finished: list[RunFinished]
) -> Generator[Event, None, bool]:
    """One run, added to `finished`; whether the session goes on to the next."""
    try:
        finished.append((yield from run(link, planned.manoeuvre, planned.name, tlog, settings)))
    except KeyboardInterrupt as stopped:
        yield Interrupted(planned.name, tlog, tuple(getattr(stopped, "__notes__", ())), link.armed)
        return False
    return finished[-1].completed or not settings.arm


def _disarmed(link: Link, patience: float) -> Generator[Event, None, bool]:
    """Wait up to `patience` s until the pilot has disarmed: ArduPilot gives no logs while armed."""
    if not link.armed:
        return True
    yield Notice("info", "disarm the rover: its log can only be fetched then (Ctrl-C does without the log)")
    deadline = link.line.monotonic() + patience
    with contextlib.suppress(KeyboardInterrupt):
        while link.armed and link.line.monotonic() < deadline:
            link.receive(0.5)
    if link.armed:
        yield Notice("warning", "the rover is armed: its log stays on its card, the .tlog files are here")
    return not link.armed


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
