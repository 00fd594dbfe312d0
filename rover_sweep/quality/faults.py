"""The one place that judges whether a recording may be believed; commands and screens all ask it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rover_sweep.data.recording import Note, Recording
from rover_sweep.quality.clipping import CLIPPED, clipping
from rover_sweep.quality.clock_rate import STRETCHED, stretched_by_angles
from rover_sweep.quality.kinematics import kinematics
from rover_sweep.quality.length import TOO_SHORT
from rover_sweep.quality.relations import relations

REPEATED = (CLIPPED, TOO_SHORT)  # another drive mends these
SPARED = {"p": "r,ay", "ay": "r,p"}  # channel that a fit can do without: the option that leaves it out


def faults_of(run: Recording) -> tuple[Note, ...]:
    """What is certainly wrong with a run: the faults among its notes, and those that its channels show."""
    return tuple(note for note in _found(run) if note.fault)


def _found(run: Recording) -> tuple[Note, ...]:
    """Faults and warnings, each once."""
    read = tuple(note for note in run.notes if note.fault)
    odd_clock = any(note.fault == STRETCHED for note in read)
    told: dict[tuple[str, tuple[str, ...]], Note] = {}
    for note in (*read, *_shown(run, odd_clock)):
        told.setdefault((note.fault, note.spoils), note)  # two clocks may say the same
    return tuple(told.values())


def _shown(run: Recording, odd_clock: bool) -> tuple[Note, ...]:
    """Faults and warnings that the channels show; with a wrong clock, rates cannot be held to angles."""
    clipped = tuple(clipping(run))
    if odd_clock:
        return clipped
    sound = run.without({c for fault in clipped for c in fault.spoils})
    found = relations(sound)
    return (*clipped, *(tuple(stretched_by_angles(found)) or kinematics(found, _given_speed(run))))


def _given_speed(run: Recording) -> float | None:
    """m/s, where the speed is one number and was not recorded."""
    speed = run["speed"].x if "speed" in run else np.empty(0)
    return float(speed[0]) if speed.size and not np.ptp(speed) else None


def with_faults(run: Recording) -> Recording:
    """The run with its faults and warnings among its notes, each once."""
    return replace(run, notes=tuple(dict.fromkeys((*run.notes, *_found(run)))))


def spoiling(runs: Sequence[Recording], channels: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each fault of the runs that spoils what is made of these channels."""
    used = {*channels, "r", "speed"}
    found = ((run.name, f) for run in runs for f in faults_of(run) if used & set(f.spoils))
    return tuple(f"{name}: {_with_way_out(fault)}" for name, fault in found)


def faulty_channels(runs: Sequence[Recording]) -> tuple[set[str], tuple[str, ...]]:
    """(channels that a fault of any of the runs spoils, the faults in words)."""
    found = [(run.name, fault) for run in runs for fault in faults_of(run)]
    return {c for _, f in found for c in f.spoils}, tuple(f"{name}: {f.text}" for name, f in found)


def _with_way_out(fault: Note) -> str:
    """The fault's sentence, with how to answer without the channel where one can be left out."""
    only = fault.spoils[0] if len(fault.spoils) == 1 else ""
    return f"{fault.text}; without {only}: --fit {SPARED[only]}" if only in SPARED else fault.text


def advice_on(run: Recording) -> tuple[Literal["repeat", "discard"], str] | None:
    """(what to do, why) for the first fault of a run, None for a run without."""
    for fault in faults_of(run):
        if fault.fault in REPEATED:
            return "repeat", f"repeat: {_with_way_out(fault)}"
        return "discard", f"discard: {_with_way_out(fault)}"
    return None
