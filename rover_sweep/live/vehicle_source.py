"""A vehicle on a link as the source of a screen: one thread owns the link and does the requests.

The link is pumped all the time, also while nothing is asked: telemetry is recorded, and reported about ten
times a second. `abort` reaches a run wherever it waits for the vehicle. A link that is lost is opened
again until the source is closed; what was recorded stays, the run that was cut is written down as such,
and a rover that it left armed is disarmed once it answers. Without this program: the switch low,
a change of mode, disarming; and the override lapses after RC_OVERRIDE_TIME, see `vehicle.run`.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue

from firmware_params.applet_parameters import PARAMETERS
from rover_sweep.errors import LinkError, RoverSweepError, UsageError
from rover_sweep.live.source import (
    Began,
    Checked,
    Connect,
    DriveRequest,
    Ended,
    FetchLogs,
    Fix,
    Judged,
    Lost,
    Preflight,
    Request,
    Several,
    Telemetry,
    Update,
    Verdict,
)
from rover_sweep.live.verdict import stopped_verdict, too_fast
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import Span
from rover_sweep.session.folder import Session
from rover_sweep.session.session import (
    await_estimator,
    disarm_left_armed,
    fetch_new_logs,
    listed,
    note_runs,
    recorded_run,
    refuse_impossible,
    start_streams,
    stop_and_disarm,
)
from rover_sweep.vehicle.events import Connected, Interrupted, LogSaved, Notice, Rebooting, RunStarted
from rover_sweep.vehicle.identity import AppletUnready, identify_vehicle, untested
from rover_sweep.vehicle.link.connection import Access, SeveralVehicles
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message
from rover_sweep.vehicle.link.streams import IDENTIFICATION_RATES, request_all
from rover_sweep.vehicle.link.transport import Line
from rover_sweep.vehicle.logs import MavlinkLogs
from rover_sweep.vehicle.parameters import read_parameter, read_present
from rover_sweep.vehicle.preflight.read_rover import Check
from rover_sweep.vehicle.preflight.readiness import preflight, remedy
from rover_sweep.vehicle.run.controls import MAY_BE_ARMED, find_channels

# Slow computations in a thread of their own: verdicts on runs, and the runs in a fetched log.


class Background:
    """One thread, which judges a run within a second, because the imports are loaded beforehand."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="beside the link")
        self._given: SimpleQueue[Verdict] = SimpleQueue()
        self._pool.submit(_load)

    def judge(self, tlog: Path, span: Span, name: str, vehicle_file: Path | None) -> None:
        """Begin to judge a run that came to its end."""
        self._pool.submit(lambda: self._given.put(_judged(tlog, span, name, vehicle_file)))

    def tell(self, verdict: Verdict) -> None:
        """Add a verdict that needs no computing, after those in progress."""
        self._pool.submit(self._given.put, verdict)

    def given(self) -> Iterator[Verdict]:
        """The verdicts that were found since the last call."""
        while True:
            try:
                yield self._given.get_nowait()
            except Empty:
                return

    def work(self, work: Callable[[], None]) -> Future[None]:
        """Run any other work in the thread."""
        return self._pool.submit(work)

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


def _load() -> None:
    """The imports of a verdict take longer than the verdict."""
    import scipy.signal  # noqa: F401


def _judged(tlog: Path, span: Span, name: str, vehicle_file: Path | None) -> Verdict:
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.live.verdict import judge

    try:
        return judge(tlog, span, name, load(vehicle_file) if vehicle_file else None)
    except UsageError as error:  # a vehicle file that was written into meanwhile
        return replace(judge(tlog, span, name), remarks=(str(error),))
    except Exception as error:  # a failed verdict must not end the session
        return Verdict(
            name, "repeat", f"it could not be judged ({error!r}); its recording is kept", source=tlog
        )


# Stopping: the exception that ends a run at once.


class Aborted(KeyboardInterrupt):
    """Somebody pressed abort. A KeyboardInterrupt, so that a run lets the rover go as after Ctrl-C."""


# Carries out the requests on a vehicle's link, as generators of updates.


# Of what only a screen needs [Hz]; the runs' streams are `IDENTIFICATION_RATES`.
_SCREEN_RATES = {"SYS_STATUS": 1.0, "GPS_RAW_INT": 2.0, "EKF_STATUS_REPORT": 2.0}
_FETCHING_RATE = 5.0  # Hz of the streams while a log has the line for itself
_TELLING = (  # parameters from which a screen knows which output steers and which channel triggers
    *(f"SERVO{n}_FUNCTION" for n in range(1, 17)),
    *(f"RC{n}_OPTION" for n in range(1, 17)),
    *(p.name for p in PARAMETERS),
)

