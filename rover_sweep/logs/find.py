"""Finds the runs in a log, their kind of wave, and intervals of standstill and straight driving."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array, Kind, Mask, Note, Recording, Signal, stretches
from rover_sweep.errors import DataRefused
from rover_sweep.logs.applet import (
    OVERRIDE_STATES,
    STOPPED,
    WAVE_STATES,
    announced_kind,
    applet_runs,
    ends,
    identity,
    is_old,
    starts,
    stop_reason,
)
from rover_sweep.logs.log import Log, limits_of_steering
from rover_sweep.logs.readers.screening import without_dead_channels
from rover_sweep.logs.readers.vehicle_clock import at_main_loops
from rover_sweep.logs.wave import (
    CONSTANT,
    HALF_WAVES,
    active_intervals,
    active_threshold,
    carried_intervals,
    completeness_notes,
    excitation,
    half_waves,
    kind_of,
    refuse_fragment,
    usual_way,
)

Interval = tuple[float, float]

LEAD = 3.0  # s, most straight driving kept before and after the excitation
SETTLING = 1.0  # s after the excitation, in which the response decays
TOUCHING = SETTLING + 0.5  # s, largest gap between the excitation and its straight driving
CELL = 0.05  # s, grid of the search for intervals
STILL_SPEED = 0.1  # m/s
STILL_GYRO = 0.03  # rad/s rms within a second, about its mean: above the noise of any gyro, below any motion
HOLE = 5.0  # s without a recorded speed; intervals end there
MOST = 0.5  # of the driving, found by its shape
SHORTEST = 1.0  # s, shortest interval for a bias
SAME_SPEED = 0.15  # of the run's speed

LONGEST_HOLE = 60.0  # s without steering samples; after it another run begins


@dataclass(frozen=True)
class Window:
    """The excitation of a run, start..end [s], and the limits of its recording, earliest..latest [s].

    shapeless: found by its spectrum alone, so it has no kind.
    """

    start: float
    end: float
    earliest: float = -np.inf
    latest: float = np.inf
    label: str = ""
    notes: tuple[Note, ...] = ()
    shapeless: bool = False


def find_runs(log: Log) -> tuple[Recording, ...]:
    """All runs of a log with steering, speed and yaw rate; empty without excitation.

    DataRefused when there are runs but none can be used.
    """
    windows = _windows(log)
    standstill = still_intervals(log)
    runs: list[Recording] = []
    refusals: list[DataRefused] = []
    for window in windows:
        try:
            runs.append(without_dead_channels(_recording(log, window, standstill, len(windows))))
        except DataRefused as refusal:  # of one run; others may be usable
            refusals.append(refusal)
    if refusals and not runs:
        raise refusals[0]
    unused = tuple(Note("warning", f"Another run was left out: {refusal}") for refusal in refusals)
    return tuple(replace(run, notes=run.notes + unused) for run in runs)


def _windows(log: Log) -> list[Window]:
    """Excitations by the applet's states, else by its messages, else by steering activity in motion."""
    if log.whole:
        return _whole(log)
    found = list(_by_applet(log)) or list(_by_marks(log)) or _by_shape_or_spectrum(log)
    found = [part for w in found for part in _without_holes(log, w) if _is_excited(log, part)]
    begins, stops = [-np.inf, *(w.end for w in found)], [*(w.start for w in found[1:]), np.inf]
    return [
        replace(w, earliest=max(w.earliest, a), latest=min(w.latest, b))
        for w, a, b in zip(found, begins, stops, strict=False)
    ]


def _whole(log: Log) -> list[Window]:
    """One window, from the first to the last time at the median speed."""
    speed = log.signals["speed"]
    driving = np.abs(speed.x) > STILL_SPEED
    usual = float(np.median(speed.x[driving])) if driving.any() else np.inf
    at_speed = speed.t[speed.x * np.sign(usual) > (1 - SAME_SPEED) * abs(usual)]
    return [Window(float(at_speed[0]), float(at_speed[-1]))] if at_speed.size else []


