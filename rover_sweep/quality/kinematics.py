"""A channel alone with the wrong sign or in another unit, told by what it must be to the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rover_sweep.data.recording import Note
from rover_sweep.quality.relations import ALIKE, Relation, Relations

REVERSED, UNIT, SCALE = "reversed", "other unit", "wrong scale"
SAME = 0.8, 1.25  # an angle's slope over its rate: sound recordings have .94 to 1.01
CLOSE, WIDE = 1.15, 1.4  # factor within which a scale is that of a known unit: by angles, by a_y over V r
PLAIN = 0.5, 2.0  # size of a factor that is no change of unit
LEANING = 0.15  # rad s^2/m: 84 deg at 1 g; sound recordings have .002 to .03
DEGREES, G = 180 / np.pi, 9.80665
UNITS = {
    "r": (("in deg/s", DEGREES), ("converted from deg/s twice", 1 / DEGREES), ("in mrad/s", 1e3)),
    "p": (("in deg/s", DEGREES), ("converted from deg/s twice", 1 / DEGREES), ("in mrad/s", 1e3)),
    "ay": (
        ("in g", 1 / G),
        ("in mg (or cm/s^2)", 1e3 / G),
        ("in ft/s^2", 3.2808),
        ("converted from g twice", G),
    ),
    "speed": (("in km/h", 3.6), ("in mph", 2.237)),
}  # a channel in that unit holds so many times its value in SI
ORIENTATION = "or the autopilot is mounted otherwise than AHRS_ORIENTATION says, or the rover drove backwards"


class Wrong(NamedTuple):
    """A channel that holds `factor` times its true value, by a relation in words, or one of `others` does.

    close: factor within which the relation is known.
    """

    channel: str
    factor: float
    by: str
    others: tuple[str, ...] = ()
    close: float = CLOSE


def kinematics(found: Relations, given_speed: float | None = None) -> Iterator[Note]:
    """A fault for each of r, p, a_y, V that disagrees with the others.

    given_speed: m/s where the speed is one number that somebody gave. It has no unit to mistake, so a
    disagreement is a warning and no fault: Stanford's second P1 file, whose speed is not known.
    """
    yaw = tuple(_yaw(found))
    turned = any(wrong.channel == "ay" and wrong.factor < 0 and not wrong.others for wrong in yaw)
    for wrong in (*yaw, *_roll(found), *_lean(found, turned)):
        if wrong.channel == "speed" and given_speed is not None:
            yield _given(wrong, given_speed)
        else:
            yield _fault(wrong)


def _yaw(found: Relations) -> Iterator[Wrong]:
    """r by the heading; a_y by V and the corrected r. The heading itself is in no fit."""
    factor, heading, force = 1.0, found.heading, found.force
    if heading is not None and not _within(heading.ratio, SAME):
        if force is not None and _within(force.ratio, ALIKE):
            return  # r agrees with a_y, so the heading is the odd one
        factor = 1 / heading.ratio
        yield Wrong("r", factor, f"the heading changes by {heading.ratio:.3g} times r")
    if force is not None and not _within(force.ratio * factor, ALIKE):
        yield _of_force(force.ratio, factor, heading is not None, found.lean)


def _of_force(ratio: float, factor: float, has_heading: bool, lean: Relation | None) -> Wrong:
    """Which of r, V and a_y makes a_y `ratio` times V r, where r holds `factor` times its value.

    Without a heading the outward lean tells whether r or a_y is the reversed one.
    """
    by = f"a_y is {ratio:.3g} times V r"
    if not has_heading and _unit("r", 1 / ratio, WIDE):
        return Wrong("r", 1 / ratio, by, ("ay",), WIDE)
    if _unit("speed", 1 / (ratio * factor), WIDE):
        return Wrong("speed", 1 / (ratio * factor), by, close=WIDE)
    if not has_heading and lean is not None and ratio < 0 and _within(-ratio, ALIKE):
        return Wrong("ay" if lean.ratio < 0 else "r", -1.0, by)
    return Wrong("ay", ratio * factor, by, () if has_heading else ("r",), WIDE)


def _roll(found: Relations) -> Iterator[Wrong]:
    if found.roll is not None and not _within(found.roll.ratio, SAME):
        yield Wrong("p", 1 / found.roll.ratio, f"the roll angle changes by {found.roll.ratio:.3g} times p")


def _lean(found: Relations, turned: bool) -> Iterator[Wrong]:
    """p by a_y: a rover on springs leans outward, by less than LEANING."""
    if found.lean is None:
        return
    ratio = -found.lean.ratio if turned else found.lean.ratio
    by = f"p is {ratio:.3g} rad s^2/m times the derivative of a_y, and a rover leans outward, by less than"
    if abs(ratio) > LEANING and found.force is not None and _within(abs(found.force.ratio), ALIKE):
        yield Wrong("p", np.sign(ratio) * DEGREES, f"{by} {LEANING:g}")
    elif ratio < 0:
        yield Wrong("p", -1.0, f"{by} {LEANING:g}", ("ay",))


def _within(x: float, range: tuple[float, float]) -> bool:
    return range[0] < x < range[1]


def _unit(channel: str, factor: float, close: float) -> tuple[str, float] | None:
    """(words, factor) of the unit in which a channel would hold `factor` times its value, of either sign."""
    off = {unit: abs(np.log(abs(factor) / unit[1])) for unit in UNITS[channel]}
    best = min(off, key=lambda unit: off[unit])
    return best if off[best] < np.log(close) else None


def _given(wrong: Wrong, speed: float) -> Note:
    return Note(
        "warning",
        f"the given speed of {speed:.4g} m/s does not agree with r and a_y: {wrong.by}, as it is at about "
        f"{speed / abs(wrong.factor):.2g} m/s; give the speed of this run",
    )


def _fault(wrong: Wrong) -> Note:
    channel, factor, by, others, close = wrong
    unit, turned, plain = _unit(channel, factor, close), factor < 0, _within(abs(factor), PLAIN)
    states = [
        *(["reversed"] if turned else []),
        *([unit[0]] if unit else [] if plain else ["in another unit"]),
    ]
    divisor = (unit[1] if unit else 1.0 if turned and plain else abs(factor)) * np.sign(factor)
    doubt = f" (or {' or '.join(others)} is wrong)" if others else ""
    mounted = f", {ORIENTATION}" if channel == "ay" and turned else ""
    text = (
        f"{channel} is {' and '.join(states) or 'of the wrong scale'}{doubt}: {by}; "
        f"divide {channel} by {divisor:.4g}{mounted}"
    )
    name = UNIT if unit or not plain else REVERSED if turned else SCALE
    return Note("warning", text, name, (channel, *others))
