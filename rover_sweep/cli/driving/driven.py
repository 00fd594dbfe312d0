"""Drive a session on a real or a simulated rover, and identify from it: `run`, `dry-run` and `resume`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from itertools import takewhile
from pathlib import Path

from firmware_params.param_files import read, shipped
from rover_sweep.api.diagnosis_input import material
from rover_sweep.cli.driving.session_display import complete_runs, identify_session, show_session
from rover_sweep.cli.driving.shown_results import Rover, show_diagnosed
from rover_sweep.cli.driving.simulated import folder_with_rover, truth_table
from rover_sweep.cli.driving_options import Permissions, RunCall, SimulationOptions
from rover_sweep.cli.options import session_folder, vehicle_path
from rover_sweep.cli.views.display import PlainDisplay
from rover_sweep.cli.views.output import identify_command, narration
from rover_sweep.data.vehicle_file import load
from rover_sweep.diagnosis.result import DiagnosisSettings
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import numbered
from rover_sweep.manoeuvre.sweep import parameters_of
from rover_sweep.session.content import SessionRun
from rover_sweep.session.folder import DESCRIPTION, read_folder
from rover_sweep.session.session import SessionPlan, drive
from rover_sweep.session.simulated_rover import (
    Physics,
    SimulatedRover,
    Simulator,
    simulated_plan,
    simulated_session,
)
from rover_sweep.vehicle.events import Event, RunStarted, SessionFinished
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
from rover_sweep.vehicle.link.transport import parse_url

_SWITCHING = {"override": "throws the switch", "aux": "throws the switch by command"}


def run_and_identify(call: RunCall, name: str) -> None:
    """Drive, identify, and diagnose on request. name: of the new folder, if none is given."""
    runs, more = call.manoeuvres.runs, None
    if call.simulation.simulator:
        session, rover = _on_simulated(call, runs, name)
        more = partial(truth_table, call.simulation.variant) if call.physics == "plant" else None
    else:
        refuse_without_simulation(call.connect, call.simulation, call.physics)
        session, rover = on_rover(
            None, runs, call.connect or "", call.access, call.vehicle, call.allowed, not call.no_log, call.out
        )
    identify_session(session, rover, call.as_json, call.full, more)
    if call.diagnose and any(run.manoeuvre.kind != "throttle" for run in runs):
        given = material(complete_runs(session, rover[0]), ())
        show_diagnosed(given, rover, DiagnosisSettings(), session.folder / "report", False)


def on_rover(
    resumed: Path | None,
    runs: tuple[SessionRun, ...],
    connect: str,
    access: Access,
    vehicle_file: str | None,
    allowed: Permissions,
    logs: bool,
    out: str | None = None,
) -> tuple[SessionFinished, Rover]:
    """The session on the rover at `connect`; checks before the drive all that could fail after it.

    resumed: folder of a session whose remaining runs are driven, with its limits; else `runs` are driven.
    """
    rover = known_rover(vehicle_file, (str(resumed),) if resumed else ())
    parse_url(connect)
    kept: Mapping[str, float] = {}
    if resumed is not None:
        content = read_folder(resumed)
        if not content.to_drive:
            raise UsageError(
                f"no runs remain in {resumed}; identify models with: {identify_command(resumed)}"
            )
        runs, kept = content.plan, content.settings.get("extra", {})
    plan = rover_plan(runs, allowed, logs, kept)
    folder = resumed or _folder_for(out)
    announce(plan, folder)

    def answer(display: PlainDisplay, event: Event) -> None:
        """Ask before each run if this program arms the rover and stdin is a terminal."""
        if isinstance(event, RunStarted) and plan.settings.arm and sys.stdin.isatty():
            display.ask(f"{event.name} arms the rover: is the area clear? y starts the run, Ctrl-C stops")

    with RecordedLine(conversation_in(folder)) as line:
        events = drive(connect, folder, plan, line, rover[1], access)
        return show_session(events, folder, talk=True, go_on=True, answer=answer, logs=logs), rover


def known_rover(vehicle_file: str | None, runs: tuple[str, ...] = ()) -> Rover:
    """(vehicle, its file), with the steering; see `vehicle_path`."""
    path = Path(vehicle_path(vehicle_file, runs))
    vehicle = load(path)
    vehicle.steering()
    return vehicle, path


def rover_plan(
    runs: tuple[SessionRun, ...], allowed: Permissions, logs: bool, kept: Mapping[str, float] | None = None
) -> SessionPlan:
    """The plan on a real rover, whose parameters are only compared. kept: as in `Permissions.settings`."""
    settings = allowed.settings(kept)
    for planned in runs:
        parameters_of(planned.manoeuvre, **settings.extra)
    return SessionPlan(runs, settings, checked=read(shipped("identification")), logs=logs)


def _folder_for(out: str | None) -> Path:
    """As `session_folder` (`out`, else run, run-2, ...), but reuses a session without any run or log, as
    after a wrong port or on a rover without the applet."""
    for folder in [Path(out)] if out else takewhile(Path.exists, numbered(Path("run"))):
        if (folder / DESCRIPTION).is_file() and not (folder / "report").exists():
            content = read_folder(folder)
            if not content.runs and not content.logs:
                return folder
    return session_folder(out, "run")


def announce(plan: SessionPlan, folder: Path) -> None:
    """Print, before connecting, what this program and what the pilot will move."""
    throttle, trigger = plan.settings.throttle_us, plan.settings.trigger
    own = ["arms the rover"] if plan.settings.arm else []
    own += [f"drives with throttle {throttle} us"] if throttle is not None else []
    own += [_SWITCHING[trigger]] if trigger in _SWITCHING else []
    words = f"this program {', '.join(own)}" if own else "the pilot arms, drives and throws the switch"
    seconds = sum(planned.manoeuvre.duration for planned in plan.runs)
    swept = {planned.manoeuvre.kind == "throttle" for planned in plan.runs}
    what = " and ".join(name for name, is_it in (("steering", False), ("throttle", True)) if is_it in swept)
    narration().print(
        f"{len(plan.runs)} runs, {seconds:.0f} s of {what} in total, into {folder}; {words}", soft_wrap=True
    )


def _on_simulated(call: RunCall, runs: tuple[SessionRun, ...], name: str) -> tuple[SessionFinished, Rover]:
    refuse_on_simulated(call.connect, call.allowed)
    simulation = factory_rover(call.simulation, call.physics)
    trigger, limits = call.allowed.throw_switch or "override", dict(call.allowed.limit)
    plan = simulated_plan(runs, simulation, trigger, limits, not call.no_log)
    variant = call.simulation.variant if call.physics == "plant" else None
    folder, rover = folder_with_rover(call.out, name, call.vehicle, variant)
    announce(plan, folder)
    with simulated_session(simulation, plan, folder) as (events, follow):
        session = show_session(events, folder, answer=lambda _, event: follow(event), logs=not call.no_log)
    return session, rover


def factory_rover(options: SimulationOptions, physics: Physics) -> SimulatedRover:
    """The rover to start, with factory settings."""
    kind: Simulator = "ardurover" if options.simulator == "ardurover" else "embedded"
    return SimulatedRover(kind, options.binary, physics, options.variant, options.seed, prepared=False)


def refuse_on_simulated(connect: str | None, allowed: Permissions) -> None:
    """UsageError for options that only make sense with an existing rover."""
    if connect:
        raise UsageError("--simulator starts its own rover; remove --connect")
    if allowed.arm or allowed.throttle is not None:
        raise UsageError("a simulated rover is always armed and driven; remove --arm and --throttle")


def refuse_without_simulation(connect: str | None, options: SimulationOptions, physics: Physics) -> None:
    """UsageError for options of a simulated rover without one, and for no rover at all."""
    if not connect:
        raise UsageError("no rover: give --connect URL, or --simulator embedded or ardurover")
    given = {"physics": physics, "variant": options.variant, "seed": options.seed}
    usual = {"physics": "plant", "variant": "nominal", "seed": 1}
    for name, value in (given | {"ardurover": options.ardurover}).items():
        if value != usual.get(name):
            raise UsageError(f"--{name} is for --simulator embedded or ardurover")
