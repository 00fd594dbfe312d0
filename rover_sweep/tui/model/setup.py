"""What the command line said, and what is remembered between two afternoons."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.files.documents import read_json
from rover_sweep.tui.model.plan_rows import Row
from rover_sweep.tui.model.state import RunRecord
from rover_sweep.vehicle.run.settings import RunSettings

_MOST = 8  # connections that are remembered
_PORTS = ("/dev/serial/by-id/*", "/dev/ttyACM*", "/dev/ttyUSB*", "/dev/tty.usbmodem*", "/dev/tty.usbserial*")


def _nowhere(plan: tuple[Row, ...]) -> None:
    """A plan that nobody keeps."""


@dataclass(frozen=True)
class Setup:
    """settings: what this program may do in a run, as the user said; nothing here widens it.

    folder: of the session; vehicle: as its file (vehicle_path) says; url: put first. memory: file in which
    connections and the theme are kept, None: nowhere. plan, driven, logs: what
    there is of this session already; keep_plan: is called with every change of the plan.
    """

    settings: RunSettings = field(default_factory=RunSettings)
    url: str = ""
    folder: Path | None = None
    vehicle_path: Path | None = None
    vehicle: Vehicle | None = None
    memory: Path | None = None
    plan: tuple[Row, ...] = ()
    driven: tuple[RunRecord, ...] = ()
    logs: tuple[Path, ...] = ()
    keep_plan: Callable[[tuple[Row, ...]], object] = _nowhere

    @property
    def own_part(self) -> tuple[str, ...]:
        """What this program does by itself in a run, in words; empty where all is the pilot's."""
        settings = self.settings
        return tuple(
            words
            for told, words in (
                (settings.arm, "arms the rover"),
                (settings.throttle_us is not None, f"drives it with throttle {settings.throttle_us} us"),
                (settings.trigger != "pilot", "throws the switch"),
            )
            if told
        )


def memory_file() -> Path:
    """Where programs keep their state (XDG base directory specification)."""
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state"
    return Path(home) / "rover-sweep" / "session.json"


@dataclass(frozen=True)
class Memory:
    """Connections, the latest first; dark: the theme that was chosen last."""

    urls: tuple[str, ...] = ()
    dark: bool = False


def recall(path: Path | None) -> Memory:
    """What is remembered; nothing where the file is missing or spoilt, which is no reason not to drive."""
    if path is None:
        return Memory()
    try:
        kept = read_json(path.read_text(encoding="utf-8"))
        return Memory(tuple(str(url) for url in kept["urls"])[:_MOST], bool(kept["dark"]))
    except (OSError, ValueError, KeyError, TypeError):
        return Memory()


def remember(path: Path | None, memory: Memory) -> None:
    """Keeps it, where that can be done."""
    if path is None:
        return
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"urls": memory.urls[:_MOST], "dark": memory.dark}), encoding="utf-8")


def with_url(memory: Memory, url: str) -> Memory:
    """The connection put first."""
    return Memory((url, *(other for other in memory.urls if other != url))[:_MOST], memory.dark)


def serial_ports() -> tuple[str, ...]:
    """Serial ports that are there, as URLs; one that is known by its name is not told by its number again."""
    found: dict[str, str] = {}
    for pattern in _PORTS:
        path = Path(pattern)
        for port in sorted(path.parent.glob(path.name)):
            found.setdefault(os.path.realpath(port), f"{port},115200")
    return tuple(found.values())
