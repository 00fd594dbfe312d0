"""The response of the speed to the throttle: from recordings to speed.json, and from there to gains."""

from __future__ import annotations

import json
import mmap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rover_sweep.data.throttle_run import ThrottleRun
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.files.replaced import write_file
from rover_sweep.gains.speed_chain import speed_loop
from rover_sweep.gains.speed_identified import speed_from_document
from rover_sweep.gains.speed_proposal import SpeedProposal, propose_speed
from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.report.speed.speed_json import speed_document

SPEED_FILE = "speed.json"


def throttle_sweeps(sources: Sequence[str]) -> tuple[ThrottleRun, ...]:
    """All throttle sweeps in .BIN logs, pairs with one, or folders of sessions; () without any.

    Only a .BIN holds them. DataRefused for a damaged log, or for sweeps without a recorded speed.
    """
    return tuple(run for path in _logs(sources) if _mentions(path) for run in _runs_of(path))


def write_speed(result: SpeedResult, folder: Path) -> Path:
    """Writes speed.json into a folder, which is created if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(speed_document(result), indent=2, allow_nan=False)
    return write_file(folder / SPEED_FILE, text + "\n")


def speed_file(place: Path) -> Path | None:
    """The speed.json that a place (file or folder of results) stands for; None without one."""
    if place.is_file():
        return place if place.name == SPEED_FILE else None
    folders = (place, place / "report")
    return next((f / SPEED_FILE for f in folders if (f / SPEED_FILE).is_file()), None)


def speed_gains(path: Path, current: Mapping[str, float], current_from: str) -> SpeedProposal:
    """Current and proposed settings of the speed loop from a speed.json; see `proposed_speed`.

    UsageError for a file from which nothing can be computed.
    """
    try:
        document = read_json(path.read_text(encoding="utf-8"))
        speed_from_document(document)
    except (OSError, KeyError, TypeError, ValueError, IndexError) as error:
        raise UsageError(
            f"no speed gains can be computed from {path} ({type(error).__name__}: {error}); "
            "run identify again"
        ) from error
    return proposed_speed(document, current, current_from)


def proposed_speed(
    document: Mapping[str, Any], current: Mapping[str, float], current_from: str
) -> SpeedProposal:
    """Current and proposed settings of the speed loop from the content of a speed.json.

    current: {parameter: value} of the vehicle; what it lacks is taken from the runs, then from the firmware's
    defaults. current_from: their origin, for errors.
    """
    found = speed_from_document(document)
    try:
        return propose_speed(found, speed_loop({**found.parameters, **current}))
    except ValueError as error:
        raise UsageError(f"{current_from}: {error}") from None


def _logs(sources: Sequence[str]) -> list[Path]:
    """The .BIN files of the sources, each once."""
    found: dict[Path, None] = {}
    for source in sources:
        place = Path(source).expanduser()
        if place.is_dir():
            found |= dict.fromkeys(sorted(place.glob("*.BIN")))
            continue
        parts = [place] if place.is_file() else [Path(part).expanduser() for part in source.split("+")]
        found |= dict.fromkeys(p for p in parts if p.suffix.lower() == ".bin" and p.is_file())
    return list(found)


def _mentions(path: Path) -> bool:
    """Whether the log has the applet's message of a throttle sweep; far quicker than reading it."""
    if path.stat().st_size == 0:
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return data.find(b"SWET") >= 0


def _runs_of(path: Path) -> list[ThrottleRun]:
    from rover_sweep.logs.read import read_logs
    from rover_sweep.logs.runs.throttle import throttle_runs

    try:
        return [run for log in read_logs(str(path)) for run in throttle_runs(log)]
    except OSError as error:
        raise DataRefused(f"{path.name} cannot be read: {error}") from None
