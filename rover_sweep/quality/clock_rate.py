"""A clock that runs too fast or too slow, told by angles and their rates or by a second clock."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rover_sweep.data.recording import Array, Note
from rover_sweep.quality.relations import ALIKE, Relation, Relations

STRETCHED = "stretched clock"
ALL = ("r", "p", "ay", "vy", "speed", "delta", "pwm")
SLOPE = 0.05  # of 1: sound recordings have .98 to 1.00 between heading and yaw rate
APPLET_OFF = 0.005  # of 1: sound recordings have 6e-5; both count the same oscillator
ARRIVAL_OFF = 0.04  # of 1: a link's delay may grow by a second in a run
SHORTEST, LONG, FEWEST = 3.0, 20.0, 20  # s, s, messages
AGREE = 0.06  # between heading and roll: sound recordings have .02 to .06
ALONE = 0.1  # of 1, where the heading alone says it
REACH = 0.25, 4.0  # stretches that are a clock's; beyond, another unit


def stretched_by_angles(found: Relations) -> Iterator[Note]:
    """A fault where heading and roll angle both change by the same wrong factor of their rates.

    Of a rover that does not roll the heading must do, where r agrees with a_y.
    """
    if found.heading is None:
        return
    if found.roll is None:
        yield from _by_heading(found.heading.ratio, found.force)
        return
    heading, roll = found.heading.ratio, found.roll.ratio
    if not all(REACH[0] < x < REACH[1] for x in (heading, roll)) or abs(heading - 1) < SLOPE:
        return
    if abs(roll / heading - 1) < AGREE:
        yield stretched(
            1 / heading,
            f"heading and roll angle change {heading:.3g} and {roll:.3g} times as fast as r and p say",
        )


def _by_heading(heading: float, force: Relation | None) -> Iterator[Note]:
    agrees = force is not None and ALIKE[0] < force.ratio < ALIKE[1]
    if agrees and REACH[0] < heading < REACH[1] and abs(heading - 1) > ALONE:
        yield stretched(1 / heading, f"the heading changes {heading:.3g} times as fast as r says")


def stretched_by_applet(t: Array, clock: Array) -> Iterator[Note]:
    """A fault where the applet's own clock (n,) s of a run runs otherwise than the log's t (n,) s."""
    ratio = _slope(clock, t) if t.size >= FEWEST and np.ptp(clock) > SHORTEST else 1.0
    if abs(ratio - 1) > APPLET_OFF:
        yield stretched(
            ratio,
            f"{np.ptp(clock):.4g} s of the applet's clock (SWEP.T) take {np.ptp(t):.4g} s "
            "of the log's (TimeUS)",
        )


def stretched_by_arrival(t: Array, arrival: Array, heading: Relation | None) -> Iterator[Note]:
    """A fault where messages with the vehicle's times t (n,) s arrive at another pace.

    A simulation that runs faster than time has its messages arrive so as well: heading against yaw rate
    decides, where both were recorded.
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
    """The fault of a clock of which a second is `factor` true seconds."""
    text = (
        f"the clock of this recording is stretched by {factor:.3g}: {by}; frequencies, stiffness and "
        "inertia would be wrong, so record again or mend the times"
    )
    return Note("warning", text, STRETCHED, ALL)
