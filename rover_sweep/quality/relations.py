"""Kinematic relations between recorded channels, valid for any rover, as ratios.

psi' = r and phi' = p (small angles, level ground). At low frequencies a_y = V r: the effects of sideslip and
of the IMU's position on a_y grow with frequency; roll adds g phi.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log
from typing import NamedTuple

import numpy as np

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import Array, Complex, LowPass, Note, Recording

STEP = 0.02  # s, of the common clock
LOWEST, HIGHEST = 0.5, 8.0  # rad/s, band of the comparison
PERIODS = 2.0  # of the lowest frequency, in the run
SHORTEST = 4.0  # s, of a run
SLOWEST = 4.0  # Hz, of a channel


@dataclass(frozen=True)
class Relation:
    """Ratio of one quantity to another, 1 when both are correct. coherence: of the two, 0..1."""

    ratio: float
    coherence: float


@dataclass(frozen=True)
class Relations:
    """heading: psi' over r; roll: phi' over p; force: a_y over V r; lean: p over a_y' [rad s^2/m].

    None when not recorded or not coherent; lean only without a roll angle.
    """

    heading: Relation | None
    roll: Relation | None
    force: Relation | None
    lean: Relation | None


CLEAR = 0.8  # coherence of an angle and its rate
CLEAR_FORCE = 0.6  # of a_y and V r, which sideslip makes differ
FORCE_RANGE = 0.55, 1.8  # accepted a_y over V r: correct recordings have .87 to 1.28
USUAL_FORCE = 1.055  # the middle of those
IN_PHASE = 0.6  # smallest real part of the cross-spectrum over its magnitude
CLEAR_LEAN = 0.35  # of p and a_y': a stiff rover on rough ground has .4


def relations(run: Recording) -> Relations:
    """The relations within the manoeuvre of a run."""
    t = np.arange(run.span[0], run.span[1], STEP)

    def recorded(*channels: str) -> bool:
        return run.span[1] - run.span[0] >= SHORTEST and all(
            c in run and run.manoeuvre(c).t.size > 1 and run.manoeuvre(c).rate >= SLOWEST for c in channels
        )

    def clear(least: float, y: Array, x: Array, filter: LowPass | None = None) -> Relation | None:
        found = _relation(t, y, x, filter)
        return found if found is not None and found.coherence >= least else None

    def turned(angle: str, rate: str) -> Relation | None:
        if not recorded(angle, rate):
            return None
        return clear(CLEAR, np.gradient(run[angle].on(t), t), run[rate].on(t), run.filters.get(rate))

    force = lean = None
    if recorded("ay", "r", "speed"):
        force = clear(CLEAR_FORCE, run["ay"].on(t), run["speed"].on(t) * run["r"].on(t))
    if "phi" not in run and recorded("p", "ay"):
        lean = clear(CLEAR_LEAN, run["p"].on(t), np.gradient(run["ay"].on(t), t))
    return Relations(turned("psi", "r"), turned("phi", "p"), force, lean)


def _relation(t: Array, y: Array, x: Array, filter: LowPass | None = None) -> Relation | None:
    """y over x by least squares between LOWEST and HIGHEST; filter: low-pass in x but not in y."""
    w = np.asarray(2 * np.pi * np.fft.rfftfreq(t.size, STEP), float)
    inside = (w >= max(LOWEST, PERIODS * 2 * np.pi / (t[-1] - t[0]))) & (w <= HIGHEST)
    top, bottom = _spectrum(y)[inside], _spectrum(x)[inside]
    if filter is not None:
        top = top * filter.response(w[inside])
    powers = float(np.sum(np.abs(top) ** 2)), float(np.sum(np.abs(bottom) ** 2))
    cross = complex(np.sum(bottom.conj() * top))
    if min(powers) <= 0 or abs(cross.real) < IN_PHASE * abs(cross):
        return None
    return Relation(cross.real / powers[1], abs(cross) ** 2 / (powers[0] * powers[1]))


def _spectrum(x: Array) -> Complex:
    return np.asarray(np.fft.rfft((x - x.mean()) * np.hanning(x.size)))


# The responses of a rover in a few bands, to check whether two runs are of the same rover.


EDGES = np.geomspace(1.5, 15.0, 9)  # rad/s
CLEAR_BAND = 0.8  # smallest coherence of a usable band
FEWEST_BANDS = 4  # usable bands needed for a comparison
LOW = 3  # lowest bands, in which the yaw rate depends on the wheelbase and hardly on the tyres
WINDOW = 1.5  # equivalent bins of a Hann window, by which fewer averages are independent


@dataclass(frozen=True, eq=False)
class Bands:
    """A response h (n_bands,) and its relative random error (n_bands,), NaN where the coherence is low."""

    h: Complex
    error: Array


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """yaw: r per steering and speed, which is the curvature of the path per steering; lean: p per a_y,
    independent of tyres, surface, speed and steering.

    speed [m/s]; amplitude of the steering, in its unit.
    """

    yaw: Bands
    lean: Bands
    speed: float
    amplitude: float


@dataclass(frozen=True)
class AnswerDifference:
    """Median relative difference of two responses, and its random error."""

    difference: float
    error: float


def fingerprint(run: Recording, input: str) -> Fingerprint:
    """The fingerprint of a run with the steering channel `input`; known low-passes are corrected."""
    t = np.arange(run.span[0], run.span[1], STEP)
    w: Array = np.asarray(2 * np.pi * np.fft.rfftfreq(t.size, STEP), np.float64)
    spectra = {c: _spectrum(run[c].on(t)) for c in (input, "r", "ay", "p") if c in run}
    spectra |= {c: spectra[c] / run.filters[c].response(w) for c in spectra if c in run.filters}
    unknown = np.full(EDGES.size - 1, np.nan)
    lean = Bands(unknown + 0j, unknown)
    if {"p", "ay"} <= set(spectra):
        lean = _answer(w, spectra["p"], spectra["ay"])
    amplitude = float(np.ptp(run.manoeuvre(input).x)) / 2
    spectra["r"] /= run.mean_speed
    return Fingerprint(_answer(w, spectra["r"], spectra[input]), lean, run.mean_speed, amplitude)


def _answer(w: Array, output: Complex, input: Complex) -> Bands:
    h, error = np.full(EDGES.size - 1, np.nan + 0j), np.full(EDGES.size - 1, np.nan)
    for k in range(h.size):
        inside = (w >= EDGES[k]) & (w < EDGES[k + 1])
        x, y = input[inside], output[inside]
        power = float(np.sum(np.abs(x) ** 2))
        cross = complex(np.sum(x.conj() * y))
        coherence = abs(cross) ** 2 / max(power * float(np.sum(np.abs(y) ** 2)), 1e-300)
        if inside.sum() > 2 and coherence > CLEAR_BAND:
            h[k] = cross / power
            error[k] = np.sqrt((1 - min(coherence, 1.0)) * WINDOW / (2 * coherence * inside.sum()))
    return Bands(h, error)


def difference_of(one: Bands, two: Bands) -> AnswerDifference | None:
    """Median difference of two responses in magnitude and phase, None with too few usable bands."""
    clear = np.isfinite(one.error) & np.isfinite(two.error)
    if clear.sum() < FEWEST_BANDS:
        return None
    off = np.abs(np.log(one.h[clear] / two.h[clear]))
    return AnswerDifference(
        float(np.median(off)), float(np.median(np.hypot(one.error[clear], two.error[clear])))
    )


def gain_ratio(one: Bands, two: Bands) -> AnswerDifference | None:
    """|ln| of the ratio of two responses' magnitudes in the lowest bands, None where not usable."""
    if not np.all(np.isfinite(one.error[:LOW]) & np.isfinite(two.error[:LOW])):
        return None
    off = np.log(np.abs(one.h[:LOW]) / np.abs(two.h[:LOW]))
    return AnswerDifference(
        abs(float(np.median(off))), float(np.median(np.hypot(one.error[:LOW], two.error[:LOW])))
    )


