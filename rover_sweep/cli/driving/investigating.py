"""Show an investigation while it is driven, and write its documents."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.api.diagnosis_input import Material
    from rover_sweep.api.investigation import Bounds, Decision, RunDriver
    from rover_sweep.cli.driving.session_display import OneByOne
    from rover_sweep.cli.driving.simulated import SimulationOptions
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.diagnosis.result import Diagnosis
    from rover_sweep.session.simulated_rover import SimulatedRover

TITLES = {"drive": "next run", "settled": "settled", "used up": "ended", "open": "open"}


def show_investigation(
    driver: RunDriver, rover: tuple[Vehicle, Path], bounds: Bounds, out: Path, as_json: bool
) -> None:
    """Drive until the last decision; then print the diagnosis and write the report.

    investigation.json is written before each run. Ctrl-C releases the rover, writes the report on the runs so
    far, and raises KeyboardInterrupt.
    """
    from rover_sweep.api.investigation import investigation, steps_before, write_investigation

    earlier = steps_before(out)
    decisions: list[Decision] = []
    try:
        for decision in investigation(driver, rover[0], bounds, diagnosing(rover[0])):
            decisions.append(decision)
            write_investigation(out, decisions, earlier)
            show_step(decision)
    finally:
        _write_report(decisions, rover, out, as_json)
    show_document(decisions, out, as_json, earlier)


def show_document(
    decisions: list[Decision], out: Path | None, as_json: bool, earlier: tuple[Any, ...] = ()
) -> None:
    """The JSON with as_json, else the path of the document."""
    from rover_sweep.api.investigation import DOCUMENT, investigation_document
    from rover_sweep.cli.views.output import echo_json, results
    from rover_sweep.report.wording import strict_json

    if as_json:
        echo_json(strict_json(investigation_document(decisions, earlier)))
    elif out is not None:
        results().print(f"steps: {out / DOCUMENT}", soft_wrap=True)


def diagnosing(vehicle: Vehicle) -> Callable[[Material], Diagnosis]:
    """A diagnosis with its progress on stderr."""

    def diagnose(given: Material) -> Diagnosis:
        from rover_sweep.cli.driving.shown_results import diagnosis_of
        from rover_sweep.diagnosis.result import DiagnosisSettings

        names = ", ".join(run.name for run in (*given.runs, *given.held_out))
        return diagnosis_of(given, vehicle, DiagnosisSettings(), what=f"diagnosing {names}")

    return diagnose


def show_step(decision: Decision) -> None:
    """What the runs so far say, and the step with its reason."""
    from rover_sweep.cli.views.output import narration

    console, found = narration(), decision.diagnosis
    if found is not None:
        console.print(f"diagnosis: {found.verdict}: {found.sentence}", soft_wrap=True)
    if decision.told is not None:
        console.print(f"the last run told {decision.told:.1f} bit")
    step = decision.step
    console.print(f"{TITLES[step.action]}: {step.reason}", style="bold", soft_wrap=True)


def _write_report(decisions: list[Decision], rover: tuple[Vehicle, Path], out: Path, as_json: bool) -> None:
    """The report of the last diagnosis into report/, and its summary on the terminal."""
    from datetime import datetime

    from rover_sweep.cli.views.output import results
    from rover_sweep.diagnosis.result import DiagnosisSettings
    from rover_sweep.report.diagnosis.report import diagnosis_report, write_diagnosis
    from rover_sweep.report.on_terminal import WIDTH, on_terminal
    from rover_sweep.report.wording import provenance

    last = next((d for d in reversed(decisions) if d.diagnosis and d.given), None)
    if last is None or last.diagnosis is None or last.given is None:
        return
    command = " ".join(["rover-sweep", *sys.argv[1:]])
    made = provenance(*rover, last.given.held_out, command, datetime.now().astimezone())
    files = write_diagnosis(last.diagnosis, out / "report", last.given.origin(made, DiagnosisSettings()))
    shown = results(as_json)
    shown.print(on_terminal(diagnosis_report(last.diagnosis)), width=min(shown.width, WIDTH))
    shown.print(f"\nreport: {files.page}", soft_wrap=True)


# `investigate --vehicle embedded|ardurover`: an investigation of a simulated rover, without asking.


_LIMITS = {"gcs": 1.0, "v_min": 0.6, "v_max": 5.0}
SPEED = 2.5  # m/s at the throttle of a simulated rover


def investigate_simulated(
    simulator: str,
    bounds: Bounds,
    limits: dict[str, float],
    logs: bool,
    options: SimulationOptions,
    out: str | None,
    as_json: bool,
) -> None:
    """Start the simulated rover, install applet and parameters, and investigate it.

    UsageError for the firmware's own physics, which has no tyres and no roll.
    """
    from rover_sweep.cli.driving.simulated import folder_with_rover

    if options.physics == "own":
        raise UsageError("the firmware's own rover is kinematic: there is nothing to investigate")
    simulation = options.rover(simulator)
    folder, rover = folder_with_rover(out, "investigation", options.rover_file, options.variant)
    allowed = replace(bounds, speed=min(bounds.speed, SPEED), headings=False)
    with simulated_driver(simulation, folder, rover, limits, logs) as driver:
        show_investigation(driver, rover, allowed, folder, as_json)


@contextmanager
def simulated_driver(
    simulation: SimulatedRover,
    folder: Path,
    rover: tuple[Vehicle, Path],
    limits: dict[str, float],
    logs: bool,
) -> Iterator[OneByOne]:
    """A driver of a simulated rover, which runs inside the block. It does not ask."""
    from firmware_params.applet_parameters import applet_path
    from firmware_params.param_files import read, shipped
    from rover_sweep.cli.driving.session_display import OneByOne
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.session.simulated_rover import started
    from rover_sweep.vehicle.run.controls import RunSettings

    settings = RunSettings(True, simulation.throttle_us, "override", {"pwm_max": 250.0} | _LIMITS | limits)
    plan = SessionPlan((), settings, read(shipped("identification")), applet=applet_path(), logs=logs)
    with started(simulation, folder / "vehicle") as running:
        yield OneByOne(running.connection, folder, rover, plan, SPEED, None)
