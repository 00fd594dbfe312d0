"""Steering signals: intervals of activity, and the kind of wave (sweep, doublet, multisine)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rover_sweep.data.recording import Array, Kind, Note, Recording, Signal, stretches
from rover_sweep.errors import DataRefused
from rover_sweep.logs.applet import WAVE_STATES, applet_runs, ends, is_old, starts
from rover_sweep.logs.log import Log

ACTIVE_US, ACTIVE_RAD = 10.0, 0.01  # us, rad: smallest deviation from straight that is steering
CONSTANT = 0.2  # of that: noise of a receiver
FADE = 3.0  # s, longest fade of a wave
MOVING_SPEED, STANDING = 0.3, 0.1  # m/s
PAUSE = 5.0  # s without steering that end a run
SHORTEST_RUN = 4.0  # s
REVERSALS = 2  # fewest changes of side in a run
HALT = 1.0  # s, shortest halt that separates runs
HALF_WAVES = 6  # fewest half waves that show the kind of wave
TAIL = 8  # percentile that is taken as the extreme on each side
BIASED = 0.25  # of the amplitude: distance of the middle of a sweep from rest, above which it has a bias
REPEAT_EDGE, REPEAT_SHARE = 0.1, 0.6  # of a run: left out at both ends; the longest period, of what is left
REPEAT_STEP = 0.02  # s
REPEAT_CORRELATION = 0.98  # autocorrelation at one period; much less for driving by hand
ONE_LINE = 0.6  # of the power, in one spectral line of a sine
STEP = 0.05  # s, grid of the pulses
PULSE = 0.15  # of the amplitude: distance from rest at which a pulse begins
SHORTEST_PULSE = 0.35  # s; a shorter one is hardly flat
EQUAL, EDGE = 1.25, 0.15  # largest ratio of the two pulses of a doublet; s, what sampling adds to a length
FLAT, LEVEL = 0.5, 0.1  # share of a pulse within this part of its height around it; a sine has 0.2


def active_intervals(steering: Signal, speed: Signal) -> list[tuple[float, float]]:
    """Intervals (start, end) [s] in which the rover moves one way and is steered to both sides."""
    v = np.interp(steering.t, speed.t, speed.x, left=0.0, right=0.0)
    moving = np.abs(v) > MOVING_SPEED
    if moving.sum() < 2:
        return []
    straight = float(np.median(steering.x[moving]))
    active = moving & (np.abs(steering.x - straight) > active_threshold(steering))
    times = steering.t[active]
    if times.size == 0:
        return []
    t = steering.t
    stops = [t[a] for a, b in stretches(~moving) if t[min(b + 1, t.size - 1)] - t[a] >= HALT]
    halts = np.searchsorted(times, np.array(stops))
    turned = np.flatnonzero(np.diff(np.sign(v[active])) != 0) + 1
    cuts = np.union1d(np.union1d(np.flatnonzero(np.diff(times) > PAUSE) + 1, turned), halts)
    spans = [(float(part[0]), float(part[-1])) for part in np.split(times, cuts) if part.size]
    long = [(start, end) for start, end in spans if end - start >= SHORTEST_RUN]
    runs = [s for s in long if _crossings(steering.between(*s), straight).size >= REVERSALS]
    return [excitation(steering, start, end, straight) for start, end in runs]


def usual_way(speed: Signal) -> float:
    """-1 where the rover drives in reverse for most of the time that it moves, else 1."""
    driven = speed.x[np.abs(speed.x) > STANDING]
    return -1.0 if driven.size and np.median(driven) < 0 else 1.0


def excitation(steering: Signal, start: float, end: float, rest: float) -> tuple[float, float]:
    """(start, end) [s] from the last time at `rest` before the steering to the first time at rest after it.

    start, end [s]: where to search; the result is at most `FADE` outside.
    """
    away = np.abs(steering.x - rest)
    far = np.flatnonzero((away > active_threshold(steering)) & (steering.t >= start) & (steering.t <= end))
    if far.size == 0:
        return start, end
    at_rest = steering.t[away <= CONSTANT * active_threshold(steering)]
    first, last = float(steering.t[far[0]]), float(steering.t[far[-1]])
    before = at_rest[(at_rest < first) & (at_rest > first - FADE)]
    after = at_rest[(at_rest > last) & (at_rest < last + FADE)]
    return (float(before[-1]) if before.size else first), (float(after[0]) if after.size else last)


def active_threshold(steering: Signal) -> float:
    """Smallest deviation from straight counted as steering, in the signal's unit."""
    return ACTIVE_RAD if steering.unit == "rad" else ACTIVE_US


