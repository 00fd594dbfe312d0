"""Steps of `run` for real and simulated rovers: choose the folder, announce the plan, diagnose."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.session.session import SessionPlan, SessionRun
    from rover_sweep.vehicle.events import SessionFinished
    from rover_sweep.vehicle.run.controls import Trigger

TRIGGERS = ("override", "aux", "pilot")
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
    from rover_sweep.cli.types.folders import session_folder

    numbered = (Path("run" if n == 1 else f"run-{n}") for n in count(1))
    existing = [Path(out)] if out else list(takewhile(Path.exists, numbered))
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
        f"{len(plan.runs)} runs, {seconds:.0f} s of {what} in total, into {folder}; {words}",
        markup=False,
        soft_wrap=True,
    )


def diagnose_session(session: SessionFinished, rover: tuple[Vehicle, Path]) -> None:
    """Diagnose a session's runs into its report/; doublets are held out."""
    from rover_sweep.api.diagnosis_input import material
    from rover_sweep.cli.driving.session_display import complete_runs
    from rover_sweep.cli.driving.show_diagnosed import show_diagnosed
    from rover_sweep.diagnosis.settings import DiagnosisSettings

    given = material(complete_runs(session, rover[0]), ())
    show_diagnosed(given, rover, DiagnosisSettings(), session.folder / "report", False)