THROTTLE_KEPT = "keep: fetch the rover's log (6, L); from it 7 identifies the speed"


class VehicleWork:
    """The requests, on one vehicle and into one session's folder. Nothing here waits without pumping."""

    def __init__(self, session: Session, background: Background) -> None:
        self.session, self._background = session, background
        self._checks: dict[str, Check] = {}

    def greet(self, link: Link) -> Iterator[Update]:
        """Identify the vehicle, disarm it if the last run left it armed, and start the streams."""
        vehicle = identify_vehicle(link)
        self.session.on(asdict(vehicle))
        yield from disarm_left_armed(link, self.session.content)
        yield Connected(link.url, vehicle)
        if warning := untested(vehicle):
            yield Notice("warning", warning)
        read_present(link, _TELLING)
        self._remember_logs(link)
        yield from self._streams(link)

    def preflight(self, link: Link) -> Iterator[Update]:
        """Run all checks."""
        tops = [m.w_max for run in self.session.to_drive if isinstance(m := run.manoeuvre, Sweep | Multisine)]
        checks = preflight(link, self.session.folder, max(tops, default=None))
        self._checks = {check.name: check for check in checks}
        yield Checked(checks)

    def fix(self, link: Link, request: Fix) -> Iterator[Update]:
        """Carry out the remedy of the check of that name."""
        check = self._checks.get(request.name)
        if check is None or check.remedy is None:
            raise UsageError(f"there is no remedy for {request.name!r}; run the checks again first")
        rebooted = False
        for event in remedy(link, check, request.reboot, self.session.folder):
            rebooted |= isinstance(event, Rebooting)
            yield event
        if rebooted:
            yield Notice("info", "the rover has rebooted")
            yield from self._streams(link)

    def drive(self, link: Link, request: DriveRequest) -> Iterator[Update]:
        """Drive one run and judge it."""
        planned, settings = request.planned, request.settings
        try:
            refuse_impossible(link, (planned,), settings)
        except AppletUnready as error:
            raise LinkError(f"{error.found}: press 2, choose applet, then F") from error
        except UsageError as error:
            raise UsageError(f"{error}: press 3, then E to change the run") from error
        self._remember_logs(link)
        self.session.set(asdict(settings))
        yield from await_estimator(link)
        try:
            ended = yield from recorded_run(link, planned, self.session, settings)
        finally:
            link.record_to(self.session.between())
        tlog = self.session.folder / self.session.content.runs[-1].tlog
        if ended is not None and ended.completed:
            if planned.manoeuvre.kind == "throttle":
                self._background.tell(Verdict(planned.name, "keep", THROTTLE_KEPT, source=tlog))
            else:
                self._background.judge(tlog, ended.span, planned.name, self.session.vehicle_file)
            return
        reason, throttle = "aborted" if ended is None else ended.reason, settings.throttle_us
        neutral = _neutral(link) if throttle is not None and too_fast(reason) else None
        self._background.tell(stopped_verdict(planned, reason, tlog, throttle, neutral))
        if ended is None:
            raise Aborted

    def fetch(self, link: Link) -> Iterator[Update]:
        """Fetch the new logs."""
        logs = MavlinkLogs(link)
        if self.session.content.logs_before is None:
            yield Notice("warning", "it is unknown which logs are new, so the last one is fetched")
            self.session.logs_before(listed(logs.logs()[:-1]))
        link.record_to(self.session.tlog("fetch"))
        try:
            request_all(link, self._loop_rate(link), dict.fromkeys(IDENTIFICATION_RATES, _FETCHING_RATE))
            for event in fetch_new_logs(logs, self.session):
                yield event
                if isinstance(event, LogSaved):
                    self._look_into(link, event.path)
        finally:
            link.record_to(self.session.between())
            with contextlib.suppress(LinkError):  # the next wait on the link raises it again
                request_all(link, self._loop_rate(link))

    def _look_into(self, link: Link, log: Path) -> None:
        """Find which runs a log holds, in the background, while the link is pumped."""
        looking = self._background.work(partial(note_runs, self.session, log.name))
        while not looking.done():
            link.receive(0.05)
        looking.result()

    def _remember_logs(self, link: Link) -> None:
        """Store which logs are older than the session; an armed rover does not list its logs."""
        if self.session.content.logs_before is None and not link.armed:
            with contextlib.suppress(LinkError):  # no card in it, which the preflight reports
                self.session.logs_before(listed(MavlinkLogs(link).logs()))

    def _streams(self, link: Link) -> Iterator[Update]:
        request_all(link, self._loop_rate(link), _SCREEN_RATES)
        yield from start_streams(link)

    def _loop_rate(self, link: Link) -> float:
        return read_parameter(link, "SCHED_LOOP_RATE")


