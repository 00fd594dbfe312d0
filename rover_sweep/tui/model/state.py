"""Everything that the screens show of a session as one frozen value, and its update by messages.

`reduce` is pure: the screens compute nothing and store nothing, so their content can be tested without
a terminal. Fast values (`Snapshot`, `Played`, `LogProgress`) replace the previous one.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from firmware_params.applet_parameters import SWITCH_LOW
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
    Snapshot,
    Update,
    Verdict,
)
from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.identity import VehicleIdentity
from rover_sweep.vehicle.preflight.read_rover import Check

HISTORY = 150  # snapshots, about 15 s
MESSAGES = 500  # lines of the log

Level = Literal["info", "warning", "error", "vehicle"]
Outcome = Literal["asked", "running", "done", "stopped", "failed"]


@dataclass(frozen=True)
class Asked:
    """The screen sent this request; recorded immediately, so that a request is not sent twice."""

    request: Request


@dataclass(frozen=True)
class AbortAsked:
    """The abort key was pressed; recorded immediately, so that the screen reacts at once."""


Own = Asked | AbortAsked


@dataclass(frozen=True)
class LogLine:
    """A line of the log."""

    level: Level
    text: str


@dataclass(frozen=True)
class RunRecord:
    """A run of this session. reason: why it is not complete; number: the applet's run counter; began: the
    applet began it."""

    name: str
    manoeuvre: Manoeuvre
    outcome: Outcome = "asked"
    reason: str = ""
    number: int = 0
    tlog: Path | None = None
    verdict: Verdict | None = None
    began: bool = False

    @property
    def label(self) -> str:
        """The name, with a number if it is a repeat, as reports have it."""
        return self.tlog.stem if self.tlog else self.name


@dataclass(frozen=True)
class State:
    """State of the session. asked: pending requests, in order. failure: the last one, until the next request.

    doing: latest message since the latest request.
    aborting: the abort key was pressed and the run has not ended yet.
    wanted: pending request to the pilot to throw the switch. driving: the run, from the key until the source
    reports its end. parameters: values set on the vehicle.
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
        """The requested run that has not ended."""
        return next((request for request in self.asked if isinstance(request, DriveRequest)), None)

    @property
    def under_way(self) -> bool:
        """True if there is something to abort: a run of this program, or an applet that steers."""
        steers = 0 < self.applet < 10 and not self.lost
        return self.played is None and (self.driving is not None or steers)

    @property
    def busy(self) -> bool:
        """True while a request is pending."""
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
        """True if the vehicle was armed in its last snapshot."""
        return self.snapshot is not None and self.snapshot.armed


def reduce(state: State, message: Update | Own) -> State:
    """The state after a message."""
    match message:
        case Snapshot():
            return _moved(state, message)
        case Asked():
            return _asked(state, message.request)
        case AbortAsked():
            return replace(_logged(state, "warning", "abort"), aborting=state.under_way)
        case Began():
            return state if message.request in state.asked else _asked(state, message.request)
        case Ended():
            return _ended(state, message)
        case Checked():
            return replace(state, checks=message.checks)
        case Judged():
            verdict = message.verdict
            state = _logged(state, "info", f"{verdict.run}: {verdict.sentence}")
            return _changed(state, _latest(state, verdict.run), verdict=verdict)
        case Several():  # shown in the list of connections
            return state
        case Lost():
            state = replace(state, lost=message.reason, aborting=state.aborting and state.driving is not None)
            return _logged(state, "error", f"link lost: {message.reason}")
        case Played():
            return replace(state, played=message)
        case _:
            return _happened(state, message)


