"""Drives single runs into a session's folder for an investigation: each call one run, with its own yes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.data.recording import Recording
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.diagnosis.plans.plan_result import PlannedRun
    from rover_sweep.session.content import SessionRun
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.events import Event
    from rover_sweep.vehicle.link.access import Access
    from rover_sweep.vehicle.link.transport import Line
    from rover_sweep.vehicle.run.settings import RunSettings

THROTTLE_TRIM = 1500  # us, at which the motor stands still
Ask = Callable[["PlainDisplay", str], None]
"""Waits for a yes to the question; KeyboardInterrupt for a no."""


@dataclass(frozen=True, eq=False)
class OneByOne:
    """An `api.investigation.RunDriver` of the vehicle at `url`.

    rover: vehicle and its file. plan: settings and parameters; its throttle is that of the speed `fastest`
    [m/s]. ask: called once in each run, before anything is armed; None only for a simulated rover. least:
    share of the battery below which nothing is driven.
    """

    url: str
    folder: Path
    rover: tuple[Vehicle, Path]
    plan: SessionPlan
    fastest: float
    ask: Ask | None
    access: Access | None = None
    least: float = 0.0
    line: Callable[[], AbstractContextManager[Line | None]] = field(default=nullcontext)

    def recordings(self) -> tuple[Recording, ...]:
        """The complete runs in the folder."""
        from rover_sweep.api.read import Reading, load_steered
        from rover_sweep.session.folder import read_folder

        if not any(run.state == "done" for run in read_folder(self.folder).runs):
            return ()
        return load_steered([str(self.folder)], self.rover[0], Reading())

    def drive(self, run: PlannedRun) -> bool:
        """Ask, drive the run once and fetch its log; whether it came to its end.

        KeyboardInterrupt for a no, and for Ctrl-C, after the rover was released.
        """
        from rover_sweep.cli.driving.session_display import show_session
        from rover_sweep.session.session import drive

        planned = self._named(run)
        plan = replace(self.plan, runs=(*self._driven(), planned), settings=self._settings(run.speed))
        with self.line() as line:
            events = drive(self.url, self.folder, plan, line, self.rover[1], self.access)
            shown = show_session(
                events, self.folder, talk=True, answer=self._answer(run), logs=self.plan.logs
            )
        return any(ended.completed for ended in shown.runs)

    def spent(self) -> str:
        """The battery, where the last run reported less than `least`."""
        from rover_sweep.session.battery import battery_left
        from rover_sweep.session.folder import read_folder

        runs = read_folder(self.folder).runs
        left = battery_left(self.folder / runs[-1].tlog) if runs else None
        if left is None or left >= self.least:
            return ""
        return f"the battery has {100 * left:.0f} % left, less than {100 * self.least:.0f} %"

    def _named(self, run: PlannedRun) -> SessionRun:
        """The run under a name that the folder does not have yet."""
        from rover_sweep.diagnosis.plans.proposals import manoeuvre_for
        from rover_sweep.session.content import SessionRun
        from rover_sweep.session.folder import read_folder

        kind, number = run.kind.replace("_", "-"), 1
        taken = {driven.name for driven in read_folder(self.folder).runs}
        while f"{kind}{number}" in taken:
            number += 1
        return SessionRun(f"{kind}{number}", manoeuvre_for(run), run.speed)

    def _driven(self) -> tuple[SessionRun, ...]:
        """The complete runs of the plan; one that was not completed is driven again only if chosen."""
        from rover_sweep.session.folder import read_folder

        content = read_folder(self.folder)
        left = content.to_drive
        return tuple(run for run in content.plan if run not in left)

    def _settings(self, speed: float) -> RunSettings:
        settings = self.plan.settings
        if settings.throttle_us is None:
            return settings
        share = min(speed / self.fastest, 1.0)
        return replace(
            settings, throttle_us=round(THROTTLE_TRIM + share * (settings.throttle_us - THROTTLE_TRIM))
        )

    def _answer(self, run: PlannedRun) -> Callable[[PlainDisplay, Event], None]:
        """Asks when the run is about to start; there is one run in the plan, so one question and one yes."""
        from rover_sweep.vehicle.events import RunStarted

        def answer(display: PlainDisplay, event: Event) -> None:
            if isinstance(event, RunStarted) and self.ask is not None:
                self.ask(display, question(event.name, run, self.plan.settings))

        return answer


def question(name: str, run: PlannedRun, settings: RunSettings) -> str:
    """What moves, and what the person has to do."""
    heading = "" if run.heading is None else f", starting towards {run.heading:.0f} deg from north"
    speed = f"{run.speed:g} m/s{heading}"
    does = [f"{name} arms the rover"] if settings.arm else []
    does += [f"holds {speed}"] if settings.throttle_us is not None else []
    words = " and ".join(does) or f"{name} is driven by you"
    holds = "" if settings.throttle_us is not None else f", hold {speed}"
    return f"{words}{holds}: is the area clear? y starts the run, Ctrl-C stops"
