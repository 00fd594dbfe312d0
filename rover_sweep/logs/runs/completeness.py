"""Checks whether a recording holds the complete run: by the applet's messages, else by the steering."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rover_sweep.data.recording import Kind, Note, Recording, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Log
from rover_sweep.logs.runs.applet import WAVE_STATES, applet_runs, ends, is_old, starts
from rover_sweep.logs.runs.wave import CONSTANT, HALF_WAVES, active_threshold, half_waves

HOLE = 1.0  # s without a sample
MAX_NOTES = 3  # holes with a note of their own


def completeness_notes(log: Log, start: float, end: float) -> tuple[Note, ...]:
    """Warnings when the recording begins after, or ends before, the run with its wave in start..end [s]."""
    if log.whole:
        return ()
    steering = log.steering[0]
    rest = float(np.median(steering.between(start, end).x))
    notes = []
    if reason := _cut_after(log, steering, rest, start, end):
        notes.append(Note("warning", f"{reason} Only the part before it is used; drive the run again"))
    if (reason := _cut_before(steering, rest, start)) and not _start_was_announced(log, start, end):
        notes.append(Note("warning", f"{reason} Only the part after it is used"))
    return tuple(notes)


def _end_was_announced(log: Log, start: float, end: float) -> bool:
    """True when the applet announced the end (done or stopped) between this run and the next."""
    return any(start < t for t in ends(log) if not any(end < s < t for s in starts(log)))


def _start_was_announced(log: Log, start: float, end: float) -> bool:
    begun = [s for s in starts(log) if s < end]
    return bool(begun) and not any(begun[-1] < t < start for t in ends(log))


def _cut_after(log: Log, steering: Signal, rest: float, start: float, end: float) -> str:
    """A sentence when the run continued after `end` [s], else ""."""
    last = min(s.t[-1] for s in (steering, log.signals["speed"], log.signals["r"]))
    if last < end - HOLE:
        return f"The recording ends before the end of the run: speed or yaw rate end at {last:.1f} s."
    if _end_was_announced(log, start, end):
        return ""
    state = _last_state(log, start, end)
    if state in WAVE_STATES:
        return f"The recording ends before the end of the run: the last state is {state}, at {end:.1f} s."
    begun = any(s <= end for s in starts(log))
    stop = _edge(steering, end, 1)
    away = _is_away(steering, stop, rest)
    if stop + 1 < steering.t.size and steering.t[stop] < end + HOLE:
        hole = float(steering.t[stop + 1] - steering.t[stop])
        if hole > HOLE and (away or _is_away(steering, stop + 1, rest)):
            at = f"{hole:.1f} s at {steering.t[stop]:.1f} s"
            return f"The recording has a hole of {at}, before the end of the run."
    if end > last - HOLE and (begun or away):
        unannounced = ", and the applet did not announce the end of the run" if begun else ""
        return f"The recording ends before the end of the run: it ends at {last:.1f} s{unannounced}."
    return ""


def _cut_before(steering: Signal, rest: float, start: float) -> str:
    first = _edge(steering, start, -1)
    if steering.t[first] < start - HOLE:
        return ""
    away = _is_away(steering, first, rest)
    if first == 0:
        reason = f"The recording begins after the start of the run: it steers at its start, {start:.1f} s."
        return reason if away else ""
    hole = float(steering.t[first] - steering.t[first - 1])
    if hole > HOLE and (away or _is_away(steering, first - 1, rest)):
        return f"The recording has a hole of {hole:.1f} s before {steering.t[first]:.1f} s, in the run."
    return ""


def _edge(steering: Signal, at: float, direction: int) -> int:
    """Index of the last sample before a hole or the end, at most about `HOLE` s from `at` [s]."""
    t = steering.t
    k = int(np.clip(np.searchsorted(t, at, "left"), 0, t.size - 1))
    if direction > 0 and t[k] > at and k > 0:
        k -= 1
    while 0 <= k + direction < t.size and abs(t[k + direction] - t[k]) <= HOLE and abs(t[k] - at) < HOLE:
        k += direction
    return k


def _is_away(steering: Signal, k: int, rest: float) -> bool:
    return bool(abs(steering.x[k] - rest) > CONSTANT * active_threshold(steering))


def _last_state(log: Log, start: float, end: float) -> int | None:
    """The last state that the applet logged in the run, None without states."""
    for rows in applet_runs(log.applet) if log.applet is not None else ():
        if not is_old(rows) and rows.t[0] <= end and rows.t[-1] >= start:
            return int(rows.state[-1])
    return None


def refuse_fragment(log: Log, name: str, kind: Kind, start: float, end: float) -> None:
    """Raise DataRefused for an applet run that was cut too early to be useful.

    Short pieces of driving by hand are kept, as they are never complete.
    """
    waves = half_waves(log.steering[0].between(start, end))
    by_applet = log.applet is not None or bool(starts(log))
    if by_applet and kind == "other" and waves < HALF_WAVES and completeness_notes(log, start, end):
        raise DataRefused(
            f"{name}: only {end - start:.0f} s of the run were recorded, with {waves} half waves of "
            "steering; this is too short to identify anything, so drive it again and record it to its end"
        )


def hole_notes(run: Recording) -> Iterator[Note]:
    """Warnings of holes of more than a second within the run, the longest first."""
    found: dict[tuple[float, float], list[str]] = {}
    for name in ("r", "ay", "p", "vy", "speed", "pwm", "delta"):
        if name in run and not (name == "pwm" and "delta" in run):
            t = run.manoeuvre(name).t
            steps = np.diff(t)
            for k in np.flatnonzero(steps > max(HOLE, 3 * float(np.median(steps)) if steps.size else HOLE)):
                found.setdefault((round(float(t[k]), 1), round(float(steps[k]), 1)), []).append(name)
    longest = sorted(found, key=lambda place: -place[1])
    for at, length in longest[:MAX_NOTES]:
        yield Note("warning", f"A hole of {length:.1f} s at {at:.1f} s in {', '.join(found[at, length])}")
    if len(longest) > MAX_NOTES:
        yield Note("warning", f"{len(longest) - MAX_NOTES} further holes of more than {HOLE:.0f} s")
