"""From any driving: how much and how late a rover turns for its steering, and which numbers are unknown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import pi, sqrt
from typing import Literal

import numpy as np
from scipy.stats import chi2

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.recording import Array, Signal
from rover_sweep.data.results import (
    NORMAL_90,
    ByName,
    Quantity,
    ShortTable,
    Shown,
    ends_words,
    number,
    plain_number,
)
from rover_sweep.driving.changes import MOST_UNDERSTEER, GainChange, gain_change
from rover_sweep.driving.fit import OF_SPEED, DrivingFit, fit_driving, precision_with, reached, tyre_time
from rover_sweep.driving.stretches import FULL, RATE, DrivenPart, Driving, usable_driving
from rover_sweep.driving.tyres import tyre_stiffnesses
from rover_sweep.logs.cross_check import SURE_SPEED
from rover_sweep.logs.log import Log
from rover_sweep.manoeuvre.sweep import Sweep

Level = Literal["good", "rough", "none"]

GOOD, ROUGH = 0.9, 0.7  # shares of the yaw rate that the law must give in driving it was not fitted to
LEAST_SECONDS = 8.0  # of usable driving
SPEEDS_APART = 1.3  # ratio of the speeds in turns, from which they show what depends on speed
HARD_TURN = 3.0  # m/s^2, at which the bend of the tyres is told
EXTRAPOLATED = 1.5  # times the speed or acceleration of the driven turns: nothing is said beyond
KNOWN = 0.5  # of a value; a wider half interval makes it unknown
VISIBLE = 0.03  # of the curvature; a smaller difference between the sides, or bend of the curve, is not said
SWEEP, SWEEP_SPEED = Sweep(amplitude=120.0), 2.0  # advised; us, m/s
NO_TYRES = "Tyre stiffnesses and yaw inertia, which need sweeps and a vehicle file with the mass"
NO_TYRES_KNOWN = "Tyre stiffnesses, which need sweeps, or yaw_inertia and turns at speeds further apart"
SCALING = {"r": "the yaw rate", "speed": "the speed"}  # channels with whose units the numbers scale
OF_POSITIONS = "the yaw rate is the slope of positions, which makes quick turns smaller"
DEG_PER_G = GRAVITY * 180 / pi


@dataclass(frozen=True, eq=False, repr=False)
class DrivingAnswer(Shown):
    """The numbers that this driving shows, each with its 90 % interval.

    level: "good", "rough", or "none" if no number is reliable; reasons: why it is not good. numbers: see
    `rs.identify_driving`. unknown: numbers that the driving cannot show, and why. driving: the parts used;
    fit: None if not possible. speeds: (5 %, 50 %, 95 %) of the speed in turns, m/s. amplitude: 95 % of the
    time the steering deviates less from straight ahead. band: (lowest, highest) Hz that hold 90 % of the
    steering's power. after_sweep: (number, half width of its interval) if a sweep were added. each: {file:
    its own answer} if the files disagree; then there are no common numbers.
    """

    level: Level
    numbers: ByName[Quantity]
    reasons: tuple[str, ...]
    unknown: tuple[str, ...]
    driving: Driving
    fit: DrivingFit | None = None
    speeds: tuple[float, float, float] = (0.0, 0.0, 0.0)
    amplitude: float = 0.0
    band: tuple[float, float] = (0.0, 0.0)
    after_sweep: tuple[tuple[str, float], ...] = ()
    each: Mapping[str, DrivingAnswer] = field(default_factory=dict)

    def table(self) -> ShortTable:
        """The numbers with their intervals, and what stays unknown."""
        every = [("", self.numbers), *((f" of {name}", answer.numbers) for name, answer in self.each.items())]
        rows = tuple(
            (f"{q.name}{of}", plain_number(q.value), q.unit, ends_words(q.low, q.high), q.meaning)
            for of, numbers in every
            for q in numbers
        )
        title = f"steering from {self.driving.seconds:.0f} s of driving: {self.level}"
        headings = ("number", "value", "unit", "90 % interval", "meaning")
        return ShortTable(title, headings, rows, (*self.reasons, *self.unknown))


def answer_from(
    logs: Sequence[Log], wheelbase: float | None = None, rover: Geometry | None = None
) -> DrivingAnswer:
    """One answer from all logs, or one per file if their numbers disagree.

    wheelbase [m] and rover (its vehicle file) allow physical values for more numbers.
    """
    wheelbase = wheelbase or (rover.wheelbase if rover else None)
    files: dict[tuple[tuple[str, str], ...], list[Log]] = {}
    for log in logs:
        files.setdefault(log.sources, []).append(log)
    if len(files) == 1:
        return _together(logs, wheelbase, rover)
    each: dict[str, DrivingAnswer] = {}
    for k, (sources, of_file) in enumerate(files.items()):
        name = "+".join(name for name, _ in sources)
        each[f"{name} ({k + 1})" if name in each else name] = _together(of_file, wheelbase, rover)
    if not (names := disagreeing([(a.numbers, a.speeds[1]) for a in each.values() if a.numbers])):
        return _together(logs, wheelbase, rover)
    why = (
        f"the logs do not agree on {' and '.join(name.replace('_', ' ') for name in names)}: the rover was "
        "changed between them, or they are of several rovers"
    )
    return DrivingAnswer("none", ByName(()), (why,), (), usable_driving(logs), each=each)


def _together(logs: Sequence[Log], wheelbase: float | None, rover: Geometry | None) -> DrivingAnswer:
    """What these logs of one rover show."""
    driving = usable_driving(logs)
    used = driving.stretches
    doubts = tuple(_doubts(driving))
    if NORMAL_90 * driving.speed_sd > KNOWN:
        return _nothing(driving, *doubts)
    if driving.seconds < LEAST_SECONDS:
        return _nothing(
            driving, f"only {int(driving.seconds)} s of driving can be used, {LEAST_SECONDS:.0f} s are needed"
        )
    steering = np.concatenate([s.steered(0.0) for s in used])
    if np.ptp(steering) < 1e-9:
        return _nothing(driving, f"the steering stayed at {number(float(steering[0]))} {driving.unit}")
    v = np.concatenate([s.v for s in used])
    turning = np.square(steering - np.median(steering))
    speeds = _weighted(np.abs(v), turning)
    held = () if speeds[2] > SPEEDS_APART * speeds[0] else OF_SPEED
    fit = fit_driving(used, driving.known, held, driving.speed_sd)
    level, reasons = _judged(fit, gain_change(fit, used))
    if level == "none":
        return _nothing(driving, *(doubts or reasons), fit=fit)
    if unsure := sorted({channel for log in logs for channel in log.unsure} & set(SCALING)):
        level, reasons = "rough", (*reasons, _scaled_by(unsure))
    if driving.course:
        level, reasons = "rough", (*reasons, OF_POSITIONS)
    if doubts:
        level, reasons = "rough", (*reasons, *doubts)
    numbers, unknown = _numbers(fit, driving, speeds, wheelbase)
    tyres = tyre_stiffnesses(fit, rover, speeds[1]) if rover else ()
    numbers = ByName((*numbers, *tyres))
    unknown += () if tyres else (NO_TYRES_KNOWN if rover else NO_TYRES,)
    amplitude = float(np.percentile(np.abs(steering - fit["straight"]), 95))
    better = _after_sweep(fit, driving, speeds, wheelbase) if driving.unit == "us" else ()
    return DrivingAnswer(
        level, numbers, reasons, unknown, driving, fit, speeds, amplitude, _band(used), better
    )


def _doubts(driving: Driving) -> Iterator[str]:
    """Why channels that contradict each other keep the answer from being good."""
    yield from (one.text for one in driving.contradictions if not one.decided)
    if driving.speed_sd > SURE_SPEED and all(one.decided for one in driving.contradictions):
        percent = f"{200 * driving.speed_sd:.0f} %"
        yield f"the corrected speed is known to {percent}: log GPS or wheel encoders"


def _scaled_by(unsure: Sequence[str]) -> str:
    names = " and of ".join(SCALING[channel] for channel in unsure)
    return f"the unit of {names} is a guess, and the numbers scale with it: give it in a column map"


def _nothing(driving: Driving, *reasons: str, fit: DrivingFit | None = None) -> DrivingAnswer:
    """No numbers, with what was left out of the driving."""
    out = [f"{seconds:.0f} s left out: {why}" for why, seconds in driving.left_out.items() if seconds >= 1]
    return DrivingAnswer("none", ByName(()), (*reasons, *out), (), driving, fit)


def _judged(fit: DrivingFit, changed: GainChange | None) -> tuple[Level, tuple[str, ...]]:
    """The level, and why it is not good. changed: the moment at which the driving contradicts itself."""
    low, high = fit.interval({"gain": 1.0}, fit["gain"])
    share = f"the steering explains {100 * max(fit.explained, 0.0):.0f} % of the yaw rate"
    if low <= 0 <= high or (high - low) / 2 > KNOWN * abs(fit["gain"]):
        if changed:
            return "none", (changed.words,)
        if fit.explained < ROUGH:
            return "none", ("the yaw rate does not follow the steering in this driving",)
        if abs(fit["understeer"]) > MOST_UNDERSTEER:
            return "none", (
                f"{share}, but it hardly grows with the speed, as with an understeer of "
                f"{number(fit['understeer'])} s²/m² that no rover has: is the recorded speed the rover's?",
            )
        return "none", (f"{share}, but this is too little driving",)
    if fit.explained < ROUGH:
        return "none", (
            f"{share} in parts of the drive that were not fitted; {100 * ROUGH:.0f} % are needed",
        )
    reasons = (changed.words,) if changed else ()
    if fit.explained < GOOD:
        reasons += (f"{share} only: the rover turned for other reasons too, or its steering is not linear",)
    return ("rough" if reasons else "good"), reasons


def _numbers(
    fit: DrivingFit, driving: Driving, speeds: tuple[float, float, float], wheelbase: float | None
) -> tuple[ByName[Quantity], tuple[str, ...]]:
    """The quantities that are shown, and sentences on those that are not."""
    late, unsure = _lateness(fit, speeds[1])
    if driving.course and late:
        unsure = ("How late the turn follows: positions are too smooth for it. Record a gyro",)
        late = ()
    handling, open_question = _handling(fit, speeds, wheelbase)
    shown = (
        *_steering(fit, driving, speeds[1], wheelbase),
        *_sides(fit, driving.unit),
        *_steering_curve(fit, driving.unit),
        *late,
        *handling,
        *_bend(fit, driving),
    )
    return ByName(shown), (*unsure, *open_question)


def _quantity(
    fit: DrivingFit,
    name: str,
    unit: str,
    value: float,
    slopes: dict[str, float],
    meaning: str,
    least: float = -np.inf,
) -> Quantity:
    """A number with the interval of these slopes {parameter: derivative}, at least `least`."""
    low, high = fit.interval(slopes, value)
    return Quantity(name, unit, value, max(low, least), max(high, least), meaning)


def _decided(fit: DrivingFit, name: str) -> bool:
    """Whether the interval of a share leaves out 0, and the share is visible."""
    low, high = fit.interval({name: 1.0}, fit[name])
    return (low > 0 or high < 0) and abs(fit[name]) > VISIBLE


_SCALE = {"rad": "wheelbase_seen", FULL: "full_radius"}
"""Name of the length that a steering shows by its unit; a share of the travel, as of a stick, is no angle."""


def _steering(fit: DrivingFit, driving: Driving, speed: float, wheelbase: float | None) -> Iterator[Quantity]:
    """What the path curves for the steering, straight ahead, ratio and tightest turn."""
    gain = fit["gain"]
    at = f", at {speed:.1f} m/s" if "understeer" in fit.held else ""
    in_us = driving.unit == "us"
    if in_us:
        turns = f"; a larger output turns {'left' if gain > 0 else 'right'}"
        turns = "" if any(one.turned and not one.decided for one in driving.contradictions) else turns
        words = f"curvature of the path for each 100 us{at}{turns}"
        yield _quantity(fit, "curvature", "1/m per 100 us", 100 * abs(gain), {"gain": 100.0}, words)
    else:
        words = f"speed times steering angle over yaw rate{at}; the wheelbase where the angle is right"
        if driving.unit == FULL:
            words = f"radius of the turn at full steering{at}, if in proportion; not the wheelbase"
        yield _quantity(fit, _SCALE[driving.unit], "m", 1 / abs(gain), {"gain": 1 / gain**2}, words)
    words = f"steering {'angle' if driving.unit == 'rad' else 'output'} that drives straight ahead"
    yield _quantity(fit, "straight", driving.unit, fit["straight"], {"straight": 1.0}, words)
    if wheelbase and in_us:
        words = "road-wheel angle for each us"
        yield _quantity(fit, "rad_per_us", "rad/us", abs(gain) * wheelbase, {"gain": wheelbase}, words)
    elif wheelbase:
        ratio = 1 / (abs(gain) * wheelbase)
        words = "recorded steering angle over the wheels' angle: 1 where it is the wheels' own"
        per = "1/rad" if driving.unit == FULL else "-"
        yield _quantity(fit, "steering_ratio", per, ratio, {"gain": ratio / gain}, words)
    if in_us and driving.limits:
        x = np.array(driving.limits) - fit["straight"]
        share = reached(x, fit.amplitude)
        bent = 1 + fit["side"] * np.sign(x) + fit["curve"] * share
        end = int(np.argmax(np.abs(x * bent)))
        least = float(1 / np.abs(gain * x * bent)[end])
        slopes = {"gain": least / gain, "side": least / bent[end], "curve": least * share[end] / bent[end]}
        words = "radius of the tightest turn that the servo's ends allow"
        yield _quantity(fit, "least_radius", "m", least, slopes, words)


def _sides(fit: DrivingFit, unit: str) -> Iterator[Quantity]:
    """The gain to each side, where they differ."""
    if not _decided(fit, "side"):
        return
    gain = fit["gain"]
    for side, sign in (("left", np.sign(gain)), ("right", -np.sign(gain))):
        there = 1 + sign * fit["side"]
        name, per, value, scale = f"curvature_{side}", "1/m per 100 us", 100 * abs(gain) * there, 100.0
        if unit != "us":
            value = 1 / (abs(gain) * there)
            name, per, scale = f"{_SCALE[unit]}_{side}", "m", value**2
        slopes = {"gain": scale * there, "side": scale * sign * gain}
        yield _quantity(fit, name, per, value, slopes, f"the same in turns to the {side}")


def _steering_curve(fit: DrivingFit, unit: str) -> Iterator[Quantity]:
    """How the steering saturates or grows, where it does."""
    if _decided(fit, "curve"):
        far = f"{number(fit.amplitude, 3)} {unit}"
        words = f"how far the turn exceeds proportionality {far} from straight; below 0: it saturates"
        yield _quantity(fit, "steering_curve", "%", 100 * fit["curve"], {"curve": 100.0}, words)


def _lateness(fit: DrivingFit, speed: float) -> tuple[tuple[Quantity, ...], tuple[str, ...]]:
    """(delay, lag and their sum at a speed [m/s], ()); ((), why) where they are not certain enough."""
    k = fit["understeer"]
    at = np.array([speed])
    tyres, softer = (float(tyre_time(fit["tyre_lag"], x, at)[0]) for x in (k, k + 1e-6))
    per = tyres / fit["tyre_lag"] if fit["tyre_lag"] else speed
    slopes = {"lag": 1.0, "tyre_lag": per, "understeer": 1e6 * (softer - tyres)}
    lag = fit["lag"] + tyres
    words = f"time constant with which the turn follows at {speed:.1f} m/s"
    both = {"delay": 1.0, **slopes}
    found = (
        _quantity(
            fit, "delay", "s", fit["delay"], {"delay": 1.0}, "pure delay from the output to the turn", 0.0
        ),
        _quantity(fit, "lag", "s", lag, slopes, words, 0.0),
        _quantity(fit, "response_time", "s", fit["delay"] + lag, both, "delay and lag together", 0.0),
    )
    low, high = found[-1].interval_90 or (0.0, np.inf)
    if high - low <= 2 * KNOWN * found[-1].value:
        return found, ()
    ends = f"{1000 * low:.0f} to {1000 * high:.0f} ms"
    return (), (f"How late the turn follows: only {ends} is certain. Steer left and right more quickly",)


def _handling(
    fit: DrivingFit, speeds: tuple[float, float, float], wheelbase: float | None
) -> tuple[tuple[Quantity, ...], tuple[str, ...]]:
    """(understeer, and the speed that it gives, ()); ((), why) where all turns had one speed [m/s]."""
    if "understeer" in fit.held:
        return (), (
            f"Under- or oversteer: all turns were driven at {speeds[0]:.1f} to {speeds[2]:.1f} m/s. Drive "
            f"turns at two speeds, such as {speeds[1] / 1.5:.1f} and {speeds[1] * 1.5:.1f} m/s",
        )
    k = fit["understeer"]
    name, unit, per, words = "understeer", "s^2/m^2", 1.0, "K_us over the wheelbase, above 0: understeer"
    if wheelbase:
        name, unit, per = "understeer_gradient", "deg/g", wheelbase * DEG_PER_G
        words = "K_us, above 0: understeer"
    found = [_quantity(fit, name, unit, per * k, {"understeer": per}, words)]
    low, high = fit.interval({"understeer": 1.0}, k)
    if (low > 0 or high < 0) and speeds[2] > abs(k) ** -0.5 / EXTRAPOLATED:
        name = "characteristic_speed" if k > 0 else "critical_speed"
        words = "highest yaw rate for the steering" if k > 0 else "unstable beyond"
        slopes = {"understeer": 0.5 * abs(k) ** -1.5}
        found.append(_quantity(fit, name, "m/s", 1 / sqrt(abs(k)), slopes, words, 0.0))
    return tuple(found), ()


def _bend(fit: DrivingFit, driving: Driving) -> Iterator[Quantity]:
    """How much less the rover turns in hard turns, where it was driven hard enough."""
    bend = round(fit["bend"] * HARD_TURN**2, 4)
    low, high = fit.interval({"bend": 100 * HARD_TURN**2}, 100 * bend)
    hardest = max(float(np.percentile(np.abs(s.v * s.r), 99)) for s in driving.stretches)
    if high < 50 and hardest > HARD_TURN / EXTRAPOLATED:
        words = f"how much less the rover turns for its steering at {HARD_TURN:g} m/s^2 than in gentle turns"
        yield Quantity("bend", "%", 100 * bend, max(low, 0.0), max(high, 0.0), words)


def _weighted(x: Array, weights: Array) -> tuple[float, float, float]:
    """5, 50 and 95 % points of x (n,) with these weights (n,)."""
    order = np.argsort(x)
    share = np.cumsum(weights[order])
    at = np.searchsorted(share, np.array([0.05, 0.5, 0.95]) * share[-1])
    low, middle, high = x[order[np.minimum(at, x.size - 1)]].tolist()
    return low, middle, high


def _band(used: Sequence[DrivenPart]) -> tuple[float, float]:
    """(5 %, 95 %) points [Hz] of the power of the steering's changes."""
    power: Array = np.zeros(256)
    hz: Array = np.fft.rfftfreq(510, 1 / RATE).astype(np.float64)
    for s in used:
        x = s.steered(0.0)
        for first in range(0, x.size - 510, 255):
            part = x[first : first + 510]
            power += np.square(np.abs(np.fft.rfft((part - part.mean()) * np.hanning(510))))
    if not power.any():
        return 0.0, 0.0
    low, _, high = _weighted(hz, power)
    return low, high