# Detects a clock that runs too fast or too slow, from angles and their rates or from a second clock.


STRETCHED = "stretched clock"
ALL_CHANNELS = ("r", "p", "ay", "vy", "speed", "delta", "pwm")
SLOPE = 0.05  # from 1: correct recordings have .98 to 1.00 between heading and yaw rate
APPLET_OFF = 0.005  # from 1: correct recordings have 6e-5, as both clocks count the same oscillator
ARRIVAL_OFF = 0.04  # from 1: the delay of a link may grow by a second in a run
SHORTEST_TIMED, LONG_TIMED, FEWEST_TIMED = 3.0, 20.0, 20  # s, s, messages
AGREE = 0.06  # between heading and roll: correct recordings have .02 to .06
HEADING_ONLY = 0.1  # from 1, when only the heading is known
REACH = 0.25, 4.0  # factors of a clock; outside, the unit is wrong


def stretched_by_angles(found: Relations) -> Iterator[Note]:
    """A fault when heading and roll angle both change by the same wrong factor of their rates.

    If both gyros are wrong instead, a_y, which no clock changes, is that factor times V r. Without a
    roll angle the heading decides, if r agrees with a_y.
    """
    if found.heading is None:
        return
    heading, force = found.heading.ratio, found.force
    if found.roll is None:
        agrees = force is not None and _within(force.ratio, FORCE_RANGE)
        if agrees and _within(heading, REACH) and abs(heading - 1) > HEADING_ONLY:
            yield stretched(1 / heading, f"the heading changes {heading:.3g} times as fast as r")
        return
    roll = found.roll.ratio
    if not _within(heading, REACH) or not _within(roll, REACH) or abs(heading - 1) < SLOPE:
        return
    # a_y over V r nearer to its usual value times the heading's factor than to that value: wrong gyros
    apart = None if force is None or force.ratio <= 0.0 else log(force.ratio / USUAL_FORCE)
    gyros = apart is not None and abs(apart - log(heading)) < abs(apart)
    if abs(roll / heading - 1) < AGREE and not gyros:
        yield stretched(
            1 / heading,
            f"heading and roll angle change {heading:.3g} and {roll:.3g} times as fast as r and p, "
            f"unless both gyros read {1 / heading:.3g} times the true rate",
        )