def _happened(state: State, event: e.Event) -> State:
    """The state after an event of the session."""
    match event:
        case e.Connected():
            words = f"connected to {event.vehicle.words} on {event.url}"
            return replace(_logged(state, "info", words), url=event.url, vehicle=event.vehicle, lost="")
        case e.Notice():
            return _logged(state, event.level, event.text)
        case e.Said():
            return _logged(state, "vehicle", event.text)
        case e.ParameterSet():
            old = "" if event.old is None else f"{event.old:g} -> "
            words = f"{event.name} {old}{event.value:g}{', after a reboot' if event.reboot else ''}"
            parameters = MappingProxyType({**state.parameters, event.name: event.value})
            return replace(_logged(state, "info", words), parameters=parameters)
        case e.Rebooting():
            return _logged(state, "info", f"rebooting the rover to apply {', '.join(event.because)}")
        case e.StateChanged():
            if event.state > 0:
                if state.run is not None and state.run.outcome == "running":
                    state = _changed(state, -1, began=True)
                state = replace(state, wanted=None if _wants(state, "high") else state.wanted)
            return replace(state, applet=event.state)
        case e.SwitchWanted():
            return replace(state, wanted=event)
        case e.RunStarted() | e.RunFinished() | e.Interrupted():
            return _run(state, event)
        case e.LogProgress():
            return replace(state, fetching=event)
        case e.LogSaved():
            words = f"log fetched: {event.path.name}, {event.size / 1e6:.1f} MB"
            logs = (*(path for path in state.logs if path != event.path), event.path)
            return replace(_logged(state, "info", words), logs=logs, fetching=None)
        case e.SessionFinished():
            return replace(state, folder=event.folder, logs=event.logs or state.logs)
        case _:  # Armed, Sample and StreamsSet: their content is in the snapshots
            return state


def _moved(state: State, now: Snapshot) -> State:
    """The state after a snapshot; one that goes back in time (seek, reboot) starts a new history."""
    gone_on = bool(state.history) and now.t >= state.history[-1].t
    history = (*state.history[-(HISTORY - 1) :], now) if gone_on else (now,)
    done = _wants(state, "low") and now.switch < SWITCH_LOW
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
        state = replace(state, aborting=False)
        if state.run is not None and state.run.outcome in ("asked", "running"):  # no other end was reported
            reason = ended.failure or "it ended without a result"
            state = _changed(state, -1, outcome="failed", reason=reason)
    if ended.failure:
        state = replace(_logged(state, "error", ended.failure), failure=ended.failure)
    return state


def _run(state: State, event: e.RunStarted | e.RunFinished | e.Interrupted) -> State:
    """Update the latest record of that name; a run that was not requested gets a new record."""
    index = _latest(state, event.name)
    match event:
        case e.RunStarted():
            new = RunRecord(event.name, event.manoeuvre, "running", tlog=event.tlog)
            if index is None or state.runs[index].outcome not in ("asked", "running"):
                return replace(state, runs=(*state.runs, new))
            return replace(state, runs=(*state.runs[:index], new, *state.runs[index + 1 :]))
        case _ if index is None:
            return _logged(state, "warning", f"{event.name} ended, but its start was not received")
        case e.RunFinished():
            if not event.completed:
                state = _logged(state, "error", f"{event.name} is incomplete: {event.reason}")
            outcome, reason = ("done", "") if event.completed else ("stopped", event.reason)
            own = {"outcome": outcome, "reason": reason, "number": event.number, "began": True}
            return _changed(state, index, tlog=event.tlog, **own)
        case e.Interrupted():
            reason = "; ".join(filter(None, ("aborted", event.unreleased)))
            return _changed(state, index, outcome="stopped", reason=reason, tlog=event.tlog)


def _latest(state: State, name: str) -> int | None:
    """Index of the latest run of that name."""
    return next((n for n in reversed(range(len(state.runs))) if state.runs[n].name == name), None)


def _changed(state: State, index: int | None, **values: Any) -> State:
    """The state with other values in a record; unchanged without an index."""
    runs = list(state.runs)
    if index is not None:
        runs[index] = replace(runs[index], **values)
    return replace(state, runs=tuple(runs))


def _logged(state: State, level: Level, text: str) -> State:
    messages = (*state.messages[-(MESSAGES - 1) :], LogLine(level, text))
    return replace(state, messages=messages, doing=text)
