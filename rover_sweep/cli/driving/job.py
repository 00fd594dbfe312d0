"""Steps of `run` for real and simulated rovers: choose the folder, announce the plan, diagnose."""

from __future__ import annotations

import ipaddress
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

from rover_sweep.cli.views.output import narration
from rover_sweep.errors import LinkError, UsageError, missing_extra

if TYPE_CHECKING:
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.session.session import SessionPlan, SessionRun
    from rover_sweep.vehicle.events import SessionFinished
    from rover_sweep.vehicle.run.controls import Trigger

_SWITCHING = {"override": "throws the switch", "aux": "throws the switch by command"}


@dataclass(frozen=True)
class Job:
    """The runs to drive. limits: of the applet; trigger: who throws the switch, None for the default of the
    rover's kind; logs: download the rover's log."""

    runs: tuple[SessionRun, ...]
    limits: dict[str, float]
    trigger: Trigger | None
    logs: bool


def folder_for(out: str | None) -> Path:
    """As `session_folder` (`out`, else run, run-2, ...), but reuses a session without any run or log, as
    after a wrong port or on a rover without the applet."""
    from rover_sweep.cli.options import session_folder
    from rover_sweep.files.replaced import numbered

    existing = [Path(out)] if out else list(takewhile(Path.exists, numbered(Path("run"))))
    return next((f for f in existing if _nothing_driven(f)), None) or session_folder(out, "run")


def _nothing_driven(folder: Path) -> bool:
    from rover_sweep.session.folder import DESCRIPTION, read_folder

    if not (folder / DESCRIPTION).is_file() or (folder / "report").exists():
        return False
    content = read_folder(folder)
    return not content.runs and not content.logs


def announce(plan: SessionPlan, folder: Path) -> None:
    """Print, before connecting, what this program and what the pilot will move."""
    from rover_sweep.cli.views.output import narration

    throttle, trigger = plan.settings.throttle_us, plan.settings.trigger
    own = ["arms the rover"] if plan.settings.arm else []
    own += [f"drives with throttle {throttle} us"] if throttle is not None else []
    own += [_SWITCHING[trigger]] if trigger in _SWITCHING else []
    words = f"this program {', '.join(own)}" if own else "the pilot arms, drives and throws the switch"
    seconds = sum(planned.manoeuvre.duration for planned in plan.runs)
    swept = {planned.manoeuvre.kind == "throttle" for planned in plan.runs}
    what = " and ".join(name for name, is_it in (("steering", False), ("throttle", True)) if is_it in swept)
    console = narration()
    console.print(
        f"{len(plan.runs)} runs, {seconds:.0f} s of {what} in total, into {folder}; {words}", soft_wrap=True
    )


def diagnose_session(session: SessionFinished, rover: tuple[Vehicle, Path]) -> None:
    """Diagnose a session's runs into its report/; doublets are held out."""
    from rover_sweep.api.diagnosis_input import material
    from rover_sweep.cli.driving.session_display import complete_runs
    from rover_sweep.cli.driving.shown_results import show_diagnosed
    from rover_sweep.diagnosis.result import DiagnosisSettings

    given = material(complete_runs(session, rover[0]), ())
    show_diagnosed(given, rover, DiagnosisSettings(), session.folder / "report", False)


# Serve a simulated rover to the official firmware until Ctrl-C: for `twin serve`.


def serve_twin(place: Path, ardurover: Path | None, physics: bool, instance: int, seed: int) -> None:
    """Start the firmware with the variant as its physics, or the physics alone; wait for Ctrl-C."""
    from sitl.plant.variant import load_variant

    variant = place / "variant.toml" if place.is_dir() else place
    if not variant.is_file():
        raise UsageError(f"{place} has no variant.toml; give the folder that `rover-sweep twin` wrote")
    try:
        load_variant(variant.resolve())
    except ValueError as error:
        raise UsageError(str(error)) from error
    if physics:
        _serve_physics(variant, instance, seed)
    else:
        _serve_firmware(variant, ardurover, instance, seed)


def _serve_physics(variant: Path, instance: int, seed: int) -> None:
    from rover_sweep.cli.views.output import narration
    from sitl.json_server import main

    narration().print(
        f"start the firmware with `ardurover --model JSON:127.0.0.1 --instance {instance}`; Ctrl-C ends this",
        soft_wrap=True,
    )
    main(["--variant", str(variant.resolve()), "--instance", str(instance), "--seed", str(seed)])


def _serve_firmware(variant: Path, ardurover: Path | None, instance: int, seed: int) -> None:
    from firmware_params.param_files import shipped
    from rover_sweep.cli.views.output import narration, results
    from sitl import launcher

    home = variant.parent / "served"
    try:
        running = launcher.start_ardurover(
            launcher.find_ardurover(ardurover),
            home,
            variant=variant.resolve(),
            seed=seed,
            instance=instance,
            defaults=[shipped("identification")],
        )
    except launcher.LaunchError as error:
        raise LinkError(f"{error}; --physics serves the JSON interface alone") from error
    with running:
        results().print(running.connection)
        narration().print(
            f"the twin is served: connect a ground station to {running.connection}; its logs are in {home}; "
            "Ctrl-C ends it",
            soft_wrap=True,
        )
        _wait(running)


def _wait(running: object) -> None:
    """Until Ctrl-C. LinkError where the firmware or its physics ends by itself."""
    try:
        while not (words := running.last_words()):  # type: ignore[attr-defined]
            time.sleep(1.0)
    except KeyboardInterrupt:
        return
    raise LinkError(f"the simulated rover ended by itself: {words}")


# `session --web`: the server, and the command of the program behind its page.


OPEN = "warning: whoever reaches {host} can drive the rover from this page; there is no password"
ALL = ("0.0.0.0", "::", "")


def serve(host: str, port: int) -> None:
    """Serve the session of this command line until Ctrl-C; UsageError where that is not possible."""
    if os.name == "nt":
        raise UsageError("the session in a browser needs Linux or macOS; use `rover-sweep session` here")
    try:
        from rover_sweep.tui.session_server import SessionServer
    except ImportError:
        raise missing_extra("the session in a browser needs textual-serve", "web") from None
    if host in ALL:
        raise UsageError(
            f"--web-host {host!r} is no single address; give the one of this computer in the network of the "
            "browser, as in --web-host 192.168.1.20"
        )
    if not _is_loopback(host):
        narration().print(OPEN.format(host=host), style="yellow", soft_wrap=True)
    try:
        SessionServer(program(sys.argv[1:]), host, port).serve()
    except OSError as error:  # the port is taken, or the address is not one of this computer
        raise UsageError(
            f"cannot serve at {host} port {port}: {error.strerror}; try --web-port {port + 1}"
        ) from None


def program(arguments: Sequence[str]) -> list[str]:
    """The command of the program behind the page, from the arguments of `session --web`."""
    kept, skip = [], False
    for argument in arguments:
        name = argument.partition("=")[0]
        if not skip and name not in ("--web", "--web-host", "--web-port"):
            kept.append(argument)
        skip = not skip and name in ("--web-host", "--web-port") and "=" not in argument
    return [sys.executable, "-m", "rover_sweep", *kept, "--in-browser"]


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
