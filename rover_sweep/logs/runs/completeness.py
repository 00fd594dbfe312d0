"""Does a recording hold the whole run? By the applet's own words, else by where the steering stands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rover_sweep.data.recording import Kind, Note, Recording, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Log
from rover_sweep.logs.runs.applet import WAVE_STATES, applet_runs, ends, is_old, starts
from rover_sweep.logs.runs.wave import CONSTANT, HALF_WAVES, active_threshold, half_waves

HOLE = 1.0  # s without a sample
TOLD = 3  # holes told one by one


def completeness_notes(log: Log, start: float, end: float) -> tuple[Note, ...]:
    """Warnings where the recording begins after, or ends before, the run whose wave spans start..end [s]."""
    if log.whole:
        return ()
    steering = log.steering[0]
    rest = float(np.median(steering.between(start, end).x))
    notes = []
    if seen := _cut_after(log, steering, rest, start, end):
        notes.append(Note("warning", f"{seen} The run is judged and fitted up to there only; drive it again"))
    if (seen := _cut_before(steering, rest, start)) and not _is_told_started(log, start, end):
        notes.append(Note("warning", f"{seen} The run is judged and fitted from there only"))
    return tuple(notes)


def _is_told_complete(log: Log, start: float, end: float) -> bool:
    """Whether the applet said that it was done (or had stopped) between this run and the next."""
    return any(start < t for t in ends(log) if not any(end < s < t for s in starts(log)))


def _is_told_started(log: Log, start: float, end: float) -> bool:
    begun = [s for s in starts(log) if s < end]
    return bool(begun) and not any(begun[-1] < t < start for t in ends(log))


def _cut_after(log: Log, steering: Signal, rest: float, start: float, end: float) -> str:
    """What tells that the run went on after `end`, "" where nothing does."""
    last = min(s.t[-1] for s in (steering, log.signals["speed"], log.signals["r"]))
    if last < end - HOLE:
        return f"The recording ends before the run did: speed or yaw rate stop at {last:.1f} s."
    if _is_told_complete(log, start, end):
        return ""
    state = _last_state(log, start, end)
    if state in WAVE_STATES:
        return f"The recording ends before the run did: the applet's last state, at {end:.1f} s, is {state}."
    begun = any(s <= end for s in starts(log))
    stop = _edge(steering, end, 1)
    away = _is_away(steering, stop, rest)
    if stop + 1 < steering.t.size and steering.t[stop] < end + HOLE:
        hole = float(steering.t[stop + 1] - steering.t[stop])
        if hole > HOLE and (away or _is_away(steering, stop + 1, rest)):
            at = f"{hole:.1f} s at {steering.t[stop]:.1f} s"
            return f"The recording has a hole of {at}, before the run was over."
    if end > last - HOLE and (begun or away):
        unsaid = ", and the applet did not say that it was done" if begun else ""
        return f"The recording ends before the run did: it stops at {last:.1f} s{unsaid}."
    return ""


def _cut_before(steering: Signal, rest: float, start: float) -> str:
    first = _edge(steering, start, -1)
    if steering.t[first] < start - HOLE:
        return ""
    away = _is_away(steering, first, rest)
    if first == 0:
        seen = f"The recording begins after the run did: it steers from the first sample, at {start:.1f} s."
        return seen if away else ""
    hole = float(steering.t[first] - steering.t[first - 1])
    if hole > HOLE and (away or _is_away(steering, first - 1, rest)):
        return f"The recording has a hole of {hole:.1f} s before {steering.t[first]:.1f} s, in the run."
    return ""


def _edge(steering: Signal, at: float, direction: int) -> int:
    """The sample beyond `at` [s] that a hole or the end of the recording follows, or one after `HOLE` s."""
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
    """The last state that the applet logged of the run, None where it logs none."""
    for rows in applet_runs(log.applet) if log.applet is not None else ():
        if not is_old(rows) and rows.t[0] <= end and rows.t[-1] >= start:
            return int(rows.state[-1])
    return None


def refuse_stump(log: Log, name: str, kind: Kind, start: float, end: float) -> None:
    """Raise DataRefused for a run of the applet that was cut so early that it holds hardly a frequency.

    Driving by hand is never whole, so a short piece of it is kept.
    """
    waves = half_waves(log.steering[0].between(start, end))
    by_applet = log.applet is not None or bool(starts(log))
    if by_applet and kind == "other" and waves < HALF_WAVES and completeness_notes(log, start, end):
        raise DataRefused(
            f"{name}: only {end - start:.0f} s of a run are there, with {waves} half waves of steering; "
            "nothing can be identified from that, so drive it again and record it to its end"
        )


def hole_notes(run: Recording) -> Iterator[Note]:
    """Where nothing was recorded for more than a second within the run, of the longest holes."""
    found: dict[tuple[float, float], list[str]] = {}
    for name in ("r", "ay", "p", "vy", "speed", "pwm", "delta"):
        if name in run and not (name == "pwm" and "delta" in run):
            t = run.manoeuvre(name).t
            steps = np.diff(t)
            for k in np.flatnonzero(steps > max(HOLE, 3 * float(np.median(steps)) if steps.size else HOLE)):
                found.setdefault((round(float(t[k]), 1), round(float(steps[k]), 1)), []).append(name)
    longest = sorted(found, key=lambda place: -place[1])
    for at, length in longest[:TOLD]:
        yield Note("warning", f"A hole of {length:.1f} s at {at:.1f} s in {', '.join(found[at, length])}")
    if len(longest) > TOLD:
        yield Note("warning", f"{len(longest) - TOLD} further holes of more than {HOLE:.0f} s")