def _after_sweep(
    fit: DrivingFit, driving: Driving, speeds: tuple[float, float, float], wheelbase: float | None
) -> tuple[tuple[str, float], ...]:
    """{number: half width} of the intervals if `SWEEP` at `SWEEP_SPEED` were added to the driving."""
    t = np.arange(0.0, SWEEP.duration, 1 / RATE)
    speed = min(SWEEP_SPEED, sqrt(HARD_TURN / abs(fit["gain"] * SWEEP.amplitude)))
    steering = Signal(t, fit["straight"] + SWEEP.wave(t), "us")
    of_sweep = DrivenPart(
        "sweep", t, np.full(t.size, speed), np.zeros(t.size), steering, driving.stretches[0].low_pass
    )
    better = precision_with(fit, driving.stretches, driving.known, of_sweep)
    numbers, _ = _numbers(better, driving, speeds, wheelbase)
    return tuple((q.name, (q.high - q.low) / 2) for q in numbers if q.low is not None and q.high is not None)


# Whether several logs agree.


CHANCE = 0.001  # of numbers that are said to disagree and do not
ALIKE = 1.2  # ratio of speeds up to which response times are compared


COMPARED = {
    "straight": 0.0,
    "curvature": 0.05,
    "wheelbase_seen": 0.05,
    "full_radius": 0.05,
    "response_time": 0.1,
}
LEAST = {"us": 5.0, "rad": 0.005, FULL: 0.01, "s": 0.02}
"""The smallest reported difference: as a share of the number, and in its unit."""


