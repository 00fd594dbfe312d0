"""Time-stamps commands at the main loop that applied them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import AT_LOOP, Signal
from rover_sweep.logs.log import Array

MOST_DROPPED = 10  # consecutive loops without their message; more are a hole
SAME_RATE = 0.05  # relative tolerance of the rate of the stamps around SCHED_LOOP_RATE


def main_loops(stamps: Array, parameters: Mapping[str, float]) -> Array | None:
    """Starts (n,) [s] of the main loops, from the stamps of a message that each loop logs.

    None when the message was logged at another rate than SCHED_LOOP_RATE. IMU is written by `ahrs_update`,
    before `set_servos` in the same loop (source: the scheduler table of Rover-4.6.3, Rover.cpp). Loops whose
    message was dropped are interpolated.
    """
    rate = parameters.get("SCHED_LOOP_RATE", 0.0)
    if stamps.size < 2 or rate <= 0 or abs(float(np.median(np.diff(stamps))) * rate - 1.0) > SAME_RATE:
        return None
    steps = np.diff(stamps)
    count = np.rint(steps * rate).astype(int)
    count[(count < 1) | (count > MOST_DROPPED)] = 1
    first = np.repeat(np.cumsum(count) - count, count)
    within = (np.arange(first.size) - first) / np.repeat(count, count)
    return np.append(np.repeat(stamps[:-1], count) + within * np.repeat(steps, count), stamps[-1])


def at_main_loops(steering: Signal, loops: Array | None) -> Signal:
    """A staircase of commands (pwm, us) with each edge moved to the next main loop, which applies it.

    The outputs are sent once per main loop (source: AP_MotorsUGV::output), so a script's command waits up to
    one period. Of several commands between two loops only the last is sent. Unchanged when the loops are
    unknown (None); half a period later where no loop was logged for long.
    """
    if loops is None or not steering.hold or steering.t.size == 0:
        return steering
    period = float(np.median(np.diff(loops)))
    k = np.minimum(np.searchsorted(loops, steering.t, "left"), loops.size - 1)
    near = (loops[k] >= steering.t) & (loops[k] - steering.t <= 1.5 * period)
    t = np.where(near, loops[k], steering.t + 0.5 * period)
    last = np.append(np.diff(t) > 0, True)
    return replace(steering, t=t[last], x=steering.x[last], source=f"{steering.source} {AT_LOOP}")