def _without_holes(log: Log, w: Window) -> list[Window]:
    """The parts of a window between holes in the steering that are longer than a minute."""
    t = log.steering[0].between(w.start, w.end).t
    cuts = np.flatnonzero(np.diff(t) > LONGEST_HOLE)
    begins, stops = [w.start, *t[cuts + 1].tolist()], [*t[cuts].tolist(), w.end]
    return [replace(w, start=a, end=b) for a, b in zip(begins, stops, strict=True)]


def _is_excited(log: Log, w: Window) -> bool:
    """True when the rover moves and is steered within the window."""
    speed, steering = log.signals["speed"].between(w.start, w.end).x, log.steering[0].between(w.start, w.end)
    if speed.size == 0 or steering.t.size < 2 or abs(float(np.median(speed))) < STILL_SPEED:
        return False
    return bool(np.ptp(steering.x) > active_threshold(steering))


def _by_applet(log: Log) -> Iterator[Window]:
    for rows in applet_runs(log.applet) if log.applet is not None else ():
        label, waving = f"run {rows.run[0]:.0f}", np.isin(rows.state, list(WAVE_STATES))
        if is_old(rows):
            yield Window(rows.t[0], rows.t[-1], label=label)
        elif waving.any():
            override = rows.t[np.isin(rows.state, list(OVERRIDE_STATES))]
            start, end = rows.t[waving][0], rows.t[waving][-1]
            stopped = rows.t[(rows.state == STOPPED) & (rows.t > end)]
            notes = tuple(
                Note("warning", f"The applet stopped this run at {at - start:.1f} s ({stop_reason(log, at)})")
                for at in stopped[:1].tolist()
            )
            yield Window(start, end, override[0], override[-1], label, notes)


def _by_marks(log: Log) -> Iterator[Window]:
    """The steering activity from "start" to "done" or "stop"; without an end, the first activity."""
    steering, begun = log.steering[0], starts(log)
    active = active_intervals(steering, log.signals["speed"]) if begun else []
    for i, start in enumerate(begun):
        latest = begun[i + 1] if i + 1 < len(begun) else np.inf
        done = next((t for t in ends(log) if start < t <= latest), None)
        if done is not None:
            rest = steering.x[max(int(np.searchsorted(steering.t, start, "right")) - 1, 0)]
            first, last = excitation(steering, start, done, float(rest))
            yield Window(first, last, label=f"run {i + 1}")
            continue
        for first, last in [(a, b) for a, b in active if start - SETTLING < a < latest][:1]:
            yield Window(first, min(last, latest), label=f"run {i + 1}")


def _by_shape_or_spectrum(log: Log) -> list[Window]:
    """Steering that alternates; in a table without a manoeuvre, where that is only a part, all that carries.

    An autopilot's log has its manoeuvres.
    """
    steering, speed = log.steering[0], log.signals["speed"]
    way = usual_way(speed)
    active = [
        (a, b)
        for a, b in active_intervals(steering, speed)
        # the other way is manoeuvring, except where it has the shape of a run
        if way * float(np.median(speed.between(a, b).x)) > 0 or kind_of(steering, a, b) != "other"
    ]
    found = [Window(a, b, label=f"run {i + 1}") for i, (a, b) in enumerate(active)]
    if log.applet is not None or log.parameters or log.marks:
        return found
    carried = carried_intervals(log)
    covered = sum(w.end - w.start for w in found) > MOST * sum(b - a for a, b in carried)
    if covered or any(kind_of(log.steering[0], w.start, w.end) != "other" for w in found):
        return found
    return [Window(a, b, label=f"run {i + 1}", shapeless=True) for i, (a, b) in enumerate(carried)]


