"""Detects runs that are too short: too few periods of the lowest frequency that a fit needs.

The windows adapt to a record of any length, so coherence and cost look good even for 4 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import Note, Recording
from rover_sweep.spectra.response import LOWEST_BIN

TOO_SHORT = "too short"
ALL = ("r", "p", "ay", "vy", "speed", "delta", "pwm")
SLOW = 2.0  # rad/s: a fit needs the nearly steady response, below the yaw mode of any small rover
PERIODS = 5.0  # Tischler & Remple 2012, chapter 5: 4..5; random error of |H| .096 at a coherence of .9
WINDOWS = 2.0  # windows that resolve that frequency, in a run
REPEATS = 5  # short trials from which they count as repeats: T_F/5 is then the longest window (T&R 2012)
SHORTEST = 1.5  # s, of such a trial


def needed(lowest: float = SLOW) -> float:
    """Time [s] of driving that a fit from `lowest` [rad/s] needs; less when that is above SLOW."""
    return PERIODS * 2 * np.pi / max(lowest, SLOW)


def too_short(runs: Sequence[Recording], lowest: float = SLOW) -> Note | None:
    """The fault of runs that are too short in total, or None; runs shorter than 2 windows do not count.

    Short trials count where there are `REPEATS` or more. lowest [rad/s]: lowest frequency of the fit.
    """
    period = needed(lowest) / PERIODS
    lengths = [run.span[1] - run.span[0] for run in runs]
    if sum(t for t in lengths if t >= WINDOWS * LOWEST_BIN * period) >= needed(lowest):
        return None
    if short_trials(runs) and sum(lengths) >= needed(lowest):
        return None
    driven = f"{len(runs)} runs of at most {max(lengths):.1f} s" if len(runs) > 1 else f"{lengths[0]:.1f} s"
    text = (
        f"too short: {driven} of driving, but {needed(lowest):.0f} s are needed ({PERIODS:g} periods of "
        f"{2 * np.pi / period:.2g} rad/s) for a random error of 10 %; drive one complete sweep of "
        f"{needed(lowest):.0f} s or more"
    )
    return Note("warning", text, TOO_SHORT, ALL)


def short_trials(runs: Sequence[Recording]) -> bool:
    """True for many short trials, joined as repeats: none has two windows of the lowest frequency."""
    enough = [run for run in runs if run.span[1] - run.span[0] >= SHORTEST]
    return len(enough) >= REPEATS and all(is_short(run) for run in runs)


def is_short(run: Recording) -> bool:
    """True for a run without two windows of the lowest frequency, which alone gives no response."""
    return run.span[1] - run.span[0] < WINDOWS * LOWEST_BIN * needed() / PERIODS


def with_length(runs: Sequence[Recording], lowest: float = SLOW) -> tuple[Recording, ...]:
    """The runs of one fit; when they are too short in total, the first gets the fault."""
    fault = too_short(runs, lowest) if runs else None
    return (_marked(runs[0], fault), *runs[1:]) if fault else tuple(runs)


def each_with_length(runs: Sequence[Recording]) -> tuple[Recording, ...]:
    """The runs, each with the fault if it is too short; runs driven by hand are counted together.

    Doublets are not judged: they are for verification.
    """
    by_hand = [run for run in runs if run.kind == "other"]
    others = too_short(by_hand) if by_hand else None
    faults = ((run, others if run.kind == "other" else _single(run)) for run in runs)
    return tuple(_marked(run, fault) if fault else run for run, fault in faults)


def _single(run: Recording) -> Note | None:
    return None if run.kind == "doublet" else too_short([run])


def _marked(run: Recording, fault: Note) -> Recording:
    return replace(run, notes=(*(n for n in run.notes if n.fault != TOO_SHORT), fault))
