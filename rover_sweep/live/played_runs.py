"""The runs in a recording, with the events that a session would have reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.errors import DataRefused
from rover_sweep.files.documents import printable
from rover_sweep.live.source import Verdict
from rover_sweep.live.verdict import verdict_on_run
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import runs_of
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep, configured_manoeuvre
from rover_sweep.quality.coherence import excited_range
from rover_sweep.quality.verdict import NOT_WHOLE
from rover_sweep.vehicle.events import RunFinished, RunStarted
from rover_sweep.vehicle.link.streams import StreamQuality
from rover_sweep.vehicle.run.follow import COMPLETED, outcome_told

IDLE, STOPPED = 0, 10  # states of the applet

Entry = tuple[float, int]  # vehicle's clock [s] at which a state was entered, the state


@dataclass(frozen=True, eq=False)
class PlayedRun:
    """One run. begin, end: s of the vehicle's clock, from the switch to the last state (without an applet:
    of the excitation). number: the applet's counter, or its place in the recording."""

    recording: Recording
    log: Log
    path: Path
    begin: float
    end: float
    number: int
    manoeuvre: Manoeuvre
    quality: tuple[StreamQuality, ...] = ()

    @property
    def started(self) -> RunStarted:
        return RunStarted(self.recording.name, self.manoeuvre, self.path)

    @property
    def finished(self) -> RunFinished:
        completed, reason = self._outcome()
        span = (self.begin, self.end)
        return RunFinished(self.recording.name, completed, reason, self.path, span, self.number, self.quality)

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict of `live.verdict.judge` after the run."""
        return replace(verdict_on_run(self.recording), source=self.path)

    def _outcome(self) -> tuple[bool, str]:
        """(completed, reason) by the applet's status text, else by the notes on the recording."""
        if (told := _told(self.log, self.begin, self.end)) is not None:
            return told[1], printable(told[2])
        faults = [n.text for n in self.recording.notes if n.text.startswith(NOT_WHOLE[:-1])]
        return not faults, faults[0] if faults else COMPLETED


def _told(log: Log, begin: float, end: float) -> tuple[int, bool, str] | None:
    """The applet's report at the end of the run between two times [s]."""
    texts = (text for t, text in log.marks if begin < t <= end + 1.0)
    return next(filter(None, map(outcome_told, texts)), None)


@dataclass(frozen=True)
class RunSpan:
    """A run with its begin and end [s from the start of its recording].

    from_applet: the applet reported its states there.
    """

    run: PlayedRun
    begin: float
    end: float
    from_applet: bool


def runs_in(
    log: Log,
    path: Path,
    states: Sequence[Entry],
    parameters: Callable[[float], dict[str, float]],
    quality: Callable[[float, float], tuple[StreamQuality, ...]] = lambda a, b: (),
) -> tuple[tuple[PlayedRun, ...], str]:
    """The runs of a log, or why there are none. states: the applet's, in time; parameters: at a time [s]."""
    try:
        found = runs_of(log)
    except DataRefused as refusal:
        return (), f"no run: {refusal}"
    runs = []
    for k, recording in enumerate(found):
        begin, end = _extent(recording, states)
        planned = configured_manoeuvre(parameters(begin)) if states else None
        if planned is None or planned.kind != recording.kind:
            planned = _as_driven(recording)
        told = _told(log, begin, end)
        number = told[0] if told is not None else k + 1
        streams = quality(*recording.span)
        runs.append(PlayedRun(recording, log, path, begin, end, number, planned, streams))
    return tuple(runs), ""


def _extent(recording: Recording, states: Sequence[Entry]) -> tuple[float, float]:
    """From leaving idle to being idle or stopped again, around the excitation."""
    first, last = recording.span
    middle = (first + last) / 2
    begin = end = None
    for k, (t, state) in enumerate(states):
        resting = state in (IDLE, STOPPED)
        if t <= middle:
            fresh = not resting and (k == 0 or states[k - 1][1] in (IDLE, STOPPED))
            begin = t if fresh else None if resting else begin
        elif resting and end is None:
            end = t
    return min(first, begin if begin is not None else first), end if end is not None else last


def _as_driven(recording: Recording) -> Manoeuvre:
    """An approximate manoeuvre from the recording, for a run without known parameters."""
    x = recording.manoeuvre("pwm" if "pwm" in recording else "delta").x
    amplitude, length = max(float(np.ptp(x)) / 2, 1e-3), recording.span[1] - recording.span[0]
    if recording.kind == "doublet":
        return Doublet(amplitude, pulse=length / 8, pause=length / 4, straight=0.0)
    low, high = excited_range([recording], "pwm" if "pwm" in recording else "delta")
    high = max(high, 1.01 * low)
    try:
        if recording.kind == "multisine":
            return Multisine(amplitude, low, high, length, 3, 0.0, 0.0, 0.0)
        return Sweep(amplitude, low, high, length, 0.0, 0.0, 0.0)
    except ValueError:
        return Sweep(amplitude, t_rec=length, fade=0.0, dwell=0.0, straight=0.0)
