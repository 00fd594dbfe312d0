"""What `run` does around a session, whatever the rover: says who moves what, diagnoses at the end."""

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
    """What is to be driven. limits: of the applet; trigger: who throws the switch, None as the rover's kind
    has it; logs: fetch the rover's log."""

    runs: tuple[SessionRun, ...]
    limits: dict[str, float]
    trigger: Trigger | None
    logs: bool


def folder_for(out: str | None) -> Path:
    """As `session_folder` (`out`, else run, run-2, ...); also one in which a session was begun and nothing
    driven, as after a wrong port or on a rover without the applet."""
    from rover_sweep.cli.types.folders import session_folder

    numbered = (Path("run" if n == 1 else f"run-{n}") for n in count(1))
    there = [Path(out)] if out else list(takewhile(Path.exists, numbered))
    return next((f for f in there if _nothing_driven(f)), None) or session_folder(out, "run")


def _nothing_driven(folder: Path) -> bool:
    from rover_sweep.session.folder import DESCRIPTION, read

    if not (folder / DESCRIPTION).is_file() or (folder / "report").exists():
        return False
    content = read(folder)
    return not content.runs and not content.logs


def announce(plan: SessionPlan, folder: Path) -> None:
    """Who moves what, before anything is connected."""
    from rover_sweep.cli.views.output import narration

    throttle, trigger = plan.settings.throttle_us, plan.settings.trigger
    own = ["arms the rover"] if plan.settings.arm else []
    own += [f"drives with throttle {throttle} us"] if throttle is not None else []
    own += [_SWITCHING[trigger]] if trigger in _SWITCHING else []
    words = f"this program {', '.join(own)}" if own else "arming, driving and the switch are the pilot's"
    seconds = sum(planned.manoeuvre.duration for planned in plan.runs)
    console = narration()
    console.print(
        f"{len(plan.runs)} runs, {seconds:.0f} s of steering in all, into {folder}; {words}",
        markup=False,
        soft_wrap=True,
    )


def diagnosed_session(session: SessionFinished, rover: tuple[Vehicle, Path]) -> None:
    """What the model leaves out of a session's runs, into its report/; doublets are held out."""
    from rover_sweep.api.diagnosis_input import material
    from rover_sweep.cli.driving.shared import recordings
    from rover_sweep.cli.driving.show_diagnosed import show_diagnosed
    from rover_sweep.diagnosis.settings import DiagnosisSettings

    given = material(recordings(session, rover[0]), ())
    show_diagnosed(given, rover, DiagnosisSettings(), session.folder / "report", False)
