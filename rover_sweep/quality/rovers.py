"""Detects runs of different rovers, from the vehicle data in the logs and from the responses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from math import log

import numpy as np

from rover_sweep.data.recording import Note, Recording, stretches
from rover_sweep.quality.relations import (
    ALL_CHANNELS,
    AnswerDifference,
    Fingerprint,
    difference_of,
    fingerprint,
    gain_ratio,
)

TWO_ROVERS = "two rovers"
WIDE = ("sweep", "multisine")  # kinds that excite all bands
SAME_SPEED, NEAR_SPEED = 0.06, 0.2  # relative
SAME_AMPLITUDE = 0.3  # relative; above it, nonlinear effects make responses differ
# Thresholds of lean and yaw, at the same and at another speed or amplitude. Runs of one rover at one speed
# and amplitude differ by up to .04. A surface or saturated tyres change yaw only (.17 between amplitudes),
# dry friction in the suspension lean only (.31). Both together: at most .084 and .069 in 35 sets of runs.
SAME, OTHER = (0.08, 0.07), (0.14, 0.12)
BY_SPEED = 0.45  # |ln| of the yaw ratio per |ln| of the speed ratio: tyres and delay, at most .47 in 35 sets
GAIN = 0.22  # |ln| of the steady yaw gain's ratio at one speed and amplitude, which the tyres hardly change
OPPOSITE = 1.0  # of the yaw rate per steering; the other sign is pi
SIGNIFICANT = 3.0  # random errors
ASSUMED = "assumed"  # word in the source of a low-pass that is not in the log
CERTAIN = ("board", "system id")  # keys of the log that identify a vehicle; the others can be changed


def with_rovers(runs: Sequence[Recording]) -> tuple[Recording, ...]:
    """The runs; a run of another rover than an earlier one gets a fault."""
    faults: dict[int, Note] = {}
    input = "pwm" if all("pwm" in run for run in runs) else "delta"
    prints = {i: fingerprint(r, input) for i, r in enumerate(runs) if input in r and _comparable(r)}
    for i, k in combinations(range(len(runs)), 2):
        one, two = runs[i].vehicle, runs[k].vehicle
        other = {
            key: f"{key} {one[key]} and {two[key]}" for key in one if key in two and one[key] != two[key]
        }
        why = "; ".join(other[key] for key in CERTAIN if key in other)
        if not why and i in prints and k in prints:
            why = _by_responses(prints[i], prints[k])
            why += f"; {', '.join([*other.values()][:4])}" if why and other else ""
        if why and k not in faults:
            text = (
                f"{runs[i].name} and {runs[k].name} are not from the same rover, or it was changed between "
                f"them: {why}; give runs of one rover only"
            )
            faults[k] = Note("warning", text, TWO_ROVERS, ALL_CHANNELS)
    marked = {i for i, run in enumerate(runs) if any(note.fault == TWO_ROVERS for note in run.notes)}
    return tuple(
        replace(run, notes=(*run.notes, faults[i])) if i in faults and i not in marked else run
        for i, run in enumerate(runs)
    )


def _comparable(run: Recording) -> bool:
    """True when all bands were excited and the low-passes of the sensors are known."""
    return run.kind in WIDE and "r" in run and not any(ASSUMED in f.source for f in run.filters.values())


def _by_responses(one: Fingerprint, two: Fingerprint) -> str:
    """Why two runs cannot be of one rover, '' if they can."""
    faster = max(one.speed / two.speed, two.speed / one.speed)
    if not 0 < faster <= 1 + NEAR_SPEED:  # below 0: one of them in reverse, where the other axle steers
        return ""
    louder = max(one.amplitude / two.amplitude, two.amplitude / one.amplitude)
    same = louder < 1 + SAME_AMPLITUDE and faster < 1 + SAME_SPEED
    least_lean, least_yaw = SAME if same else (OTHER[0], OTHER[1] + BY_SPEED * log(faster))
    lean, yaw = difference_of(one.lean, two.lean), difference_of(one.yaw, two.yaw)
    speeds = f"at {one.speed:.3g} and {two.speed:.3g} m/s"
    if _exceeds(lean, least_lean) and _exceeds(yaw, least_yaw):
        return (
            f"{speeds} their roll for the same a_y differs by {_percent(lean)} and their path for the same "
            f"steering by {_percent(yaw)}, which another surface cannot cause"
        )
    if same and _exceeds(yaw, OPPOSITE):
        return (
            f"{speeds} and one amplitude their yaw rate for the same steering differs by {_percent(yaw)}, as "
            "with the other sign of the steering or another linkage"
        )
    gain = gain_ratio(one.yaw, two.yaw) if same else None
    if _exceeds(gain, GAIN):
        return (
            f"{speeds} and the same amplitude their yaw rate at low frequency for the same steering differs "
            f"by {_percent(gain)}, which only another wheelbase or linkage explains"
        )
    return ""


def _exceeds(found: AnswerDifference | None, least: float) -> bool:
    return found is not None and found.difference > max(least, SIGNIFICANT * found.error)


def _percent(found: AnswerDifference | None) -> str:
    return f"{100 * found.difference:.0f} %" if found else ""


# Detects steering at its end stops, and limits commands to a known stop.


AT_STOP = 0.005  # of the largest angle
STAYS = 3  # separate stays at each end
SHARE = 0.02  # of the run at each end
MIN_VALUES = 30  # distinct angles; steps between a few are commanded, not limited
LIMITED = 0.01  # of the largest angle, by which commands must exceed a stop to be reported


def at_both_stops(run: Recording) -> Iterator[Note]:
    """A warning for steering that stays at equal largest angles to both sides, as at its end stops.

    Only for tables: an autopilot's log has the limits of its servo.
    """
    if "delta" not in run or not (x := run.manoeuvre("delta").x).size:
        return
    most = float(np.max(np.abs(x)))
    if np.unique(x).size < MIN_VALUES or most == 0.0:
        return
    ends = [side * x > (1 - AT_STOP) * most for side in (1, -1)]
    if all(np.mean(end) > SHARE and len(stretches(end)) >= STAYS for end in ends):
        share = 100 * float(np.mean(ends[0] | ends[1]))
        text = (
            f"the steering is at {most:.3g} rad to either side in {share:.0f} % of the run, probably its "
            "end stops: the gain there is not that of small angles; keep below, and give max_steering_angle "
            "in the vehicle file if commands may exceed it"
        )
        yield Note("warning", text)


def stopped_at(run: Recording, stop: float) -> Recording:
    """The run with `delta` limited to `stop` [rad] to either side, and a note where that changes it."""
    delta = run["delta"]
    beyond = np.abs(run.manoeuvre("delta").x) > (1 + LIMITED) * stop
    if not np.any(np.abs(delta.x) > stop):
        return run
    limited = replace(delta, x=np.clip(delta.x, -stop, stop))
    share = 100 * float(np.mean(beyond))
    text = (
        f"the command is beyond max_steering_angle, {stop:.3g} rad, in {share:.0f} % of the run; the wheels "
        "are assumed to be at their stop there"
    )
    notes = (*run.notes, Note("info", text)) if beyond.any() else run.notes
    return replace(run, channels={**run.channels, "delta": limited}, notes=notes)
