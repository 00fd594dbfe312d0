"""Carries out the requests on a vehicle's link, as generators of updates."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path

from firmware_params.applet_parameters import PARAMETERS
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.live.snapshot import Verdict
from rover_sweep.live.source import Checked, DriveRequest, Fix, Update
from rover_sweep.live.vehicle.background import Background
from rover_sweep.live.vehicle.stop import Aborted
from rover_sweep.live.verdict.stopped import stopped_verdict, too_fast
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.folder import Session
from rover_sweep.session.left_armed import disarm_left_armed
from rover_sweep.session.session import (
    await_estimator,
    fetch_new_logs,
    listed,
    note_runs,
    recorded_run,
    refuse_impossible,
    start_streams,
)
from rover_sweep.vehicle.events import Connected, LogSaved, Notice, Rebooting
from rover_sweep.vehicle.identity import identify_vehicle, untested
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.streams import IDENTIFICATION_RATES, request_all
from rover_sweep.vehicle.logs.download import MavlinkLogs
from rover_sweep.vehicle.parameters.read_write import read_parameter, read_present
from rover_sweep.vehicle.preflight.all_checks import preflight, remedy
from rover_sweep.vehicle.preflight.item import Check
from rover_sweep.vehicle.run.controls import find_channels

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
            yield from self._streams(link)

    def drive(self, link: Link, request: DriveRequest) -> Iterator[Update]:
        """One run, and the verdict on it."""
        planned, settings = request.planned, request.settings
        refuse_impossible(link, (planned,), settings)
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
                self._background.tell(tlog, Verdict(planned.name, "keep", THROTTLE_KEPT, source=tlog))
            else:
                self._background.judge(tlog, ended.span, planned.name, self.session.vehicle_file)
            return
        reason, throttle = "aborted" if ended is None else ended.reason, settings.throttle_us
        neutral = _neutral(link) if throttle is not None and too_fast(reason) else None
        self._background.tell(tlog, stopped_verdict(planned, reason, tlog, throttle, neutral))
        if ended is None:
            raise Aborted

    def fetch(self, link: Link) -> Iterator[Update]:
        """The logs that are new."""
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
    """The trim of the throttle [us], None if the rover no longer tells it."""
    with contextlib.suppress(LinkError):
        return find_channels(link).throttle_trim
    return None
