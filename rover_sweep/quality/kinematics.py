"""Detects a channel with the wrong sign or unit, from its kinematic relations to the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import Note
from rover_sweep.quality.relations import FORCE_RANGE, Relation, Relations

REVERSED, UNIT, SCALE = "reversed", "other unit", "wrong scale"
SAME = 0.8, 1.25  # an angle's slope over its rate: correct recordings have .94 to 1.01
CLOSE = 1.15  # tolerance (factor) for the scale of a known unit; wheels that slip give others
PLAIN = 0.5, 2.0  # magnitude of a factor that is not a change of unit
LEANING = 0.15  # rad s^2/m: 84 deg at 1 g; correct recordings have .002 to .03
DEGREES, G = 180 / np.pi, STANDARD_GRAVITY
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
}  # {channel: (unit, its value over the SI value)}
ORIENTATION = "or the autopilot is not mounted as in AHRS_ORIENTATION, or the rover drove backwards"


class Wrong(NamedTuple):
    """A channel with `factor` times its true value, unless one of `others` is wrong. by: the evidence."""

    channel: str
    factor: float
    by: str
    others: tuple[str, ...] = ()


def kinematics(found: Relations, given_speed: float | None = None) -> Iterator[Note]:
    """A fault for each of r, p, a_y, V that contradicts the others.

    given_speed [m/s]: a constant speed from the user. Its unit is known, so a contradiction is only a warning
    (as in Stanford's second P1 file, whose speed is not known).
    """
    yaw = tuple(_yaw(found))
    turned = any(wrong.channel == "ay" and wrong.factor < 0 and not wrong.others for wrong in yaw)
    for wrong in (*yaw, *_roll(found), *_lean(found, turned)):
        if wrong.channel == "speed" and given_speed is not None:
            yield _given(wrong, given_speed)
        else:
            yield _fault(wrong)


def _yaw(found: Relations) -> Iterator[Wrong]:
    """Checks r by the heading, then a_y by V and the corrected r. No fit uses the heading."""
    factor, heading, force = 1.0, found.heading, found.force
    if heading is not None and not _within(heading.ratio, SAME):
        if force is not None and _within(force.ratio, FORCE_RANGE):
            return  # r agrees with a_y, so the heading is wrong
        factor = 1 / heading.ratio
        yield Wrong("r", factor, f"the rate of the heading is {heading.ratio:.3g} times r")
    if force is not None and not _within(force.ratio * factor, FORCE_RANGE):
        yield _of_force(force.ratio, factor, heading is not None, found.lean)


def _of_force(ratio: float, factor: float, has_heading: bool, lean: Relation | None) -> Wrong:
    """The wrong one of r, V and a_y, when a_y is `ratio` times V r and r is `factor` times its value.

    Without a heading, the outward lean decides whether r or a_y is reversed.
    """
    by = f"a_y is {ratio:.3g} times V r"
    if not has_heading and _unit("r", 1 / ratio):
        return Wrong("r", 1 / ratio, by, ("ay",))
    if _unit("speed", 1 / (ratio * factor)):
        return Wrong("speed", 1 / (ratio * factor), by)
    if not has_heading and lean is not None and ratio < 0 and _within(-ratio, FORCE_RANGE):
        return Wrong("ay" if lean.ratio < 0 else "r", -1.0, by)
    known = _unit("ay", ratio * factor) or _within(abs(ratio * factor), FORCE_RANGE)
    others = (*(() if known else ("speed",)), *(() if has_heading else ("r",)))
    return Wrong("ay", ratio * factor, by, others)


def _roll(found: Relations) -> Iterator[Wrong]:
    if found.roll is not None and not _within(found.roll.ratio, SAME):
        by = f"the rate of the roll angle is {found.roll.ratio:.3g} times p"
        yield Wrong("p", 1 / found.roll.ratio, by)


def _lean(found: Relations, turned: bool) -> Iterator[Wrong]:
    """Checks p by a_y: a rover leans outwards, by less than LEANING."""
    if found.lean is None:
        return
    ratio = -found.lean.ratio if turned else found.lean.ratio
    by = f"p is {ratio:.3g} rad s^2/m times the derivative of a_y, but a rover leans outwards, by less than"
    if abs(ratio) > LEANING and found.force is not None and _within(abs(found.force.ratio), FORCE_RANGE):
        yield Wrong("p", np.sign(ratio) * DEGREES, f"{by} {LEANING:g}")
    elif ratio < 0:
        yield Wrong("p", -1.0, f"{by} {LEANING:g}", ("ay",))


def _within(x: float, range: tuple[float, float]) -> bool:
    return range[0] < x < range[1]


def _unit(channel: str, factor: float) -> tuple[str, float] | None:
    """(words, factor) of the unit that gives a channel `factor` times its value (either sign), or None."""
    off = {unit: abs(np.log(abs(factor) / unit[1])) for unit in UNITS[channel]}
    best = min(off, key=lambda unit: off[unit])
    return best if off[best] < np.log(CLOSE) else None


def _given(wrong: Wrong, speed: float) -> Note:
    return Note(
        "warning",
        f"the given speed of {speed:.4g} m/s does not agree with r and a_y: {wrong.by}, as expected at about "
        f"{speed / abs(wrong.factor):.2g} m/s; give the speed of this run",
    )


def _fault(wrong: Wrong) -> Note:
    channel, factor, by, others = wrong
    if "speed" in others:
        return _contradiction(wrong)
    unit, turned, plain = _unit(channel, factor), factor < 0, _within(abs(factor), PLAIN)
    states = [
        *(["reversed"] if turned else []),
        *([unit[0]] if unit else [] if plain else ["in another unit"]),
    ]
    divisor = (unit[1] if unit else 1.0 if turned and plain else abs(factor)) * np.sign(factor)
    doubt = f" (or {' or '.join(others)} is wrong)" if others else ""
    mounted = f", {ORIENTATION}" if channel == "ay" and turned else ""
    text = (
        f"{channel} is {' and '.join(states) or 'wrong by a factor'}{doubt}: {by}; "
        f"divide {channel} by {divisor:.4g}{mounted}"
    )
    name = UNIT if unit or not plain else REVERSED if turned else SCALE
    return Note("warning", text, name, (channel, *others))


def _contradiction(wrong: Wrong) -> Note:
    """The fault of channels of which any may be wrong, by no known unit."""
    channels = (*wrong.others, wrong.channel)
    low, high = FORCE_RANGE
    text = (
        f"{', '.join(channels[:-1])} and {channels[-1]} contradict each other: {wrong.by}, but correct "
        f"recordings have {low:g} to {high:g}, and no unit has this ratio; check their units and scales, and "
        "whether the wheels that measure the speed slip"
    )
    return Note("warning", text, SCALE, channels)
