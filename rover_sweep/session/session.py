"""A session: connect, prepare the vehicle, drive the planned runs, fetch the logs. Yields events.

`rover_sweep.session` describes the files in the folder.
"""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from firmware_params.param_files import WantedParameter, compare
from rover_sweep.data.recording import Note, Recording
from rover_sweep.errors import DataRefused, LinkError, RoverSweepError, UsageError
from rover_sweep.logs.read import read_runs
from rover_sweep.logs.readers.vehicle_clock import dropped_messages
from rover_sweep.manoeuvre.sweep import ThrottleSweep, refuse_undersampled
from rover_sweep.session.content import Content, DrivenRun, FetchedLog, SessionRun, State
from rover_sweep.session.folder import DESCRIPTION, Session, read_folder
from rover_sweep.system import another_stop, hold_stops, one_stop
from rover_sweep.vehicle.events import (
    Connected,
    Event,
    Interrupted,
    LogSaved,
    Notice,
    RunFinished,
    SessionFinished,
    StreamsSet,
)
from rover_sweep.vehicle.identity import check_applet, estimator_ready, identify_vehicle, untested
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message
from rover_sweep.vehicle.link.streams import IDENTIFICATION_RATES, Stream, request_all, stop
from rover_sweep.vehicle.link.transport import Line
from rover_sweep.vehicle.logs import LogEntry, MavlinkLogs
from rover_sweep.vehicle.parameters import read_parameter, read_present
from rover_sweep.vehicle.run.controls import ARM, AUX, FORCE, SCRIPTING_1, RunSettings, pump
from rover_sweep.vehicle.run.follow import STOPPED_STATE
from rover_sweep.vehicle.run.one_run import one_run
from rover_sweep.vehicle.setup import install, refuse_other_applet

# A rover that a run left armed: whether this session did it, and stopping and disarming it afterwards.


_SLOWED = 0.6  # of a granted rate
_REPORTS = 2.5  # s within which an idle applet reports it, once a second
_SAME_DRIVE = 600.0  # s of the vehicle's clock after which somebody else is taken to have armed it


def armed_by_last_run(content: Content, now: float) -> bool:
    """Whether an armed rover was armed by this program for its last run, which it could not end.

    now: time since the vehicle's boot [s].
    """
    if not content.left_armed:
        return False
    span = content.runs[-1].span
    return span is None or 0 <= now - span[1] < _SAME_DRIVE


def stop_and_disarm(link: Link, disarm: bool) -> Iterator[Event]:
    """Stop the applet and, if `disarm`, disarm the rover; never starts anything."""
    if link.command(AUX, float(SCRIPTING_1), 0.0) != 0:
        yield Notice("warning", "this program could not stop the applet: throw the switch low")
    if not (disarm and link.armed):
        return
    if link.command(ARM, 0.0) != 0:
        link.command(ARM, 0.0, FORCE)
    link.wait_for("HEARTBEAT", 3.0, lambda _: not link.armed)
    if link.armed:
        raise LinkError("the rover is armed and this program cannot disarm it; disarm it by hand")
    yield Notice("warning", "the rover was still armed from the run that was cut short, and was disarmed")


def disarm_left_armed(link: Link, content: Content) -> Iterator[Event]:
    """Stop and disarm a rover that the last run of this session left armed; otherwise do nothing."""
    if link.armed and not link.clock.known:
        link.request_message("SYSTEM_TIME")  # its clock shows how old the last run is
    if link.armed and armed_by_last_run(content, link.clock.now):
        yield from stop_and_disarm(link, disarm=True)


# The battery at the end of a recorded run.


def battery_left(tlog: Path) -> float | None:
    """Share of the battery in the last SYS_STATUS, 0 to 1; None where the vehicle does not know it."""
    from rover_sweep.logs.readers.tlog import open_tlog
    from rover_sweep.logs.readers.vehicle_clock import CLOCKS, sessions

    boots = list(sessions(open_tlog(tlog, frozenset((*CLOCKS, "SYS_STATUS"))).messages))
    if not boots or "SYS_STATUS" not in boots[-1].messages:
        return None
    percent = int(boots[-1].messages["SYS_STATUS"].rows["battery_remaining"][-1])
    return percent / 100.0 if 0 <= percent <= 100 else None


# Reads the runs of a session's folder from the vehicle's logs, or from the tlogs if the logs lack them.


_END = 2.0  # s: tolerance between the end of a run and its end in the log


