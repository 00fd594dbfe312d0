"""Everything that a screen shows of a session, as one frozen value, and how it follows from what is told.

`reduce` is pure: the screens compute nothing and keep nothing, so what they show can be tested without
a terminal. Fast values (`Snapshot`, `Played`, `LogProgress`) replace the one before.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import reduce as folded
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from rover_sweep.live.snapshot import Snapshot, Verdict
from rover_sweep.live.source import (
    Began,
    Checked,
    DriveRequest,
    Ended,
    Judged,
    Lost,
    Played,
    Request,
    Several,
    Update,
)
from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.identity import VehicleIdentity
from rover_sweep.vehicle.preflight.item import Check

HISTORY = 150  # snapshots, some 15 s
MESSAGES = 500  # lines of the log

Level = Literal["info", "warning", "error", "vehicle"]
Outcome = Literal["asked", "running", "done", "stopped", "failed"]


@dataclass(frozen=True)
class Asked:
    """The screen asked for this; told to `reduce` in the same breath, so that nothing is asked twice."""

    request: Request


@dataclass(frozen=True)
class AbortAsked:
    """The abort key was pressed; told to `reduce` so that the screen answers the key at once."""


Own = Asked | AbortAsked


@dataclass(frozen=True)
class LogLine:
    """A line of the log; t: s on the vehicle's clock, NaN where it is not from there."""

    level: Level
    text: str


@dataclass(frozen=True)
class RunRecord:
    """A run of this session. outcome; reason: in words where it is not done; number: the applet's counter."""

    name: str
    manoeuvre: Manoeuvre
    outcome: Outcome = "asked"
    reason: str = ""
    number: int = 0
    tlog: Path | None = None
    verdict: Verdict | None = None


@dataclass(frozen=True)
class State:
    """What is known. asked: requests not yet ended, in order. failure: the last one, until the next request.

    doing: what was said since the latest request.
    aborting: the abort key was pressed and the run has not ended yet.
    wanted: what the pilot was asked to do with the switch and has not done. driving: what to drive, from
    the key until the source says that it ended. parameters: values seen being set on the vehicle.
    """

    url: str = ""
    vehicle: VehicleIdentity | None = None
    lost: str = ""
    failure: str = ""
    doing: str = ""
    asked: tuple[Request, ...] = ()
    checks: tuple[Check, ...] = ()
    snapshot: Snapshot | None = None
    history: tuple[Snapshot, ...] = ()
    applet: int = 0
    wanted: e.SwitchWanted | None = None
    runs: tuple[RunRecord, ...] = ()
    messages: tuple[LogLine, ...] = ()
    parameters: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))
    fetching: e.LogProgress | None = None
    logs: tuple[Path, ...] = ()
    folder: Path | None = None
    played: Played | None = None
    aborting: bool = False

    @property
    def driving(self) -> DriveRequest | None:
        """The run that was asked for and has not ended."""
        return next((request for request in self.asked if isinstance(request, DriveRequest)), None)

    @property
    def under_way(self) -> bool:
        """Whether there is something to abort: a run of ours, or an applet that is heard to steer."""
        steers = 0 < self.applet < 10 and not self.lost
        return self.played is None and (self.driving is not None or steers)

    @property
    def busy(self) -> bool:
        """Whether the source still works on something."""
        return bool(self.asked)

    @property
    def run(self) -> RunRecord | None:
        """The latest run."""
        return self.runs[-1] if self.runs else None

    @property
    def verdict(self) -> Verdict | None:
        """The latest verdict."""
        return next((run.verdict for run in reversed(self.runs) if run.verdict), None)

    @property
    def armed(self) -> bool:
        """As the vehicle last said."""
        return self.snapshot is not None and self.snapshot.armed


def reduce(state: State, told: Update | Own) -> State:
    """The state after `told`."""
    match told:
        case Snapshot():
            return _moved(state, told)
        case Asked():
            return _asked(state, told.request)
        case AbortAsked():
            return replace(_said(state, "warning", "abort"), aborting=state.under_way)
        case Began():
            return state if told.request in state.asked else _asked(state, told.request)
        case Ended():
            return _ended(state, told)
        case Checked():
            return replace(state, checks=told.checks)
        case Judged():
            return _judged(state, told.verdict)
        case Several():  # the list of connections shows them
            return state
        case Lost():
            state = replace(state, lost=told.reason, aborting=state.aborting and state.driving is not None)
            return _said(state, "error", f"link lost: {told.reason}")
        case Played():
            return replace(state, played=told)
        case _:
            return _happened(state, told)


def reduced(state: State, many: Iterable[Update | Own]) -> State:
    """`reduce` over several, oldest first."""
    return folded(reduce, many, state)


