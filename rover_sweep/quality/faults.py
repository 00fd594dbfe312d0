"""Faults of a recording, collected from all checks; the only place where commands and screens get them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rover_sweep.data.recording import ASSUMED, Note, Recording, Signal, stretches
from rover_sweep.quality.relations import ALL_CHANNELS, STRETCHED, kinematics, relations, stretched_by_angles
from rover_sweep.quality.rovers import TWO_ROVERS
from rover_sweep.spectra.response import LOWEST_BIN

# Detects a clipped sensor: the signal stays at one extreme value below the full scale of its channel.


CLIPPED = "clipped"
SENSORS = {"r": "gyro", "p": "gyro", "ay": "accelerometer"}
SHARE = 0.002  # of the run's samples at the extreme value
MIN_STAYS = 3  # separate stays of two samples or more at the extreme value
PILED_UP = 10.0  # samples at the extreme value over those at a value close to it; a sine has 3 to 8
NEAR = 0.05  # of the signal's range: values close to the extreme
STEEP = 3.0  # resolution steps in the last sample before a stay; a smooth maximum is reached in single steps
STEERED = (
    0.03  # of the steering's range: smallest change during a stay, as constant steering gives constant r
)
MIN_VALUES = 50  # distinct values of a signal; with fewer it is not judged


def clipping(run: Recording) -> Iterator[Note]:
    """A fault for each of r, p and a_y that stays at one extreme value while the steering moves."""
    steering = run.manoeuvre("delta" if "delta" in run else "pwm")
    for channel, sensor in SENSORS.items():
        if channel not in run:
            continue
        signal = run.manoeuvre(channel)
        share, extreme = max(
            (_clipped(signal, side, steering), side * float(np.max(side * signal.x, initial=-np.inf)))
            for side in (1, -1)
        )
        if share > SHARE:
            text = (
                f"{channel} is clipped: it stays at {extreme:.4g} {signal.unit} for {100 * share:.1f} % of "
                f"the run while the steering moves, so the {sensor} reached its range; drive again with a "
                "smaller amplitude, or set a larger range of the sensor"
            )
            yield Note("warning", text, CLIPPED, (channel,))


def _clipped(signal: Signal, side: int, steering: Signal) -> float:
    """Share of the samples at the largest (side 1) or smallest value (-1) if clipped there, else 0."""
    x = side * signal.x
    levels = np.unique(x)
    if levels.size < MIN_VALUES:
        return 0.0
    top, at = levels[-1], x == levels[-1]
    near = levels[(levels < top) & (levels > top - NEAR * (top - levels[0]))]
    usual = np.sum((x < top) & (x > top - NEAR * (top - levels[0]))) / max(near.size, 1)
    stays = [stay for stay in stretches(at) if stay[1] > stay[0]]  # of two samples or more
    if len(stays) < MIN_STAYS or at.sum() < PILED_UP * max(usual, 1.0):
        return 0.0
    steps = [x[a - 1] - x[a - 2] for a, _ in stays if a > 1]
    if not steps or float(np.median(steps)) <= STEEP * float(np.min(np.diff(levels))):
        return 0.0  # a smooth maximum, not reached in large steps
    whole = float(np.ptp(steering.x)) if steering.x.size else 0.0
    held = (steering.between(signal.t[a], signal.t[b]).x for a, b in stays)
    moved = max((float(np.ptp(part)) for part in held if part.size), default=0.0)
    return float(np.mean(at)) if whole > 0 and moved > STEERED * whole else 0.0


# Reasons not to call a model good although it fits: errors that the data themselves cannot show.


# First words of the notes on an incomplete recording (logs.runs.completeness).
CUT = ("The recording ends before", "The recording begins after", "The recording has a hole", "A hole of")


def doubts(runs: Sequence[Recording]) -> Iterator[str]:
    """A sentence for each reason not to trust a good fit to these runs."""
    found = sorted({c for run in runs for c, low in run.filters.items() if low.source == ASSUMED})
    if found:  # 4 Hz assumed for none gave C = 24 instead of 32 N/rad, at J_ave 18
        yield (
            f"the low-pass of {', '.join(found)} was not recorded and the default value is assumed; if it "
            "was set otherwise, the parameters are wrong by tens of percent: give --gyro-filter and "
            "--accel-filter"
        )
    if all(any(note.text.startswith(CUT) for note in run.notes) for run in runs):
        # a sweep that ended at 9 rad/s gave Izz with an error of 12 %, at J_ave 1
        names = ", ".join(run.name for run in runs)
        yield f"no run was recorded completely ({names}), so some frequencies are missing: drive one again"


# Detects runs that are too short: too few periods of the lowest frequency that a fit needs.
#
# The windows adapt to a record of any length, so coherence and cost look good even for 4 s.


TOO_SHORT = "too short"
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
    return Note("warning", text, TOO_SHORT, ALL_CHANNELS)


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
    faults = [
        None if run.kind == "doublet" else others if run.kind == "other" else too_short([run]) for run in runs
    ]
    return tuple(_marked(run, fault) if fault else run for run, fault in zip(runs, faults, strict=True))


def _marked(run: Recording, fault: Note) -> Recording:
    return replace(run, notes=(*(n for n in run.notes if n.fault != TOO_SHORT), fault))


NO_EXCITATION = "no excitation"
OF_SETS = (TOO_SHORT, TWO_ROVERS)  # faults of several runs together
REPEATED = (CLIPPED, TOO_SHORT)  # faults that another run can avoid
OPTIONAL = {"p": "r,ay", "ay": "r,p"}  # {channel that a fit can leave out: value of --fit}


def faults_of(run: Recording) -> tuple[Note, ...]:
    """The faults of a run: those among its notes and those that its channels show."""
    return tuple(note for note in _found(run) if note.fault)


def _found(run: Recording) -> tuple[Note, ...]:
    """Faults and warnings, without repetitions."""
    found = [note for note in run.notes if note.fault]
    odd_clock = any(note.fault == STRETCHED for note in found)
    clipped = tuple(clipping(run))
    found += clipped
    if not odd_clock:  # else rates do not match angles
        seen = relations(run.without({c for fault in clipped for c in fault.spoils}))
        speed = run["speed"].x if "speed" in run else np.empty(0)
        given = (
            float(speed[0]) if speed.size and not np.ptp(speed) else None
        )  # a constant one is not recorded
        found += tuple(stretched_by_angles(seen)) or tuple(kinematics(seen, given))
    notes: dict[tuple[str, tuple[str, ...]], Note] = {}
    for note in found:
        notes.setdefault((note.fault, note.spoils), note)  # two clocks may show the same
    return tuple(notes.values())


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

    Contradictory runs stay if they are the majority, because then the file is wrong. All runs stay if none
    would be left to fit.
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
    fault = next(iter(faults_of(run)), None)
    if fault is None:
        return None
    action: Literal["repeat", "discard"] = "repeat" if fault.fault in REPEATED else "discard"
    return action, f"{action}: {_with_option(fault)}"