def _crossings(signal: Signal, level: float) -> Array:
    """Times (n,) [s] at which the signal crosses a level, with a hysteresis of a tenth of the amplitude."""
    x = signal.x - level
    far = np.abs(x) > 0.1 * np.max(np.abs(x), initial=0.0)
    t, sign = signal.t[far], np.sign(x[far])
    turn = np.flatnonzero(np.diff(sign) != 0)
    return (t[turn] + t[turn + 1]) / 2


def half_waves(steering: Signal) -> int:
    """Number of complete half waves of a steering signal about its middle."""
    if steering.x.size == 0:
        return 0
    middle = (np.min(steering.x) + np.max(steering.x)) / 2
    return max(_crossings(steering, float(middle)).size - 1, 0)


def kind_of(whole: Signal, start: float, end: float) -> Kind:
    """The kind of wave in start..end [s].

    'sweep' if the half periods decrease, 'bias_sweep' if its centre is also not the steering before it;
    'doublet' for pairs of equal and opposite pulses; 'multisine' if it is periodic but not a sine; else
    'other'.
    """
    steering = whole.between(start, end)
    if steering.t.size < 8 or np.ptp(steering.x) <= active_threshold(steering):
        return "other"
    rest = whole.x[max(int(np.searchsorted(whole.t, start)) - 1, 0)]
    if _is_doublet(steering, float(rest)):
        return "doublet"
    low, high = np.percentile(
        steering.x, (TAIL, 100 - TAIL)
    )  # excludes the fades from rest to a bias and back
    halves = np.diff(_crossings(steering, float(low + high) / 2))
    if halves.size < HALF_WAVES:
        return "other"
    third = halves.size // 3
    shrinks = np.median(halves[:third]) > 2 * np.median(halves[-third:])
    ranks = np.argsort(np.argsort(halves))  # Spearman's correlation of the half periods with their order
    if shrinks and np.corrcoef(ranks, np.arange(halves.size))[0, 1] < -0.6:
        return "sweep" if abs((low + high) / 2 - rest) < BIASED * (high - low) / 2 else "bias_sweep"
    return "multisine" if _repeats(steering) else "other"


def _repeats(steering: Signal) -> bool:
    """True when the signal is periodic with many half waves per period.

    In the middle of the run, without fades, the autocorrelation at the best period is close to 1.
    """
    fade = REPEAT_EDGE * (steering.t[-1] - steering.t[0])
    grid = np.arange(steering.t[0] + fade, steering.t[-1] - fade, REPEAT_STEP)
    x = steering.on(grid)
    shortest = (
        HALF_WAVES * (grid[-1] - grid[0]) / max(half_waves(steering), 1)
    )  # the period of a sine is shorter
    lags = np.arange(max(int(shortest / REPEAT_STEP), 1), int(REPEAT_SHARE * grid.size))
    correlations = [float(np.corrcoef(x[lag:], x[: x.size - lag])[0, 1]) for lag in lags]
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size))) ** 2
    peak = int(np.argmax(power))
    one_line = np.sum(power[max(peak - 2, 0) : peak + 3]) >= ONE_LINE * np.sum(power)
    return bool(correlations) and max(correlations) > REPEAT_CORRELATION and not one_line


def _is_doublet(steering: Signal, rest: float) -> bool:
    """True for one or more pairs of pulses, equal in length and height, the second to the other side.

    A driver who holds the stick makes pulses too, but not equal pairs throughout.
    """
    grid = np.arange(steering.t[0], steering.t[-1], STEP)
    if grid.size < 2:
        return False
    away = np.interp(grid, steering.t, steering.x) - rest
    if steering.hold:
        away = steering.x[np.searchsorted(steering.t, grid, "right") - 1] - rest
    side = np.sign(away) * (np.abs(away) > PULSE * np.max(np.abs(away)))
    parts = np.split(np.arange(grid.size), np.flatnonzero(np.diff(side)) + 1)
    # (start [s], distance from rest (n,) every `STEP`) of each time away from rest on one side
    pulses = [(float(grid[k[0]]), away[k]) for k in parts if side[k[0]] and k.size > 1]
    pairs = list(zip(pulses[::2], pulses[1::2], strict=False))
    return bool(pairs) and len(pulses) % 2 == 0 and all(_is_pair(*pair) for pair in pairs)