def _neutral(link: Link) -> int | None:
    """The trim of the throttle [us], None if the rover does not report it."""
    with contextlib.suppress(LinkError):
        return find_channels(link).throttle_trim
    return None


_EVERY = 0.1  # s between two snapshots
_IDLE = 0.05  # s that an idle turn waits for the vehicle or for a request
_TRY_FOR, _TRY_EVERY = 3.0, 0.5  # s to find a vehicle that was lost, and between two tries
_GOODBYE = 15.0  # s for letting the rover go when the source is closed


class VehicleSource:
    """See `live.source.Source`. session: the folder, where the plan is put (`session.plan`) and read.

    folder: of a new session, or of one to continue. vehicle_file: copied into it. line, access: see
    `Link.open`; the screen gets the notices, and `Several` asks it for a system id. UsageError if the folder
    cannot be used.
    """

    def __init__(
        self,
        folder: Path,
        vehicle_file: Path | None = None,
        line: Line | None = None,
        access: Access | None = None,
    ) -> None:
        self.session = Session.open(folder)
        if vehicle_file is not None:
            self.session.keep_vehicle_file(vehicle_file)
        self._line = line
        self._access = replace(access or Access(), choose=None, tell=self._notice)
        self._requests: SimpleQueue[Request] = SimpleQueue()
        self._forgotten: SimpleQueue[Request] = SimpleQueue()
        self._stop, self._closing = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work_on, name="vehicle", daemon=True)
        self._tell_screen: Callable[[Update], None] = lambda update: None
        self._link: Link | None = None
        self._url, self._system = "", self._access.system  # of the vehicle that is to be found again
        self._lost = self._stopping = False
        self._left_armed, self._unreleased = False, ""  # by the last run
        self._telemetry, self._told_at = Telemetry(), 0.0

    def start(self, tell: Callable[[Update], None]) -> None:
        """Begin to work; `tell` is called in the source's own thread."""
        self._tell_screen = tell
        self._thread.start()

    def ask(self, request: Request) -> None:
        """Queue a request; returns at once."""
        self._requests.put(request)

    def abort(self) -> None:
        """End the run, release the rover, drop pending requests. From any thread."""
        while (request := self._next(0.0)) is not None:
            self._forgotten.put(request)
        self._stop.set()

    def close(self) -> str:
        """As `abort`, and end. Returns a sentence on what is not known to be released, '' if all is."""
        self._closing.set()
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(_GOODBYE)
        self.session.close()
        armed = self._left_armed or (self._link is not None and self._link.may_be_armed)
        return self._unreleased or (MAY_BE_ARMED if armed else "")

    # ---- the thread ------------------------------------------------------------------------------

    def _work_on(self) -> None:
        self._background = Background()
        self._work = VehicleWork(self.session, self._background)
        try:
            while not self._closing.is_set():
                try:
                    self._turn()
                except Aborted:
                    self._stopping = False  # nothing was under way; the next turn stops whatever moves
                except LinkError as lost:
                    self._has_lost(lost)
                except RoverSweepError as error:  # the disk is full
                    self._tell(Notice("warning", str(error)))
        finally:
            self._background.close()
            self._drop_link()

    def _turn(self) -> None:
        if self._stop.is_set():
            self._stop_all()
        self._tell_verdicts()
        request = self._next(0.0 if self._link else _IDLE)
        if request is not None:
            self._carry_out(request)
        elif self._lost:
            self._find_again()
        elif self._link is not None:
            self._link.receive(_IDLE)

    def _next(self, wait: float) -> Request | None:
        try:
            return self._requests.get(timeout=wait) if wait else self._requests.get_nowait()
        except Empty:
            return None

    def _carry_out(self, request: Request) -> None:
        self._tell(Began(request))
        failure = ""
        try:
            for update in self._doing(request):
                self._tell(update)
        except Aborted:
            self._tell_forgotten()
            failure = "aborted"
        except RoverSweepError as error:
            failure = "; ".join([str(error), *getattr(error, "__notes__", ())])
        except Exception as error:  # a mistake of ours must not leave a screen without a rover to stop
            failure = f"internal error of rover-sweep: {error!r}"
        if self._stopping:
            self._stopped()
        self._tell(Ended(request, failure))

    def _doing(self, request: Request) -> Iterator[Update]:
        if isinstance(request, Connect):
            self._lost = False  # another was chosen; where that one fails, none is looked for
            return self._connect(request.url, request.system or self._access.system)
        if self._link is None or self._lost:
            raise UsageError("no vehicle is connected")
        match request:
            case Preflight():
                return self._work.preflight(self._link)
            case Fix():
                return self._work.fix(self._link, request)
            case DriveRequest():
                return self._work.drive(self._link, request)
            case FetchLogs():
                return self._work.fetch(self._link)
        raise UsageError("a vehicle is driven, not played")

    # ---- the link --------------------------------------------------------------------------------

    def _connect(self, url: str, system: int | None, timeout: float = 15.0) -> Iterator[Update]:
        self._drop_link()
        self._telemetry = Telemetry()
        access = replace(self._access, system=system)
        try:
            opened = Link.open(url, self.session.between(), timeout, self._line, self._tick, access)
        except SeveralVehicles as several:
            yield Several(url, several.heard)
            many = f"{len(several.heard)} vehicles are heard on {url}"
            raise UsageError(f"{many}: choose one by ↑ and ↓, then ENTER") from several
        self._link, self._url, self._system = opened, url, opened.target[0]
        opened.hear(self._hear)
        try:
            yield from self._work.greet(opened)
        except UsageError:  # not the vehicle of this session
            self._drop_link()
            raise
        self._lost = False  # not before: greeting disarms what a run left armed, and an abort may cut it
        self._left_armed, self._unreleased = opened.armed and self._left_armed, ""

    def _find_again(self) -> None:
        try:
            for update in self._connect(self._url, self._system, _TRY_FOR):
                self._tell(update)
        except LinkError:
            self._drop_link()
            self._closing.wait(_TRY_EVERY)
        except RoverSweepError:  # the disk is full, or it is another vehicle: trying again does not help
            self._lost = False
            raise

    def _has_lost(self, why: LinkError) -> None:
        self._drop_link()
        self._lost = True
        self._tell(Lost(str(why)))

    def _drop_link(self) -> None:
        if self._link is not None:
            self._left_armed |= self._link.may_be_armed
            self._link.close()
            self._link = None

    def _hear(self, message: Message) -> None:
        if self._link is not None:
            self._telemetry.message(message, self._link.clock.now)

    def _tick(self) -> None:
        """Called during every wait on the link."""
        self._stop_if_asked()
        now = time.monotonic()
        if now - self._told_at < _EVERY or self._link is None:
            return
        self._told_at = now
        self._tell_verdicts()
        with contextlib.suppress(OSError):  # a folder that was taken away; the link tells
            recorded, link = self._link.tlog.stat().st_size, self._link.quality.words
            self._tell(self._telemetry.snapshot(recorded, link))

    # ---- stopping --------------------------------------------------------------------------------

    def _stop_if_asked(self) -> None:
        """Raise once only: another press must not interrupt the release of the rover."""
        if self._stop.is_set() and not self._stopping:
            self._stopping = True
            raise Aborted

    def _stopped(self) -> None:
        self._stop.clear()
        self._stopping = False

    def _stop_all(self) -> None:
        """While no run of ours is active: stop the applet (it may be in the pilot's run)."""
        self._stopping = True
        try:
            self._tell_forgotten()
            if self._link is not None and self._link.armed:
                for update in stop_and_disarm(self._link, disarm=False):
                    self._tell(update)
        finally:
            self._stopped()

    def _tell_forgotten(self) -> None:
        while not self._forgotten.empty():
            self._tell(Ended(self._forgotten.get(), "aborted before it began"))

    # ---- telling ---------------------------------------------------------------------------------

    def _tell_verdicts(self) -> None:
        for verdict in self._background.given():
            assert verdict.source is not None
            self.session.judged(verdict.source, asdict(verdict))
            self._tell(Judged(verdict))

    def _notice(self, sentence: str) -> None:
        self._tell(Notice("warning", sentence))

    def _tell(self, update: Update) -> None:
        if isinstance(update, RunStarted):
            self._left_armed, self._unreleased = False, ""
        elif isinstance(update, Interrupted):
            self._unreleased = update.unreleased
        with contextlib.suppress(Exception):  # a screen that fails must not keep a rover from being let go
            self._tell_screen(update)