def _happened(state: State, event: e.Event) -> State:
    """A session's event."""
    match event:
        case e.Connected():
            words = f"connected to {event.vehicle.words} on {event.url}"
            return replace(_said(state, "info", words), url=event.url, vehicle=event.vehicle, lost="")
        case e.Notice():
            return _said(state, event.level, event.text)
        case e.Said():
            return _said(state, "vehicle", event.text)
        case e.ParameterSet():
            return _set(state, event)
        case e.Rebooting():
            return _said(state, "info", f"rebooting the rover, for {', '.join(event.because)}")
        case e.StateChanged():
            wanted = None if event.state > 0 and _wants(state, "high") else state.wanted
            return replace(state, applet=event.state, wanted=wanted)
        case e.SwitchWanted():
            return replace(state, wanted=event)
        case e.RunStarted() | e.RunFinished() | e.Interrupted():
            return _run(state, event)
        case e.LogProgress():
            return replace(state, fetching=event)
        case e.LogSaved():
            words = f"log fetched: {event.path.name}, {event.size / 1e6:.1f} MB"
            logs = (*(path for path in state.logs if path != event.path), event.path)
            return replace(_said(state, "info", words), logs=logs, fetching=None)
        case e.SessionFinished():
            return replace(state, folder=event.folder, logs=event.logs or state.logs)
        case _:  # Armed, Sample and StreamsSet: the snapshots show what they say
            return state


def _moved(state: State, now: Snapshot) -> State:
    """A snapshot that goes back in time (a seek, a reboot) begins a new history."""
    gone_on = bool(state.history) and now.t >= state.history[-1].t
    history = (*state.history[-(HISTORY - 1) :], now) if gone_on else (now,)
    done = _wants(state, "low") and now.switch < 1200  # us, below which the firmware reads low
    done = done or (_wants(state, "high") and now.state > 0)
    return replace(
        state,
        snapshot=now,
        history=history,
        applet=now.state,
        lost="",
        aborting=state.aborting and (state.driving is not None or 0 < now.state < 10),
        wanted=None if done else state.wanted,
    )


def _wants(state: State, position: str) -> bool:
    return state.wanted is not None and state.wanted.position == position


def _asked(state: State, request: Request) -> State:
    state = replace(state, asked=(*state.asked, request), failure="", doing="")
    if isinstance(request, DriveRequest):
        state = replace(state, aborting=False)
        record = RunRecord(request.planned.name, request.planned.manoeuvre)
        return replace(state, runs=(*state.runs, record), wanted=None)
    return state


def _ended(state: State, ended: Ended) -> State:
    asked = list(state.asked)
    if ended.request in asked:
        asked.remove(ended.request)
    state = replace(state, asked=tuple(asked))
    if isinstance(ended.request, DriveRequest):
        state = replace(_closed(state, ended), aborting=False)
    if ended.failure:
        state = replace(_said(state, "error", ended.failure), failure=ended.failure)
    return state


def _closed(state: State, ended: Ended) -> State:
    """A run whose end was not told otherwise has failed."""
    last = state.run
    if last is None or last.outcome not in ("asked", "running"):
        return state
    reason = ended.failure or "it ended without a result"
    return replace(state, runs=(*state.runs[:-1], replace(last, outcome="failed", reason=reason)))


def _run(state: State, event: e.RunStarted | e.RunFinished | e.Interrupted) -> State:
    """Into the record of that name, the latest one; a run that nobody asked for gets a record of its own."""
    index = next((n for n in reversed(range(len(state.runs))) if state.runs[n].name == event.name), None)
    match event:
        case e.RunStarted():
            new = RunRecord(event.name, event.manoeuvre, "running", tlog=event.tlog)
            if index is None or state.runs[index].outcome not in ("asked", "running"):
                return replace(state, runs=(*state.runs, new))
        case _ if index is None:
            return _said(state, "warning", f"{event.name} ended, and nobody saw it begin")
        case e.RunFinished():
            new = replace(
                state.runs[index],
                outcome="done" if event.completed else "stopped",
                reason="" if event.completed else event.reason,
                number=event.number,
                tlog=event.tlog,
            )
            if not event.completed:
                state = _said(state, "error", f"{event.name} did not run to its end: {event.reason}")
        case e.Interrupted():
            reason = "; ".join(("aborted", *event.failures))
            new = replace(state.runs[index], outcome="stopped", reason=reason, tlog=event.tlog)
    return replace(state, runs=(*state.runs[:index], new, *state.runs[index + 1 :]))


def _judged(state: State, verdict: Verdict) -> State:
    index = next((n for n in reversed(range(len(state.runs))) if state.runs[n].name == verdict.run), None)
    state = _said(state, "info", f"{verdict.run}: {verdict.sentence}")
    if index is None:
        return state
    new = replace(state.runs[index], verdict=verdict)
    return replace(state, runs=(*state.runs[:index], new, *state.runs[index + 1 :]))


def _set(state: State, event: e.ParameterSet) -> State:
    parameters = MappingProxyType({**state.parameters, event.name: event.value})
    old = "" if event.old is None else f"{event.old:g} -> "
    words = f"{event.name} {old}{event.value:g}{', after a reboot' if event.reboot else ''}"
    return replace(_said(state, "info", words), parameters=parameters)


def _said(state: State, level: Level, text: str) -> State:
    messages = (*state.messages[-(MESSAGES - 1) :], LogLine(level, text))
    return replace(state, messages=messages, doing=text)