def session_runs(folder: Path, filters: Mapping[str, float] | None = None) -> tuple[Recording, ...]:
    """The completed runs on the steering, in the order driven, with their planned names.

    filters: as in `read_runs`. Notes on the first run name the runs left out. DataRefused if none is left.
    """
    content = read_folder(folder)
    steered = [run for run in content.runs if not isinstance(run.manoeuvre, ThrottleSweep)]
    left_out = [f"{run.label} was left out: {run.reason}" for run in steered if run.state != "done"]
    swept = [run.label for run in content.runs if run not in steered and run.state == "done"]

    @cache
    def runs_of(file: str) -> tuple[Recording, ...]:
        return read_runs(str(folder / file), filters=filters)

    found: list[Recording] = []
    for run in (run for run in steered if run.state == "done"):
        for file in _files(folder, content, run):
            try:
                found.append(replace(_own(runs_of(file), run), name=run.label))
                break
            except DataRefused as refusal:
                why = str(refusal)
        else:
            left_out.append(f"{run.label} was left out: {why}")
    if not found and not (folder / DESCRIPTION).is_file():  # logs in a folder, and no session of ours
        raise UsageError(f"{folder} is a folder; give the path of a .BIN, .tlog or .csv in it")
    if not found and swept and not left_out:
        raise DataRefused(
            f"{folder.name} has throttle sweeps only ({', '.join(swept)}); they are identified from the "
            "vehicle's log: fetch its .BIN"
        )
    if not found:
        raise DataRefused(
            f"no run in {folder.name} was completed ({'; '.join(left_out) or 'none was driven'})"
        )
    notes = tuple(Note("warning", words) for words in left_out)
    return (replace(found[0], notes=(*found[0].notes, *notes)), *found[1:])


def _files(folder: Path, content: Content, run: DrivenRun) -> Sequence[str]:
    """The files that may hold a run, best first."""
    logs = [log.file for log in content.logs if run.label in log.runs and (folder / log.file).is_file()]
    return (*logs, run.tlog)


def _own(found: Sequence[Recording], run: DrivenRun) -> Recording:
    """The recording of that run among those of a file. DataRefused if there is none."""
    if run.span is None:
        raise DataRefused(f"{run.label} has no known time")
    start, end = run.span
    shared = [min(r.span[1], end) - max(r.span[0], start) for r in found]
    if not shared or max(shared) <= 0:
        raise DataRefused(f"the recording does not contain {run.label}")
    return found[shared.index(max(shared))]


def held(log: Path, runs: Sequence[DrivenRun]) -> tuple[str, ...]:
    """Labels of the runs that the DataFlash log holds completely, by the applet's messages in it."""
    from rover_sweep.logs.applet import applet_runs
    from rover_sweep.logs.read import read_logs

    there = [
        (int(rows.run[0]), float(rows.t[0]), float(rows.t[-1]))
        for part in read_logs(str(log))
        for applet in (part.applet, part.throttle_applet)
        if applet is not None
        for rows in applet_runs(applet)
    ]
    return tuple(run.label for run in runs if any(_same(run, *rows) for rows in there))


def _same(run: DrivenRun, number: int, start: float, end: float) -> bool:
    """Whether a run in a log is `run`. The applet's counter continues over boots, so it distinguishes runs at
    the same time after boot."""
    if run.state != "done" or run.span is None or (run.number and number != run.number):
        return False
    return start < run.span[1] and run.span[1] - _END < end < run.span[1] + _END


# From which file each run of a session is identified, and why.


def origin_words(folder: Path, runs: Sequence[Recording]) -> Iterator[str]:
    """A sentence for each file that `session_runs` chose: the vehicle's log if one holds the run completely,
    else the telemetry."""
    fetched = [log.file for log in read_folder(folder).logs]
    for file in dict.fromkeys(run.sources[0][0] for run in runs):
        mine = [run for run in runs if run.sources[0][0] == file]
        # within the run: around it, in HOLD for minutes, the applet reports at 10 Hz
        steering = mine[0].manoeuvre("pwm" if "pwm" in mine[0] else "delta")
        turning = mine[0].manoeuvre("r")
        rates = (
            f"steering ({steering.source}) at {steering.rate:.0f} Hz, "
            f"gyro ({turning.source}) at {turning.rate:.0f} Hz"
        )
        names = ", ".join(run.name for run in mine)
        yield f"{names}: identified from {file}, {rates}; {_why(folder, file, fetched)}"


