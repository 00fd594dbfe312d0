"""A session: connect, prepare the vehicle, drive the planned runs, fetch the logs. Yields events.

`rover_sweep.session` describes the files in the folder.
"""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from firmware_params.param_files import WantedParameter, compare
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.manoeuvre.applet_values import refuse_undersampled
from rover_sweep.session.content import FetchedLog, SessionRun
from rover_sweep.session.folder import Session
from rover_sweep.session.left_armed import disarm_left_armed
from rover_sweep.session.recordings import held
from rover_sweep.vehicle.estimator import estimator_ready
from rover_sweep.vehicle.events import (
    Connected,
    Event,
    Interrupted,
    Notice,
    RunFinished,
    SessionFinished,
    StreamsSet,
)
from rover_sweep.vehicle.identity import check_applet, identify_vehicle, untested
from rover_sweep.vehicle.link.access import Access
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.streams import IDENTIFICATION_RATES, request_all, stop
from rover_sweep.vehicle.link.transport import Line
from rover_sweep.vehicle.logs.download import LogEntry, LogSaved, MavlinkLogs
from rover_sweep.vehicle.parameters.read_write import read_parameter, read_present
from rover_sweep.vehicle.run.controls import pump
from rover_sweep.vehicle.run.one_run import one_run
from rover_sweep.vehicle.run.settings import RunSettings
from rover_sweep.vehicle.setup.install import install


@dataclass(frozen=True)
class SessionPlan:
    """The plan of a session. parameters: set if they differ (with a reboot if one needs it); checked: only
    compared, with a warning for each difference. applet: file to copy to a vehicle that does not run it.
    logs: fetch the .BIN logs."""

    runs: tuple[SessionRun, ...]
    settings: RunSettings = field(default_factory=RunSettings)
    parameters: tuple[WantedParameter, ...] = ()
    checked: tuple[WantedParameter, ...] = ()
    applet: Path | None = None
    logs: bool = True


def drive(
    url: str,
    folder: Path,
    plan: SessionPlan,
    line: Line | None = None,
    vehicle_file: Path | None = None,
    access: Access | None = None,
) -> Generator[Event, None, None]:
    """Carry out the plan on the vehicle at `url`, recording into `folder`. line, access: see `Link.open`.

    In a folder with a session, only the runs not completed yet are driven. vehicle_file: copied into the
    folder. Ctrl-C (or KeyboardInterrupt thrown in) during a run ends this run and the session; the logs are
    fetched. So does a run that stops early on a rover that this program arms.
    """
    with contextlib.closing(Session.open(folder)) as session:
        if vehicle_file is not None:
            session.keep_vehicle_file(vehicle_file)
        yield from _drive(url, session, plan, line, access)


def _drive(
    url: str, session: Session, plan: SessionPlan, line: Line | None, access: Access | None
) -> Generator[Event, None, None]:
    session.plan(plan.runs)
    session.set(asdict(plan.settings), {p.name: p.value for p in plan.parameters})
    with Link.open(url, session.between(), line=line, access=access) as link:
        vehicle = identify_vehicle(link)
        session.on(asdict(vehicle))
        if warning := untested(vehicle):
            yield Notice("warning", warning)
        yield from disarm_left_armed(link, session.content)
        yield from install(link, plan.parameters, plan.applet)
        refuse_impossible(link, session.to_drive, plan.settings)
        yield Connected(url, vehicle)
        for difference in compare(read_present(link, [p.name for p in plan.checked]), plan.checked):
            yield Notice("warning", difference.sentence)
        logs = MavlinkLogs(link)
        if plan.logs:
            session.logs_before(listed(logs.logs()))
        yield from start_streams(link)
        yield from await_estimator(link)
        finished: list[RunFinished] = []
        for planned in session.to_drive:
            if not (yield from _run(link, planned, session, plan.settings, finished)):
                break
        stop(link, IDENTIFICATION_RATES)
        if plan.logs and (yield from _disarmed(link, plan.settings.patience)):
            link.record_to(session.tlog("fetch"))
            for event in fetch_new_logs(logs, session):
                if isinstance(event, LogSaved):
                    note_runs(session, event.path.name)
                yield event
    saved = tuple(session.folder / log.file for log in session.content.logs)
    yield SessionFinished(session.folder, tuple(finished), saved)


def refuse_impossible(link: Link, runs: Sequence[SessionRun], settings: RunSettings) -> None:
    """UsageError, before anything moves, for runs that the applet would refuse, or that are too fast for this
    rover's loop rate. LinkError if the applet does not run."""
    present = check_applet(link)
    limit = settings.extra.get("pwm_max", present["SWP_PWM_MAX"])
    for planned in runs:
        if planned.manoeuvre.peak > limit:
            raise UsageError(
                f"{planned.name} needs {planned.manoeuvre.peak:g} us, but the rover's SWP_PWM_MAX "
                f"allows {limit:g} us; give less, or raise SWP_PWM_MAX if the steering moves freely that far"
            )
        refuse_undersampled(planned.manoeuvre, read_parameter(link, "SCHED_LOOP_RATE"))


