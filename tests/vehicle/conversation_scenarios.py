"""What was done in the recorded conversations: the same functions drove the real firmware then
(`record_conversations`) and are played the recordings now."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from firmware_params.param_files import read
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.session import SessionPlan, drive
from rover_sweep.vehicle.events import Event, LogProgress
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.transport import Line
from rover_sweep.vehicle.logs import MavlinkLogs
from rover_sweep.vehicle.run.controls import RunSettings
from rover_sweep.vehicle.setup import install, survey

CONVERSATIONS = Path(__file__).parents[1] / "data" / "conversations"
PARAMETERS = CONVERSATIONS / "identification.param"  # as they were, whatever becomes of the shipped ones
APPLET = CONVERSATIONS / "rover_sweep.lua"
VERSIONS = ("4.6.3", "4.5.7")
SWEEP = Sweep(amplitude=150, w_min=2, w_max=20, t_rec=12, fade=1, dwell=1, straight=1)
LIMITS = {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0, "still": 1.0}
THROTTLE_US = 1710

Told = Callable[[Event], None]  # what a simulated pilot is told while it is real
Scenario = Callable[[str, Path, Line, Told], Iterator[Any]]


def nobody(event: Event) -> None:
    """The pilot of a recording: what he did is in it."""


def surveyed_and_installed(url: str, folder: Path, line: Line, told: Told) -> Iterator[Any]:
    """A rover as from the factory is looked at, gets applet and parameters, reboots, is looked at again."""
    wanted = read(PARAMETERS)
    with Link.open(url, folder / "install.tlog", line=line) as link:
        yield survey(link, wanted)
        yield from install(link, wanted, APPLET)
        yield survey(link, wanted)


def swept(url: str, folder: Path, line: Line, told: Told) -> Iterator[Any]:
    """A sweep that comes to its end, by RC override."""
    yield from _driven(url, folder, line, told, RunSettings(True, THROTTLE_US, "override", LIMITS))


def stopped_by_limit(url: str, folder: Path, line: Line, told: Told) -> Iterator[Any]:
    """A sweep that the applet stops since the rover turns too fast for SWP_R_MAX; the switch by command."""
    settings = RunSettings(True, THROTTLE_US, "aux", LIMITS | {"r_max": 25.0})
    yield from _driven(url, folder, line, told, settings)


def stopped_by_switch(url: str, folder: Path, line: Line, told: Told) -> Iterator[Any]:
    """The pilot drives and throws the switch, and throws it low in the middle of the sweep."""
    yield from _driven(url, folder, line, told, RunSettings(True, None, "pilot", LIMITS))


def log_fetched(url: str, folder: Path, line: Line, told: Told) -> Iterator[Any]:
    """All logs of the rover."""
    with Link.open(url, folder / "logs.tlog", line=line) as link:
        logs = MavlinkLogs(link)
        for entry in logs.logs():
            yield entry
            yield from logs.download(entry, folder / f"log{entry.number}.BIN")


SCENARIOS: dict[str, Scenario] = {
    "install": surveyed_and_installed,
    "sweep": swept,
    "limit": stopped_by_limit,
    "switch": stopped_by_switch,
    "log": log_fetched,
}


def _driven(url: str, folder: Path, line: Line, told: Told, settings: RunSettings) -> Iterator[Any]:
    plan = SessionPlan((SessionRun("sweep1", SWEEP),), settings, logs=False)
    for event in drive(url, folder, plan, line):
        told(event)
        yield event


def carried_out(
    scenario: Scenario, url: str, folder: Path, line: Line, told: Told = nobody
) -> dict[str, Any]:
    """What happened, as JSON has it: events, and hashes of the files. Left out: how long it took, where the
    files lay, and what compares with the program's present applet instead of the recording's."""
    with mock.patch("rover_sweep.vehicle.run.one_run.drawn", lambda: 17):
        events = [
            _plain(event) for event in scenario(url, folder, line, told) if not isinstance(event, LogProgress)
        ]
    files = {path.name: _digest(path) for path in sorted(folder.iterdir()) if path.suffix in _PARTS}
    return {"events": events, "files": files}


_LEFT_OUT = {
    "AppletState": ("current",),
    "Connected": ("url",),
    "RunStarted": ("tlog",),
    "RunFinished": ("tlog",),
    "LogSaved": ("path", "seconds"),
    "SessionFinished": ("folder", "logs"),
}


def _plain(value: Any) -> Any:
    """A value as JSON has it; NaN as a word, since it is not equal to itself; long texts hashed."""
    if is_dataclass(value) and not isinstance(value, type):
        name = type(value).__name__
        kept = {k: v for k, v in vars(value).items() if k not in _LEFT_OUT.get(name, ())}
        return {"": name} | {k: _plain(v) for k, v in kept.items()}
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, str) and len(value) > 500:
        return hashlib.sha256(value.encode()).hexdigest()
    return "nan" if value != value else value


def _digest(path: Path) -> str:
    """SHA-256 of a file, without the times at which the parts of a .tlog or .noise came."""
    return hashlib.sha256(b"".join(_PARTS[path.suffix](path.read_bytes()))).hexdigest()


def _frames(tlog: bytes) -> Iterator[bytes]:
    at = 8
    while at < len(tlog):
        length = tlog[at + 1] + (12 if tlog[at] == 0xFD else 8)
        yield tlog[at : at + length]
        at += length + 8


def _noise(file: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(file):
        (length,) = struct.unpack_from(">I", file, at + 8)
        yield file[at + 12 : at + 12 + length]
        at += 12 + length


_PARTS: dict[str, Callable[[bytes], Iterator[bytes]]] = {
    ".tlog": _frames,
    ".noise": _noise,
    ".BIN": lambda file: iter((file,)),
}