def _why(folder: Path, file: str, fetched: Sequence[str]) -> str:
    if file in fetched:
        return f"the rover's log holds the whole run on one clock, {_dropped(folder / file)}"
    if fetched:
        return f"not from {', '.join(fetched)}, where the run is incomplete"
    return "the rover's log was not fetched"


def _dropped(log: Path) -> str:
    lost = dropped_messages(log)
    if lost is None:
        return "and does not report whether messages were dropped"
    return f"{lost or 'no'} {'message' if lost == 1 else 'messages'} dropped (DSF.Dp)"


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
    fetched. A run that stops early also ends the session if this program arms.
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
        streams = yield from start_streams(link)
        yield from await_estimator(link)
        finished: list[RunFinished] = []
        for planned in session.to_drive:
            if finished and (slowed := _slowed(finished[-1], streams)):
                yield Notice("warning", f"{slowed}; the streams are requested again")
                request_all(link, read_parameter(link, "SCHED_LOOP_RATE"))
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
    rover's loop rate. LinkError if the applet does not run, or another one runs and this program is to drive
    or to throw the switch."""
    present = check_applet(link)
    if settings.arm or settings.trigger != "pilot":
        refuse_other_applet(link, present)
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
    noted: list[RunFinished] = []
    unwritten: list[RoverSweepError] = []

    def ended(state: State, reason: str, **known: Any) -> None:
        """A disk that takes nothing more must not hide what the rover does."""
        try:
            session.ended(tlog, state, reason, _left_armed(link, settings), **known)
        except RoverSweepError as error:
            unwritten.append(error)

    def note(run: RunFinished) -> None:
        noted.append(run)
        quality = tuple(asdict(stream) for stream in run.quality)
        state: State = "done" if run.completed else "stopped"
        ended(state, run.reason, span=run.span, number=run.number, quality=quality)

    stopped: Interrupted | None = None
    with one_stop() as came:
        try:
            finished = yield from one_run(link, planned.manoeuvre, planned.name, tlog, settings, note)
        except KeyboardInterrupt as stop:
            hold_stops()
            confirmed, armed = _confirms(link), link.armed or link.may_be_armed
            if not noted:
                ended("stopped", "interrupted")
            failures = tuple(dict.fromkeys(getattr(stop, "__notes__", ())))
            stopped = Interrupted(planned.name, tlog, failures, armed, confirmed)
        except BaseException as error:
            hold_stops()
            if not noted:
                ended("cut", str(error) or "the program ended")
            for failure in unwritten:
                error.add_note(str(failure))
            raise
        interrupted = came()
    if stopped is not None:
        yield stopped
    elif words := link.quality.words:
        yield Notice("warning", f"after {planned.name}: {words}")
    if unwritten:
        raise unwritten[0]
    if stopped is not None:
        return None
    if interrupted:  # after the manoeuvre, while the rover was released
        raise KeyboardInterrupt
    return finished


def _confirms(link: Link) -> bool:
    """Whether the rover reports, after its release, that the applet does not steer."""
    try:
        with another_stop(), link.unwatched():
            if link.wait_for("NAMED_VALUE_FLOAT", _REPORTS, _is_idle) is None:
                return False
            if link.armed and not link.may_be_armed:  # its last heartbeat may be older than the order
                link.wait_for("HEARTBEAT", _REPORTS)
            return True
    except (RoverSweepError, KeyboardInterrupt):
        return False


def _is_idle(message: Message) -> bool:
    return message.name == "SWP_ST" and int(message.value) in (0, STOPPED_STATE)


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


def start_streams(link: Link) -> Generator[Event, None, tuple[Stream, ...]]:
    """Request the streams for identification, and report the granted rates; returns them."""
    streams = request_all(link, read_parameter(link, "SCHED_LOOP_RATE"))
    yield StreamsSet(streams)
    for stream in streams:
        if stream.advice:
            yield Notice("warning", stream.advice)
    return streams


def _slowed(run: RunFinished, streams: Sequence[Stream]) -> str:
    """A sentence if messages came much more rarely than granted, as when another station set their rates."""
    granted = {stream.message: stream.hz for stream in streams}
    rates = [
        f"{q.message} came at {q.mean_hz:.0f} instead of {granted[q.message]:.0f} Hz"
        for q in run.quality
        if q.count > 2 and q.mean_hz < _SLOWED * granted.get(q.message, 0.0)
    ]
    asks = "does another ground station set the rates of this port?"
    return f"in {run.name} {', '.join(rates)}: {asks}" if rates else ""


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