def _is_pair(first: tuple[float, Array], second: tuple[float, Array]) -> bool:
    """True where the second pulse (start [s], distance from rest (n,)) is the first one mirrored."""
    (begin, one), (turn, two) = first, second
    lengths = [STEP * one.size, STEP * two.size]
    heights = [float(np.median(one)), float(np.median(two))]
    flat = [np.mean(np.abs(x - h) < LEVEL * abs(h)) for x, h in zip((one, two), heights, strict=True)]
    return bool(
        heights[0] * heights[1] < 0
        and max(map(abs, heights)) < EQUAL * min(map(abs, heights))
        and SHORTEST_PULSE < max(lengths) < EQUAL * min(lengths) + EDGE
        and turn - begin < EQUAL * lengths[0] + EDGE
        and min(flat) > FLAT
    )


# Checks whether a recording holds the complete run: by the applet's messages, else by the steering.


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
    begun = [s for s in starts(log) if s < end]
    announced = bool(begun) and not any(begun[-1] < t < start for t in ends(log))
    if (reason := _cut_before(steering, rest, start)) and not announced:
        notes.append(Note("warning", f"{reason} Only the part after it is used"))
    return tuple(notes)


def _cut_after(log: Log, steering: Signal, rest: float, start: float, end: float) -> str:
    """A sentence when the run continued after `end` [s], else ""."""
    last = min(s.t[-1] for s in (steering, log.signals["speed"], log.signals["r"]))
    if last < end - HOLE:
        return f"The recording ends before the end of the run: speed or yaw rate end at {last:.1f} s."
    if any(start < t for t in ends(log) if not any(end < s < t for s in starts(log))):
        return ""  # the applet announced the end between this run and the next
    for rows in applet_runs(log.applet) if log.applet is not None else ():
        if not is_old(rows) and rows.t[0] <= end and rows.t[-1] >= start:
            if (state := int(rows.state[-1])) in WAVE_STATES:
                ended = f"the last state is {state}, at {end:.1f} s"
                return f"The recording ends before the end of the run: {ended}."
            break
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


# Excitation of any shape: driving in which the steering's spectrum carries enough to identify from.
#
# A step, a sine, or a trial of two seconds has no shape that repeats. It is excitation where the steering,
# without its mean and drift, moves by more than the smallest steering. Whether the trials together cover a
# band is judged from their coherence (`quality.coherence`).


SHORTEST_TRIAL = 1.5  # s
WHOLE = 0.6  # of the trial
SLOW_SHARE = 0.5  # of the usual speed of a drive, where that is low: above it the rover moves
STEERING_STEP = 0.02  # s, grid of the steering
CARRIED = 0.3  # of the smallest steering: rms of the steering without mean and drift


def carried_intervals(log: Log) -> list[tuple[float, float]]:
    """Intervals (start, end) [s] of driving without a halt, with enough steering to identify from.

    One shorter than `SHORTEST_RUN` counts only if it is most of the recording. Driving against the main
    direction is skipped.
    """
    speed, steering = log.signals["speed"], log.steering[0]
    least = min(SHORTEST_RUN, WHOLE * float(steering.t[-1] - steering.t[0])) if steering.t.size else 0.0
    ahead = usual_way(speed) * speed.x
    usual = float(np.percentile(ahead[ahead > 0], 75)) if np.any(ahead > 0) else 0.0
    moving = speed.t[ahead > min(MOVING_SPEED, SLOW_SHARE * usual)]
    times: Array = moving[(moving >= steering.t[0]) & (moving <= steering.t[-1])]
    if times.size < 2:
        return []
    parts = np.split(times, np.flatnonzero(np.diff(times) > HALT) + 1)
    drives = [(float(part[0]), float(part[-1])) for part in parts]
    long = [(a, b) for a, b in drives if b - a >= max(least, SHORTEST_TRIAL)]
    return [(a, b) for a, b in long if carries(steering.between(a, b), a, b)]


def carries(steering: Signal, start: float, end: float) -> bool:
    """True when the steering in start..end [s], without mean and drift, is more than a receiver's noise."""
    grid = np.arange(start, end, STEERING_STEP)
    if grid.size < SHORTEST_TRIAL / STEERING_STEP or steering.t.size < 2:
        return False
    x = steering.on(grid)
    rest = x - np.polyval(np.polyfit(grid - start, x, 1), grid - start)
    threshold = active_threshold(steering)
    return bool(np.ptp(x) > threshold and np.sqrt(np.mean(rest**2)) > CARRIED * threshold)
