"""Detects steering at its end stops, and limits commands to a known stop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import Note, Recording, Signal

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
    if all(np.mean(end) > SHARE and _stays(end) >= STAYS for end in ends):
        share = 100 * float(np.mean(ends[0] | ends[1]))
        text = (
            f"the steering is at {most:.3g} rad to either side in {share:.0f} % of the run, probably its "
            "end stops: the gain there is not that of small angles; keep below, and give max_steering_angle "
            "in the vehicle file if commands may exceed it"
        )
        yield Note("warning", text)


def _stays(at: np.ndarray) -> int:
    """Number of separate stays."""
    return int(np.sum(np.diff(np.concatenate(([0], at.astype(np.int8)))) == 1))


def stopped_at(run: Recording, stop: float) -> Recording:
    """The run with `delta` limited to `stop` [rad] to either side, and a note where that changes it."""
    delta = run["delta"]
    beyond = np.abs(run.manoeuvre("delta").x) > (1 + LIMITED) * stop
    if not np.any(np.abs(delta.x) > stop):
        return run
    limited = Signal(delta.t, np.clip(delta.x, -stop, stop), delta.unit, delta.source, delta.hold)
    share = 100 * float(np.mean(beyond))
    text = (
        f"the command is beyond max_steering_angle, {stop:.3g} rad, in {share:.0f} % of the run; the wheels "
        "are taken to stay at their stop there"
    )
    notes = (*run.notes, Note("info", text)) if beyond.any() else run.notes
    return replace(run, channels={**run.channels, "delta": limited}, notes=notes)