def disagreeing(logs: Sequence[tuple[ByName[Quantity], float]]) -> tuple[str, ...]:
    """Names of the numbers that differ between the logs by more than their intervals and noticeably.

    logs: the numbers of each, and the speed of its turns [m/s], on which the response time depends. Of a
    number in k logs, the squared differences from the weighted mean in standard deviations add up to chi
    squared with k - 1 degrees of freedom.
    """
    found = []
    speeds = [speed for _, speed in logs]
    alike = max(speeds, default=0.0) < ALIKE * min(speeds, default=0.0)
    for name, share in COMPARED.items():
        known = [numbers[name] for numbers, _ in logs if name in numbers]
        ends = [q.interval_90 or (-np.inf, np.inf) for q in known]
        if len(known) < 2 or (name == "response_time" and not alike):
            continue
        value = np.array([q.value for q in known])
        weight = np.square(2 * NORMAL_90 / np.maximum(np.diff(ends)[:, 0], 1e-9))
        mean = float(weight @ value / weight.sum())
        squares = float(weight @ np.square(value - mean))
        matters = LEAST.get(known[0].unit, 0.0) + share * abs(mean)
        if np.ptp(value) > matters and chi2.sf(squares, len(known) - 1) < CHANCE:
            found.append(name)
    return tuple(found)
