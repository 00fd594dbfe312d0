"""Settings of the command line, and settings remembered between sessions."""

from __future__ import annotations

import contextlib
import json
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from rover_sweep.data.codec import decoded
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.files.documents import read_json
from rover_sweep.live.source import Played, Snapshot, Update, Verdict
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import Content, SessionRun
from rover_sweep.session.folder import outcome_of
from rover_sweep.tui import drawn as labels
from rover_sweep.tui.model.plan_rows import SPEED, Row, ground
from rover_sweep.tui.model.state import Outcome, RunRecord, State
from rover_sweep.vehicle.events import LogProgress, Sample
from rover_sweep.vehicle.link.connection import Heard
from rover_sweep.vehicle.preflight.read_rover import Check
from rover_sweep.vehicle.run.controls import RunSettings

_MOST = 8  # remembered connections


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
    keep_plan: Callable[[tuple[Row, ...]], object] = lambda plan: None

    @property
    def own_part(self) -> tuple[str, ...]:
        """Actions of this program in a run, as words; empty if the pilot does everything."""
        settings = self.settings
        throttle = settings.throttle_us
        parts = (
            "arms the rover" if settings.arm else "",
            f"drives it with throttle {throttle} us" if throttle is not None else "",
            "throws the switch" if settings.trigger != "pilot" else "",
        )
        return tuple(filter(None, parts))


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


# The connections to choose from: command line, used before, plugged in, usual.


USUAL = ("udp:0.0.0.0:14550", "tcp:127.0.0.1:5760")


@dataclass(frozen=True)
class ConnectionChoice:
    """A connection to choose, and its origin. system: one of several vehicles on it."""

    url: str
    origin: str
    system: int | None = None


def places(given: str, remembered: tuple[str, ...], ports: Mapping[str, str]) -> tuple[ConnectionChoice, ...]:
    """Each connection once, the most likely first. ports: as of `serial_ports`."""
    found = {given: "command line"} if given else {}
    plugged = {port: f"plugged in{what and f': {what}'}" for port, what in ports.items()}
    for origins in (dict.fromkeys(remembered, "used before"), plugged, dict.fromkeys(USUAL, "usual")):
        for url, origin in origins.items():
            found.setdefault(url, origin)
    return tuple(ConnectionChoice(url, origin) for url, origin in found.items())


def with_systems(
    found: tuple[ConnectionChoice, ...], url: str, heard: Sequence[Heard]
) -> tuple[ConnectionChoice, ...]:
    """The list with `url` replaced by an entry per vehicle heard on it, at the front if it was not listed."""
    each = tuple(ConnectionChoice(url, str(one), one.system) for one in heard)
    at = next((n for n, place in enumerate(found) if place.url == url), 0)
    rest = [place for place in found if place.url != url]
    return (*rest[:at], *each, *rest[at:])


# Runs, logs and plan of a continued session, from its folder.


_OUTCOMES: Mapping[str, Outcome] = {"done": "done", "stopped": "stopped", "cut": "failed", "begun": "failed"}


def records(content: Content, folder: Path) -> tuple[RunRecord, ...]:
    """The driven runs, oldest first."""
    out = []
    for run in content.runs:
        outcome, tlog, verdict = _OUTCOMES[run.state], folder / run.tlog, _verdict(run.verdict)
        reason = run.reason
        if outcome == "done":
            reason = "" if run.verdict else "no verdict: the program ended first; 7 can still identify it"
        # a run that was cut began if its recording shows the applet at work
        began = run.span is not None or (tlog.is_file() and outcome_of(tlog) is not None)
        manoeuvre = run.manoeuvre or Sweep()
        out.append(RunRecord(run.name, manoeuvre, outcome, reason, run.number, tlog, verdict, began))
    return tuple(out)


def fetched_logs(content: Content, folder: Path) -> tuple[Path, ...]:
    """The vehicle's logs in the folder."""
    return tuple(folder / log.file for log in content.logs)