def stretched_by_applet(t: Array, clock: Array) -> Iterator[Note]:
    """A fault when the applet's clock (n,) [s] in a run differs in rate from the log's t (n,) [s]."""
    ratio = _slope(clock, t) if t.size >= FEWEST_TIMED and np.ptp(clock) > SHORTEST_TIMED else 1.0
    if abs(ratio - 1) > APPLET_OFF:
        yield stretched(
            ratio,
            f"{np.ptp(clock):.4g} s of the applet's clock (SWEP.T) take {np.ptp(t):.4g} s "
            "of the log's (TimeUS)",
        )


def stretched_by_arrival(t: Array, arrival: Array, heading: Relation | None) -> Iterator[Note]:
    """A fault when messages with vehicle times t (n,) [s] arrive at another rate, arrival (n,) [s].

    A simulation faster than real time does this without fault: heading and yaw rate decide, if recorded.
    """
    ratio = _slope(arrival, t) if t.size >= FEWEST_TIMED and np.ptp(arrival) > LONG_TIMED else 1.0
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
    return Note("warning", text, STRETCHED, ALL_CHANNELS)


# Detects a channel with the wrong sign or unit, from its kinematic relations to the others.


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
ORIENTATION = (
    "or the autopilot is not mounted as in AHRS_ORIENTATION, or the rover drove in reverse and V has no sign"
)


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
    for wrong in (*yaw, *_roll(found, turned)):
        if wrong.channel == "speed" and given_speed is not None:
            yield Note(
                "warning",
                f"the given speed of {given_speed:.4g} m/s does not agree with r and a_y: {wrong.by}, as "
                f"expected at about {given_speed / abs(wrong.factor):.2g} m/s; give the speed of this run",
            )
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


def _roll(found: Relations, turned: bool) -> Iterator[Wrong]:
    """Checks p by the roll angle, and by a_y: a rover leans outwards, by less than LEANING."""
    if found.roll is not None and not _within(found.roll.ratio, SAME):
        by = f"the rate of the roll angle is {found.roll.ratio:.3g} times p"
        yield Wrong("p", 1 / found.roll.ratio, by)
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
