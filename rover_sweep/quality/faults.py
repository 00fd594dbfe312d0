"""Faults of a recording, collected from all checks; the only place where commands and screens get them."""

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
from rover_sweep.quality.rovers import TWO_ROVERS

NO_EXCITATION = "no excitation"
OF_SETS = (TOO_SHORT, TWO_ROVERS)  # faults of several runs together
REPEATED = (CLIPPED, TOO_SHORT)  # faults that another run can avoid
OPTIONAL = {"p": "r,ay", "ay": "r,p"}  # {channel that a fit can leave out: value of --fit}


def faults_of(run: Recording) -> tuple[Note, ...]:
    """The faults of a run: those among its notes and those that its channels show."""
    return tuple(note for note in _found(run) if note.fault)


def _found(run: Recording) -> tuple[Note, ...]:
    """Faults and warnings, without repetitions."""
    read = tuple(note for note in run.notes if note.fault)
    odd_clock = any(note.fault == STRETCHED for note in read)
    notes: dict[tuple[str, tuple[str, ...]], Note] = {}
    for note in (*read, *_from_channels(run, odd_clock)):
        notes.setdefault((note.fault, note.spoils), note)  # two clocks may show the same
    return tuple(notes.values())


def _from_channels(run: Recording, odd_clock: bool) -> tuple[Note, ...]:
    """Faults and warnings from the channels. odd_clock: known clock fault, so rates do not match angles."""
    clipped = tuple(clipping(run))
    if odd_clock:
        return clipped
    sound = run.without({c for fault in clipped for c in fault.spoils})
    found = relations(sound)
    return (*clipped, *(tuple(stretched_by_angles(found)) or kinematics(found, _given_speed(run))))


def _given_speed(run: Recording) -> float | None:
    """The speed [m/s] if it is constant, so given instead of recorded; else None."""
    speed = run["speed"].x if "speed" in run else np.empty(0)
    return float(speed[0]) if speed.size and not np.ptp(speed) else None


def with_faults(run: Recording) -> Recording:
    """The run with its faults and warnings added to its notes."""
    return replace(run, notes=tuple(dict.fromkeys((*run.notes, *_found(run)))))


def is_unexcited(run: Recording) -> bool:
    """True for a run without steering, which has no frequency response."""
    return any(note.fault == NO_EXCITATION for note in run.notes)


def fault_sentences(runs: Sequence[Recording], channels: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each fault of the runs that affects results from these channels."""
    used = {*channels, "r", "speed"}
    found = ((run.name, f) for run in runs for f in faults_of(run) if used & set(f.spoils))
    return tuple(f"{name}: {_with_option(fault)}" for name, fault in found)


def without_faulty(
    runs: Sequence[Recording], checks: Sequence[Recording], channels: Sequence[str]
) -> tuple[tuple[Recording, ...], tuple[Recording, ...], tuple[str, ...]]:
    """(runs to fit, runs to check on, a sentence for each run left out because a fault spoils `channels`).

    Contradictory runs stay where they are the majority, as then the file is wrong and not a run; so do all
    runs where none to fit would be left.
    """
    used = {*channels, "r", "speed"}
    given = (*runs, *checks)
    faults = [[f for f in faults_of(r) if used & {*f.spoils} and f.fault not in OF_SETS] for r in given]
    idle = {i for i, run in enumerate(given) if is_unexcited(run)}
    odd = {i for i, found in enumerate(faults) if found} - idle
    out = idle if 2 * len(odd) > len(given) - len(idle) else idle | odd
    if out >= {*range(len(runs))}:
        return tuple(runs), tuple(checks), ()
    kept = [run for i, run in enumerate(given) if i not in out]
    fitted = len(runs) - sum(i < len(runs) for i in out)
    words = (f"left out {given[i].name}: {faults[i][0].text}" for i in sorted(out))
    return tuple(kept[:fitted]), tuple(kept[fitted:]), tuple(words)


def faulty_channels(runs: Sequence[Recording]) -> tuple[set[str], tuple[str, ...]]:
    """(channels that a fault of a run makes unusable, a sentence for each fault)."""
    found = [(run.name, fault) for run in runs for fault in faults_of(run)]
    return {c for _, f in found for c in f.spoils}, tuple(f"{name}: {f.text}" for name, f in found)


def _with_option(fault: Note) -> str:
    """The fault's sentence, with the option to fit without the channel where possible."""
    only = fault.spoils[0] if len(fault.spoils) == 1 else ""
    return f"{fault.text}; without {only}: --fit {OPTIONAL[only]}" if only in OPTIONAL else fault.text


def advice_on(run: Recording) -> tuple[Literal["repeat", "discard"], str] | None:
    """(action, sentence) for the first fault of a run, None without a fault."""
    for fault in faults_of(run):
        if fault.fault in REPEATED:
            return "repeat", f"repeat: {_with_option(fault)}"
        return "discard", f"discard: {_with_option(fault)}"
    return None
