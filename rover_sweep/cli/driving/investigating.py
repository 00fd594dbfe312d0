"""An investigation: drive it on a real or simulated rover, show it meanwhile, and write its documents."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rover_sweep.api.diagnosis_input import Material
from rover_sweep.api.investigation import (
    DOCUMENT,
    Bounds,
    Decision,
    RunDriver,
    decided,
    investigation,
    investigation_document,
    steps_before,
    write_investigation,
)
from rover_sweep.api.read import Reading, load_steered
from rover_sweep.cli.driving.driven import factory_rover, known_rover, rover_plan
from rover_sweep.cli.driving.session_display import show_session
from rover_sweep.cli.driving.shown_results import Rover, diagnosis_of, made_now
from rover_sweep.cli.driving.simulated import folder_with_rover
from rover_sweep.cli.driving_options import Permissions, SimulationOptions
from rover_sweep.cli.options import check_writable, session_folder
from rover_sweep.cli.views.display import PlainDisplay
from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.diagnosis.plans.planner import PlannedRun, manoeuvre_for
from rover_sweep.diagnosis.result import Diagnosis, DiagnosisSettings
from rover_sweep.errors import UsageError
from rover_sweep.report.diagnosis.report import diagnosis_report, write_diagnosis
from rover_sweep.report.on_terminal import WIDTH, on_terminal
from rover_sweep.report.wording import strict_json
from rover_sweep.session.content import SessionRun
from rover_sweep.session.folder import is_session, read_folder
from rover_sweep.session.session import SessionPlan, battery_left, drive
from rover_sweep.session.simulated_rover import Physics, SimulatedRover, simulated_plan, started
from rover_sweep.vehicle.events import Event, RunStarted
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
from rover_sweep.vehicle.link.transport import Line, parse_url
from rover_sweep.vehicle.run.controls import RunSettings

TITLES = {"drive": "next run", "settled": "settled", "used up": "ended", "open": "open"}


def show_investigation(driver: RunDriver, rover: Rover, bounds: Bounds, out: Path, as_json: bool) -> None:
    """Drive until the last decision; then print the diagnosis and write the report.

    investigation.json is written before each run. Ctrl-C releases the rover, writes the report on the runs so
    far, and raises KeyboardInterrupt.
    """
    earlier = steps_before(out)
    decisions: list[Decision] = []
    try:
        for decision in investigation(driver, rover[0], bounds, diagnosing(rover[0])):
            decisions.append(decision)
            write_investigation(out, decisions, earlier)
            show_step(decision)
    finally:
        last = next((d for d in reversed(decisions) if d.diagnosis and d.given), None)
        if last and last.diagnosis and last.given:
            origin = last.given.origin(made_now(rover, last.given.held_out), DiagnosisSettings())
            files = write_diagnosis(last.diagnosis, out / "report", origin)
            shown = results(as_json)
            shown.print(on_terminal(diagnosis_report(last.diagnosis)), width=min(shown.width, WIDTH))
            shown.print(f"\nreport: {files.page}", soft_wrap=True)
    show_document(decisions, out, as_json, earlier)


def show_document(
    decisions: list[Decision], out: Path | None, as_json: bool, earlier: tuple[Any, ...] = ()
) -> None:
    """The JSON with as_json, else the path of the document."""
    if as_json:
        echo_json(strict_json(investigation_document(decisions, earlier)))
    elif out is not None:
        results().print(f"steps: {out / DOCUMENT}", soft_wrap=True)


def diagnosing(vehicle: Vehicle) -> Callable[[Material], Diagnosis]:
    """A diagnosis with its progress on stderr."""

    def diagnose(given: Material) -> Diagnosis:
        names = ", ".join(run.name for run in (*given.runs, *given.held_out))
        return diagnosis_of(given, vehicle, DiagnosisSettings(), what=f"diagnosing {names}")

    return diagnose


def show_step(decision: Decision) -> None:
    """Show the findings so far and the step with its reason."""
    console, found = narration(), decision.diagnosis
    if found is not None:
        console.print(f"diagnosis: {found.verdict}: {found.sentence}", soft_wrap=True)
    if decision.told is not None:
        console.print(f"the last run gave {decision.told:.1f} bit of information")
    step = decision.step
    console.print(f"{TITLES[step.action]}: {step.reason}", style="bold", soft_wrap=True)


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
    rover: Rover
    plan: SessionPlan
    fastest: float
    ask: Ask | None
    access: Access | None = None
    least: float = 0.0
    line: Callable[[], AbstractContextManager[Line | None]] = field(default=nullcontext)

    def recordings(self) -> tuple[Recording, ...]:
        """The complete runs in the folder."""
        if not any(run.state == "done" for run in read_folder(self.folder).runs):
            return ()
        return load_steered([str(self.folder)], self.rover[0], Reading())

    def drive(self, run: PlannedRun) -> bool:
        """Ask, drive the run once and fetch its log. True if it was completed.

        KeyboardInterrupt for a no, and for Ctrl-C, after the rover was released.
        """
        content, kind, number = read_folder(self.folder), run.kind.replace("_", "-"), 1
        while f"{kind}{number}" in {driven.name for driven in content.runs}:
            number += 1
        planned = SessionRun(f"{kind}{number}", manoeuvre_for(run), run.speed)
        # One that was not completed is driven again only if it is chosen.
        driven = tuple(before for before in content.plan if before not in content.to_drive)
        settings = self.plan.settings
        if settings.throttle_us is not None:
            share = min(run.speed / self.fastest, 1.0)
            throttle = round(THROTTLE_TRIM + share * (settings.throttle_us - THROTTLE_TRIM))
            settings = replace(settings, throttle_us=throttle)

        def answer(display: PlainDisplay, event: Event) -> None:
            """Ask when the run is about to start: there is one run to drive, so one question and one yes."""
            if isinstance(event, RunStarted) and self.ask is not None:
                self.ask(display, question(event.name, run, self.plan.settings))

        plan = replace(self.plan, runs=(*driven, planned), settings=settings)
        with self.line() as line:
            events = drive(self.url, self.folder, plan, line, self.rover[1], self.access)
            shown = show_session(events, self.folder, talk=True, answer=answer, logs=self.plan.logs)
        return any(ended.completed for ended in shown.runs)

    def spent(self) -> str:
        """A sentence if the last run left the battery below `least`."""
        runs = read_folder(self.folder).runs
        left = battery_left(self.folder / runs[-1].tlog) if runs else None
        if left is None or left >= self.least:
            return ""
        return f"the battery has {100 * left:.0f} % left, less than {100 * self.least:.0f} %"


def question(name: str, run: PlannedRun, settings: RunSettings) -> str:
    """The question: what moves, what the person must do."""
    heading = "" if run.heading is None else f", starting towards {run.heading:.0f} deg from north"
    speed = f"{run.speed:g} m/s{heading}"
    does = [f"{name} arms the rover"] if settings.arm else []
    does += [f"holds {speed}"] if settings.throttle_us is not None else []
    words = " and ".join(does) or f"{name} is driven by you"
    holds = "" if settings.throttle_us is not None else f", hold {speed}"
    return f"{words}{holds}: is the area clear? y starts the run, Ctrl-C stops"


_V_MIN = 0.6  # m/s, of the applet on a simulated rover
SPEED = 2.5  # m/s at the throttle of a simulated rover


def investigate_rover(
    connect: str,
    access: Access,
    vehicle_file: str | None,
    bounds: Bounds,
    allowed: Permissions,
    least: float,
    logs: bool,
    out: str | None,
    as_json: bool,
) -> None:
    """Investigate the rover at `connect`; checks before the drive all that could fail after it."""
    if not sys.stdin.isatty():
        raise UsageError("investigate asks before each run, so it needs a terminal; start it in one")
    rover = known_rover(vehicle_file, (out,) if out else ())
    parse_url(connect)
    plan = rover_plan((), allowed, logs)
    continued = out is not None and is_session(Path(out))
    folder = Path(out or "") if continued else session_folder(out, "investigation")
    steps_before(folder)
    driver = OneByOne(
        connect,
        folder,
        rover,
        plan,
        bounds.speed,
        PlainDisplay.ask,
        access,
        least,
        lambda: RecordedLine(conversation_in(folder)),
    )
    show_investigation(driver, rover, bounds, folder, as_json)


def investigate_simulated(
    options: SimulationOptions,
    physics: Physics,
    vehicle_file: str | None,
    bounds: Bounds,
    limits: Mapping[str, float],
    logs: bool,
    out: str | None,
    as_json: bool,
) -> None:
    """Start the simulated rover, install applet and parameters, and investigate it without asking.

    UsageError for the firmware's own physics, which has no tyres and no roll.
    """
    if physics == "own":
        raise UsageError("the firmware's own rover is kinematic: there is nothing to investigate")
    simulation = factory_rover(options, physics)
    folder, rover = folder_with_rover(out, "investigation", vehicle_file, options.variant)
    bounds = replace(bounds, speed=min(bounds.speed, SPEED), headings=False)
    with simulated_driver(simulation, folder, rover, limits, logs) as driver:
        show_investigation(driver, rover, bounds, folder, as_json)


@contextmanager
def simulated_driver(
    simulation: SimulatedRover, folder: Path, rover: Rover, limits: Mapping[str, float], logs: bool
) -> Iterator[OneByOne]:
    """A driver of a simulated rover, which runs inside the block. It does not ask."""
    plan = simulated_plan((), simulation, limits={"v_min": _V_MIN, **limits}, logs=logs)
    with started(simulation, folder / "vehicle") as running:
        yield OneByOne(running.connection, folder, rover, plan, SPEED, None)


def show_next_step(
    runs: tuple[str, ...], vehicle_file: str | None, bounds: Bounds, out: str | None, as_json: bool
) -> None:
    """Show the next step after recorded runs."""
    rover, _ = known_rover(vehicle_file, runs)
    folder = None if out is None else Path(out)
    if folder is not None:
        check_writable(folder)
    earlier = steps_before(folder) if folder else ()
    driven = load_steered(runs, rover, Reading())
    print_warnings(narration(), driven)
    decision = decided(driven, rover, bounds, "", diagnosing(rover))
    show_step(decision)
    if folder is not None:
        write_investigation(folder, [decision], earlier)
    show_document([decision], folder, as_json, earlier)
