"""When a command reached the servo: with the main loop after it was set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import AT_LOOP, Signal
from rover_sweep.logs.log import Array

MOST_DROPPED = 10  # loops in a row without their message; what is longer is a hole
SAME_RATE = 0.05  # by which the stamps may be off SCHED_LOOP_RATE and still be those of its loops


def main_loops(stamps: Array, parameters: Mapping[str, float]) -> Array | None:
    """Starts of the main loops (n,) s, from the stamps of a message that each of them logs.

    None where the message was logged at another rate than SCHED_LOOP_RATE. IMU is written by `ahrs_update`,
    before `set_servos` in the same loop (source: the scheduler table of Rover-4.6.3, Rover.cpp). Loops whose
    message the autopilot dropped are put in between.
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
    """A staircase of commands (pwm, us) with its edges where the servo got them: the first loop from each on.

    The outputs are pushed once a main loop (source: AP_MotorsUGV::output), so a command of a script waits up
    to a period, each a different time. Of several between two loops only the last got out. As it was where
    the loops are unknown (None), and half a period later where none was logged for long.
    """
    if loops is None or not steering.hold or steering.t.size == 0:
        return steering
    period = float(np.median(np.diff(loops)))
    k = np.minimum(np.searchsorted(loops, steering.t, "left"), loops.size - 1)
    near = (loops[k] >= steering.t) & (loops[k] - steering.t <= 1.5 * period)
    t = np.where(near, loops[k], steering.t + 0.5 * period)
    last = np.append(np.diff(t) > 0, True)
    return replace(steering, t=t[last], x=steering.x[last], source=f"{steering.source} {AT_LOOP}")