def recorded_run(
    link: Link, planned: SessionRun, session: Session, settings: RunSettings
) -> Generator[Event, None, RunFinished | None]:
    """One run, noted in the session before it starts and after it ended; None if it was interrupted.

    KeyboardInterrupt (thrown in, or raised by the link) stops and releases the rover and ends the run.
    """
    tlog = session.tlog(planned.name)
    session.begun(planned, tlog, settings.arm)
    try:
        ended = yield from one_run(link, planned.manoeuvre, planned.name, tlog, settings)
    except KeyboardInterrupt as stopped:
        session.ended(tlog, "stopped", "interrupted", _left_armed(link, settings))
        armed = link.armed or link.may_be_armed
        yield Interrupted(planned.name, tlog, tuple(getattr(stopped, "__notes__", ())), armed)
        return None
    except BaseException as error:
        session.ended(tlog, "cut", str(error) or "the program ended", _left_armed(link, settings))
        raise
    session.ended(
        tlog,
        "done" if ended.completed else "stopped",
        ended.reason,
        _left_armed(link, settings),
        span=ended.span,
        number=ended.number,
        quality=tuple(asdict(stream) for stream in ended.quality),
    )
    if words := link.quality.words:
        yield Notice("warning", f"after {planned.name}: {words}")
    return ended


def _left_armed(link: Link, settings: RunSettings) -> bool:
    return settings.arm and (link.armed or link.may_be_armed)


def _run(
    link: Link, planned: SessionRun, session: Session, settings: RunSettings, finished: list[RunFinished]
) -> Generator[Event, None, bool]:
    """One run, added to `finished`. Returns whether the session continues with the next."""
    ended = yield from recorded_run(link, planned, session, settings)
    if ended is None:
        return False
    finished.append(ended)
    return ended.completed or not settings.arm


def _disarmed(link: Link, patience: float) -> Generator[Event, None, bool]:
    """Wait up to `patience` s until the pilot has disarmed: ArduPilot sends no logs while armed."""
    if not link.armed:
        return True
    yield Notice("info", "disarm the rover, so that its log can be fetched (Ctrl-C: skip the log)")
    deadline = link.line.monotonic() + patience
    with contextlib.suppress(KeyboardInterrupt):
        while link.armed and link.line.monotonic() < deadline:
            link.receive(0.5)
    if link.armed:
        yield Notice(
            "warning", "the rover is still armed, so its log stays on its card; the .tlog files are saved"
        )
    return not link.armed


def start_streams(link: Link) -> Iterator[Event]:
    """Request the streams for identification, and report the granted rates."""
    streams = request_all(link, read_parameter(link, "SCHED_LOOP_RATE"))
    yield StreamsSet(streams)
    for stream in streams:
        if stream.advice:
            yield Notice("warning", stream.advice)


def await_estimator(link: Link, patience: float = 90.0) -> Iterator[Event]:
    """Wait up to `patience` s until the EKF uses GPS. The real firmware arms some 20 s before that in SITL;
    then speed and heading would change their source in the middle of a run."""
    start, announced = link.clock.now, False
    while not estimator_ready(link):
        if link.clock.now - start > patience:
            yield Notice(
                "warning", f"the EKF has no position after {patience:.0f} s; do not trust the speeds"
            )
            return
        if not announced:
            yield Notice("info", "waiting for the EKF to use GPS")
            announced = True
        pump(link, 1.0)


def listed(logs: Sequence[LogEntry]) -> tuple[tuple[int, int, int], ...]:
    """(number, size, time_utc) of each log, as a session stores them."""
    return tuple((log.number, log.size, log.time_utc) for log in logs)


def fetch_new_logs(logs: MavlinkLogs, session: Session) -> Iterator[Event]:
    """Download the logs that are new or have grown since the session began, unless already fetched. The
    caller runs `note_runs` after each LogSaved.

    The time of a log is no criterion: 4.6.3 lists the same log with another time at each request.
    """
    known = {(number, size) for number, size, _ in session.content.logs_before or ()}
    known |= {(log.number, log.size) for log in session.content.logs}
    for entry in logs.logs():
        if (entry.number, entry.size) in known:
            continue
        for event in logs.download(entry, _place(session, entry)):
            if isinstance(event, LogSaved):
                session.fetched(FetchedLog(event.path.name, entry.number, entry.size, entry.time_utc))
            yield event


def note_runs(session: Session, file: str) -> None:
    """Find which runs a fetched log holds, and store them in the session."""
    try:
        runs = held(session.folder / file, session.content.runs)
    except DataRefused:  # another kind of log; the runs are in the tlogs
        return
    log = next(log for log in session.content.logs if log.file == file)
    session.fetched(replace(log, runs=runs))


def _place(session: Session, entry: LogEntry) -> Path:
    """logNUMBER.BIN: replaces an earlier part of the same log, but no other log of that number."""
    name, number = f"log{entry.number}.BIN", 2
    known = {log.file: log for log in session.content.logs}
    while (session.folder / name).exists():
        earlier = known.get(name)
        if earlier and earlier.time_utc == entry.time_utc and earlier.size <= entry.size:
            break
        name, number = f"log{entry.number}-{number}.BIN", number + 1
    return session.folder / name
