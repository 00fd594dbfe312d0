"""Detects a clock that runs too fast or too slow, from angles and their rates or from a second clock."""

from __future__ import annotations

from collections.abc import Iterator
from math import log

import numpy as np

from rover_sweep.data.recording import Array, Note
from rover_sweep.quality.relations import FORCE_RANGE, USUAL_FORCE, Relation, Relations

STRETCHED = "stretched clock"
ALL = ("r", "p", "ay", "vy", "speed", "delta", "pwm")
SLOPE = 0.05  # from 1: correct recordings have .98 to 1.00 between heading and yaw rate
APPLET_OFF = 0.005  # from 1: correct recordings have 6e-5, as both clocks count the same oscillator
ARRIVAL_OFF = 0.04  # from 1: the delay of a link may grow by a second in a run
SHORTEST, LONG, FEWEST = 3.0, 20.0, 20  # s, s, messages
AGREE = 0.06  # between heading and roll: correct recordings have .02 to .06
HEADING_ONLY = 0.1  # from 1, when only the heading is known
REACH = 0.25, 4.0  # factors of a clock; outside, the unit is wrong


def stretched_by_angles(found: Relations) -> Iterator[Note]:
    """A fault when heading and roll angle both change by the same wrong factor of their rates.

    Both gyros may be wrong instead: a_y, which no clock changes, is then that factor times V r. Without a
    roll angle the heading decides, if r agrees with a_y.
    """
    if found.heading is None:
        return
    if found.roll is None:
        yield from _by_heading(found.heading.ratio, found.force)
        return
    heading, roll = found.heading.ratio, found.roll.ratio
    if not all(REACH[0] < x < REACH[1] for x in (heading, roll)) or abs(heading - 1) < SLOPE:
        return
    if abs(roll / heading - 1) < AGREE and not _gyros_are_wrong(heading, found.force):
        yield stretched(
            1 / heading,
            f"heading and roll angle change {heading:.3g} and {roll:.3g} times as fast as r and p, "
            f"unless both gyros read {1 / heading:.3g} times the true rate",
        )


def _gyros_are_wrong(heading: float, force: Relation | None) -> bool:
    """True where a_y over V r is nearer to its usual value times the heading's factor than to that value."""
    if force is None or force.ratio <= 0.0:
        return False
    apart = log(force.ratio / USUAL_FORCE)
    return abs(apart - log(heading)) < abs(apart)


def _by_heading(heading: float, force: Relation | None) -> Iterator[Note]:
    agrees = force is not None and FORCE_RANGE[0] < force.ratio < FORCE_RANGE[1]
    if agrees and REACH[0] < heading < REACH[1] and abs(heading - 1) > HEADING_ONLY:
        yield stretched(1 / heading, f"the heading changes {heading:.3g} times as fast as r")


def stretched_by_applet(t: Array, clock: Array) -> Iterator[Note]:
    """A fault when the applet's clock (n,) [s] in a run differs in rate from the log's t (n,) [s]."""
    ratio = _slope(clock, t) if t.size >= FEWEST and np.ptp(clock) > SHORTEST else 1.0
    if abs(ratio - 1) > APPLET_OFF:
        yield stretched(
            ratio,
            f"{np.ptp(clock):.4g} s of the applet's clock (SWEP.T) take {np.ptp(t):.4g} s "
            "of the log's (TimeUS)",
        )


def stretched_by_arrival(t: Array, arrival: Array, heading: Relation | None) -> Iterator[Note]:
    """A fault when messages with vehicle times t (n,) [s] arrive at another rate, arrival (n,) [s].

    In a simulation that runs faster than real time they also do, without fault: if heading and yaw rate were
    recorded, they decide.
    """
    ratio = _slope(arrival, t) if t.size >= FEWEST and np.ptp(arrival) > LONG else 1.0
    refuted = heading is not None and abs(heading.ratio * ratio - 1) > abs(heading.ratio - 1)
    if abs(ratio - 1) > ARRIVAL_OFF and REACH[0] < ratio < REACH[1] and not refuted:
        yield stretched(
            ratio,
            f"messages of {np.ptp(t):.4g} s of the vehicle's clock arrived within {np.ptp(arrival):.4g} s",
        )


def _slope(x: Array, y: Array) -> float:
    x, y = x - x.mean(), y - y.mean()
    return float(x @ y / (x @ x))


def stretched(factor: float, by: str) -> Note:
    """The fault of a clock whose second lasts `factor` true seconds. by: the evidence."""
    text = (
        f"the clock of this recording is stretched by {factor:.3g}: {by}; frequencies, stiffness and "
        "inertia would be wrong, so record again or correct the times"
    )
    return Note("warning", text, STRETCHED, ALL)