def _recording(log: Log, window: Window, standstill: tuple[Interval, ...], count: int) -> Recording:
    steering = log.steering[0]
    channel = "delta" if steering.unit == "rad" else "pwm"
    signals = {channel: at_main_loops(steering, log.loops), **log.signals}
    first = max(s.t[0] for s in signals.values() if s.t.size)
    last = min(s.t[-1] for s in signals.values() if s.t.size)
    kind: Kind = "other" if window.shapeless else kind_of(steering, window.start, window.end)
    if half_waves(steering.between(window.start, window.end)) >= HALF_WAVES:
        kind = announced_kind(log, window.start) or kind
    name = f"{log.name} {window.label}" if count > 1 else log.name
    refuse_fragment(log, name, kind, window.start, window.end)
    straight = straight_intervals(log, window)
    # the excitation and up to `LEAD` s of straight driving before and after it
    before = [a for a, b in straight if window.start - TOUCHING < b <= window.start + CELL]
    after = [b for a, b in straight if window.end - CELL <= a < window.end + TOUCHING]
    start = max(before[-1], window.start - LEAD) if before else window.start
    end = min(after[0], window.end + LEAD) if after else window.end
    cuts = completeness_notes(log, window.start, window.end)
    if kind == "other" and not (log.parameters or log.marks or log.applet is not None):
        cuts = tuple(
            note for note in cuts if "has a hole" in note.text
        )  # driving without a shape, in a table
    return Recording(
        name=name,
        channels=signals,
        span=(float(max(start, first)), float(min(end, last))),
        kind=kind,
        standstill=standstill,
        straight=straight,
        filters=log.filters,
        notes=(*log.notes, *window.notes, *cuts),
        firmware=log.firmware,
        sources=log.sources,
        vehicle=identity(log),
        limits=limits_of_steering(log.parameters),
    )


def still_intervals(log: Log) -> tuple[Interval, ...]:
    """Intervals (start, end) [s] in the log with a speed below 0.1 m/s and quiet gyros."""
    grid, speed = _grid(log.signals["speed"])
    if grid.size == 0:
        return ()
    still = np.abs(speed) < STILL_SPEED
    for name in {"r", "p"} & set(log.signals):
        still &= _rms(log.signals[name], grid) < STILL_GYRO
    return _intervals(grid, still)


def straight_intervals(log: Log, window: Window) -> tuple[Interval, ...]:
    """Intervals (start, end) [s] with the run's speed and constant steering, before and after the run."""
    grid, speed = _grid(log.signals["speed"])
    steering = log.steering[0]
    run_speed = float(np.median(log.signals["speed"].between(window.start, window.end).x))
    outside = (grid < window.start) | (grid > window.end + SETTLING)
    outside &= (grid > window.earliest) & (grid < window.latest)
    outside &= np.abs(speed - run_speed) < SAME_SPEED * abs(run_speed)
    if not np.any(outside):
        return ()
    value = steering.x[np.clip(np.searchsorted(steering.t, grid, "right") - 1, 0, steering.t.size - 1)]
    tolerance = CONSTANT * active_threshold(steering)
    return _intervals(grid, outside & (np.abs(value - np.median(value[outside])) <= tolerance))


def _grid(speed: Signal) -> tuple[Array, Array]:
    """Times (n,) [s] every `CELL` where the speed was recorded, and the speed (n,) there."""
    if speed.t.size < 2:
        return np.empty(0), np.empty(0)
    cuts = np.flatnonzero(np.diff(speed.t) > HOLE) + 1
    parts = [np.arange(part[0], part[-1], CELL) for part in np.split(speed.t, cuts)]
    grid = np.concatenate(parts)
    return grid, np.interp(grid, speed.t, speed.x)


def _rms(signal: Signal, grid: Array) -> Array:
    """Rms (n,) about the mean in the second around each grid time; infinite without samples."""
    sums = [np.concatenate(([0.0], np.cumsum(signal.x**power))) for power in (1, 2)]
    lo, hi = np.searchsorted(signal.t, grid - 0.5), np.searchsorted(signal.t, grid + 0.5)
    n = np.maximum(hi - lo, 1)
    mean, square = ((s[hi] - s[lo]) / n for s in sums)
    return np.where(hi > lo, np.sqrt(np.maximum(square - mean**2, 0.0)), np.inf)


def _intervals(grid: Array, holds: Mask) -> tuple[Interval, ...]:
    """Intervals (start, end) [s] of at least a second in which the mask `holds` (n,) is true."""
    parts = np.split(np.arange(grid.size), np.flatnonzero(np.diff(grid) > HOLE) + 1)
    found = []
    for k in parts:
        found += [(float(grid[k[a]]), float(grid[k[b]])) for a, b in stretches(holds[k])]
    return tuple((a, b) for a, b in found if b - a >= SHORTEST)
