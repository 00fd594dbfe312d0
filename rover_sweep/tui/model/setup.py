"""Settings of the command line, and settings remembered between sessions."""

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

_MOST = 8  # remembered connections
_PORTS = ("/dev/serial/by-id/*", "/dev/ttyACM*", "/dev/ttyUSB*", "/dev/tty.usbmodem*", "/dev/tty.usbserial*")


def _not_saved(plan: tuple[Row, ...]) -> None:
    """Default of keep_plan: does not save the plan."""


@dataclass(frozen=True)
class Setup:
    """settings: what the user allows this program to do in a run; never extended here.

    folder: of the session; vehicle: from the file vehicle_path; url: listed first. memory: file that stores
    connections and theme, None for no file. plan, driven, logs: of a continued session; keep_plan: called
    with every change of the plan.
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
    keep_plan: Callable[[tuple[Row, ...]], object] = _not_saved

    @property
    def own_part(self) -> tuple[str, ...]:
        """Actions of this program in a run, as words; empty if the pilot does everything."""
        settings = self.settings
        return tuple(
            words
            for allowed, words in (
                (settings.arm, "arms the rover"),
                (settings.throttle_us is not None, f"drives it with throttle {settings.throttle_us} us"),
                (settings.trigger != "pilot", "throws the switch"),
            )
            if allowed
        )


def memory_file() -> Path:
    """The file that stores the Memory (XDG base directory specification)."""
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state"
    return Path(home) / "rover-sweep" / "session.json"


@dataclass(frozen=True)
class Memory:
    """Connections, the latest first; dark: the theme chosen last."""

    urls: tuple[str, ...] = ()
    dark: bool = False


def recall(path: Path | None) -> Memory:
    """The stored Memory; an empty one if the file is missing or damaged."""
    if path is None:
        return Memory()
    try:
        kept = read_json(path.read_text(encoding="utf-8"))
        return Memory(tuple(str(url) for url in kept["urls"])[:_MOST], bool(kept["dark"]))
    except (OSError, ValueError, KeyError, TypeError):
        return Memory()


def remember(path: Path | None, memory: Memory) -> None:
    """Store the Memory; ignores write errors."""
    if path is None:
        return
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"urls": memory.urls[:_MOST], "dark": memory.dark}), encoding="utf-8")


def with_url(memory: Memory, url: str) -> Memory:
    """The Memory with this connection first."""
    return Memory((url, *(other for other in memory.urls if other != url))[:_MOST], memory.dark)


def serial_ports() -> tuple[str, ...]:
    """Existing serial ports as URLs; each port once, by name if it has one."""
    found: dict[str, str] = {}
    for pattern in _PORTS:
        path = Path(pattern)
        for port in sorted(path.parent.glob(path.name)):
            found.setdefault(os.path.realpath(port), f"{port},115200")
    return tuple(found.values())