def rows(content: Content) -> tuple[Row, ...]:
    """The saved plan as rows."""
    return tuple(Row(run.manoeuvre, run.speed or SPEED, run.name) for run in content.plan)


def runs_of_plan(plan: tuple[Row, ...]) -> tuple[SessionRun, ...]:
    """The plan in the form saved in the folder."""
    return tuple(SessionRun(row.name, row.manoeuvre, row.speed) for row in plan)


def _verdict(saved: Mapping[str, Any] | None) -> Verdict | None:
    """The saved verdict; None if missing, or written by another version."""
    if saved is None:
        return None
    try:
        verdict = decoded({key: value for key, value in saved.items() if key != "source"}, Verdict)
    except (ValueError, OverflowError):
        return None
    return verdict if isfinite(verdict.amplitude or 0.0) else None


# Queue from the source's thread to the screen's; fast values replace those not yet taken.


_FAST = (Snapshot, Played, LogProgress, Sample)


class Feed:
    """`put` in any thread, `take` in the screen's; `wake` is called at the first `put` after a `take`."""

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake, self._lock = wake, threading.Lock()
        self._waiting: list[Update] = []

    def put(self, message: Update) -> None:
        """Add a message without blocking; of the fast values only the latest of each type is kept."""
        with self._lock:
            first = not self._waiting
            if isinstance(message, _FAST):
                self._waiting = [other for other in self._waiting if type(other) is not type(message)]
            self._waiting.append(message)
        if first:
            self._wake()

    def take(self) -> list[Update]:
        """All waiting messages, oldest first."""
        with self._lock:
            taken, self._waiting = self._waiting, []
        return taken


# The question before a run: what this program will do, what speaks against it.


def question_before(row: Row, setup: Setup, state: State, checked: str = "") -> str:
    """The question; "" if the pilot does everything and the run is not already kept.

    checked: how long ago the checks were run, "" for just now.
    """
    kept, own = is_kept(row, state.runs), setup.own_part
    if not kept and not own:
        return ""
    parts = [
        f"{row.name}: {labels.manoeuvre(row.manoeuvre)} at {row.speed:g} m/s, "
        f"{labels.seconds(row.manoeuvre.duration)}{ground(row, setup.vehicle)}."
    ]
    if kept:
        parts.append(f"{row.name} is already KEEP: there is no need to drive it again.")
    parts.append(bad_checks(state.checks, checked))
    if own:
        parts.append(f"This program {', '.join(own)}.")
    return "\n\n".join((*parts, "Is the area clear of people and obstacles?"))


def bad_checks(checks: Sequence[Check], checked: str = "") -> str:
    """A sentence on how many of the checks are bad, and which. checked: how long ago, "" for just now."""
    bad = [check.name.replace("_", " ") for check in checks if check.state == "bad"]
    if not checks:
        return "The checks were NOT RUN: view 2, R."
    when = f", checked {checked}" if checked else ""
    if not bad:
        return f"None of the {len(checks)} checks is BAD{when}."
    verb = "is" if len(bad) == 1 else "are"
    return f"{len(bad)} of {len(checks)} checks {verb} BAD: {', '.join(bad)} (view 2{when})."


def is_kept(row: Row, runs: Sequence[RunRecord]) -> bool:
    """True if the latest run of the row has the verdict to keep it."""
    latest = next(reversed(driven_for(row, runs)), None)
    return latest is not None and latest.verdict is not None and latest.verdict.advice == "keep"


def driven_for(row: Row, runs: Sequence[RunRecord]) -> list[RunRecord]:
    """The runs of a row of the plan, oldest first; the latest alone if none began."""
    found = [run for run in runs if run.name == row.name and run.manoeuvre == row.manoeuvre]
    return [run for run in found if run.began or run.outcome in ("asked", "running")] or found[-1:]
