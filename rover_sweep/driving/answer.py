"""What any driving says of a rover: how much and how late it turns for its steering, and what is unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi, sqrt
from typing import Literal

import numpy as np

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.recording import Array, Signal
from rover_sweep.data.results import ByName, Quantity, ShortTable, Shown, ends_words, number, plain_number
from rover_sweep.driving.agreement import disagreeing
from rover_sweep.driving.fit import OF_SPEED, DrivingFit, fit_driving, precision_with, reached, tyre_time
from rover_sweep.driving.stretches import RATE, DrivenPart, Driving, usable_driving
from rover_sweep.driving.tyres import tyre_stiffnesses
from rover_sweep.logs.log import Log
from rover_sweep.manoeuvre.sweep import Sweep

Level = Literal["good", "rough", "none"]

GOOD, ROUGH = 0.9, 0.7  # shares of the yaw rate that the law must give in driving it was not fitted to
LEAST_SECONDS = 8.0  # of usable driving
SPEEDS_APART = 1.3  # ratio of the speeds in turns, from which they show what depends on speed
HARD_TURN = 3.0  # m/s^2, at which the bend of the tyres is told
EXTRAPOLATED = 1.5  # what is told of faster or harder turns is at most so far beyond those driven
KNOWN = 0.5  # of a value; a wider half interval makes it unknown
VISIBLE = (
    0.03  # of the curvature: smaller differences between the sides, and bends of the curve, are not told
)
SWEEP, SWEEP_SPEED = Sweep(amplitude=120.0), 2.0  # advised; us, m/s
NO_TYRES = "Tyre stiffnesses and yaw inertia, which need sweeps and a vehicle file with the mass"
NO_TYRES_KNOWN = "Tyre stiffnesses, which need sweeps, or yaw_inertia and turns at speeds further apart"
DEG_PER_G = GRAVITY * 180 / pi


@dataclass(frozen=True, eq=False, repr=False)
class DrivingAnswer(Shown):
    """The numbers that this driving shows, each with its 90 % interval.

    level: "good", "rough", or "none" where nothing is believed; reasons: why it is not good. numbers: see
    `rs.identify_driving`. unknown: what the driving cannot show, and why. driving: what was used; fit: None
    where nothing could be fitted. speeds: (5 %, 50 %, 95 %) of the speed in turns, m/s. amplitude: 95 % of
    the time, the steering is within +- it of straight ahead. band: (lowest, highest) Hz that hold 90 % of the
    steering's power. after_sweep: (number, half width of its interval) if a sweep were added. each: {file:
    its own answer} of files that do not agree, of which there are no common numbers.
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
    """What these logs show together, or each file of its own where their numbers disagree.

    wheelbase [m] turns some numbers into physical ones, and so do the known numbers of the rover.
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
    fit = fit_driving(used, driving.known, held)
    level, reasons = _judged(fit)
    if level == "none":
        return _nothing(driving, *reasons, fit=fit)
    numbers, unknown = _numbers(fit, driving, speeds, wheelbase)
    tyres = tyre_stiffnesses(fit, rover, speeds[1]) if rover else ()
    numbers = ByName((*numbers, *tyres))
    unknown += () if tyres else (NO_TYRES_KNOWN if rover else NO_TYRES,)
    amplitude = float(np.percentile(np.abs(steering - fit["straight"]), 95))
    better = _after_sweep(fit, driving, speeds, wheelbase) if driving.unit == "us" else ()
    return DrivingAnswer(
        level, numbers, reasons, unknown, driving, fit, speeds, amplitude, _band(used), better
    )


def _nothing(driving: Driving, *reasons: str, fit: DrivingFit | None = None) -> DrivingAnswer:
    """No numbers, with what was left out of the driving."""
    out = [f"{seconds:.0f} s left out: {why}" for why, seconds in driving.left_out.items() if seconds >= 1]
    return DrivingAnswer("none", ByName(()), (*reasons, *out), (), driving, fit)


def _judged(fit: DrivingFit) -> tuple[Level, tuple[str, ...]]:
    """The level, and why it is not good."""
    low, high = fit.interval({"gain": 1.0}, fit["gain"])
    share = f"the steering explains {100 * max(fit.explained, 0.0):.0f} % of the yaw rate"
    if low <= 0 <= high or (high - low) / 2 > KNOWN * abs(fit["gain"]):
        why = (
            f"{share}, but this is too little driving"
            if fit.explained >= ROUGH
            else ("the yaw rate does not follow the steering in this driving")
        )
        return "none", (why,)
    if fit.explained < ROUGH:
        return "none", (
            f"{share} in parts of the drive that were not fitted; {100 * ROUGH:.0f} % are needed",
        )
    if fit.explained < GOOD:
        return "rough", (
            f"{share} only: the rover turned for other reasons too, or its steering is not linear",
        )
    return "good", ()


def _numbers(
    fit: DrivingFit, driving: Driving, speeds: tuple[float, float, float], wheelbase: float | None
) -> tuple[ByName[Quantity], tuple[str, ...]]:
    """The quantities that are shown, and sentences on those that are not."""
    out, unknown = [], []
    gain, v = fit["gain"], speeds[1]

    def add(
        name: str, unit: str, value: float, slopes: dict[str, float], meaning: str, least: float = -np.inf
    ) -> None:
        low, high = fit.interval(slopes, value)
        out.append(Quantity(name, unit, value, max(low, least), max(high, least), meaning))

    in_us = driving.unit == "us"
    at = f", at {v:.1f} m/s" if "understeer" in fit.held else ""
    if in_us:
        turns = "left" if gain > 0 else "right"
        words = f"curvature of the path for each 100 us{at}; a larger output turns {turns}"
        add("curvature", "1/m per 100 us", 100 * abs(gain), {"gain": 100.0}, words)
        add(
            "straight", "us", fit["straight"], {"straight": 1.0}, "steering output that drives straight ahead"
        )
    else:
        add(
            "wheelbase_seen",
            "m",
            1 / abs(gain),
            {"gain": 1 / gain**2},
            f"speed times steering angle over yaw rate{at}; the wheelbase where the angle is right",
        )
        add(
            "straight", "rad", fit["straight"], {"straight": 1.0}, "steering angle that drives straight ahead"
        )
    if wheelbase:
        if in_us:
            words = "road-wheel angle for each us"
            add("rad_per_us", "rad/us", abs(gain) * wheelbase, {"gain": wheelbase}, words)
        else:
            ratio = 1 / (abs(gain) * wheelbase)
            words = "recorded steering angle over the wheels' angle: 1 where it is the wheels' own"
            add("steering_ratio", "-", ratio, {"gain": ratio / gain}, words)
    if in_us and driving.limits:
        x = np.array(driving.limits) - fit["straight"]
        share = reached(x, fit.amplitude)
        bent = 1 + fit["side"] * np.sign(x) + fit["curve"] * share
        end = int(np.argmax(np.abs(x * bent)))
        least = float(1 / np.abs(gain * x * bent)[end])
        slopes = {"gain": least / gain, "side": least / bent[end], "curve": least * share[end] / bent[end]}
        words = "radius of the tightest turn that the servo's ends allow"
        add("least_radius", "m", least, slopes, words)
    low, high = fit.interval({"side": 1.0}, fit["side"])
    if (low > 0 or high < 0) and abs(fit["side"]) > VISIBLE:
        for side, sign in (("left", np.sign(gain)), ("right", -np.sign(gain))):
            there = 1 + sign * fit["side"]
            slopes = {"gain": there, "side": sign * gain}
            if in_us:
                value, scale, name, unit = (
                    100 * abs(gain) * there,
                    100.0,
                    f"curvature_{side}",
                    "1/m per 100 us",
                )
            else:
                value = 1 / (abs(gain) * there)
                scale, name, unit = value**2, f"wheelbase_seen_{side}", "m"
            slopes = {n: scale * slope for n, slope in slopes.items()}
            add(name, unit, value, slopes, f"the same in turns to the {side}")
    low, high = fit.interval({"curve": 1.0}, fit["curve"])
    if (low > 0 or high < 0) and abs(fit["curve"]) > VISIBLE:
        far = f"{number(fit.amplitude, 3)} {driving.unit}"
        words = (
            f"how much more than in proportion the steering turns {far} from straight; below 0: it saturates"
        )
        add("steering_curve", "%", 100 * fit["curve"], {"curve": 100.0}, words)
    k, tyres = fit["understeer"], tyre_time(fit["tyre_lag"], fit["understeer"], np.array([v]))[0]
    softer = tyre_time(fit["tyre_lag"], k + 1e-6, np.array([v]))[0]
    per = v if not fit["tyre_lag"] else tyres / fit["tyre_lag"]
    lag = {"lag": 1.0, "tyre_lag": per, "understeer": 1e6 * (softer - tyres)}
    add("delay", "s", fit["delay"], {"delay": 1.0}, "pure delay from the output to the turn", 0.0)
    words = f"time constant with which the turn follows at {v:.1f} m/s"
    add("lag", "s", fit["lag"] + tyres, lag, words, 0.0)
    whole = fit["delay"] + out[-1].value
    add("response_time", "s", whole, {"delay": 1.0, **lag}, "delay and lag together", 0.0)
    late = out[-1]
    if late.low is not None and late.high is not None and late.high - late.low > 2 * KNOWN * late.value:
        del out[-3:]
        ends = f"{1000 * late.low:.0f} to {1000 * late.high:.0f} ms"
        unknown.append(
            f"How late the turn follows: only {ends} is certain. Steer left and right more quickly"
        )
    if "understeer" in fit.held:
        unknown.append(
            f"Under- or oversteer: all turns were driven at {speeds[0]:.1f} to {speeds[2]:.1f} m/s. Drive "
            f"turns at two speeds, such as {speeds[1] / 1.5:.1f} and {speeds[1] * 1.5:.1f} m/s"
        )
    else:
        low, high = fit.interval({"understeer": 1.0}, fit["understeer"])
        if wheelbase:
            per = wheelbase * DEG_PER_G
            add(
                "understeer_gradient",
                "deg/g",
                per * fit["understeer"],
                {"understeer": per},
                "K_us, above 0: understeer",
            )
        else:
            add(
                "understeer",
                "s^2/m^2",
                fit["understeer"],
                {"understeer": 1.0},
                "K_us over the wheelbase, above 0: understeer",
            )
        if (low > 0 or high < 0) and speeds[2] > abs(fit["understeer"]) ** -0.5 / EXTRAPOLATED:
            k = fit["understeer"]
            name = "characteristic_speed" if k > 0 else "critical_speed"
            words = "highest yaw rate for the steering" if k > 0 else "unstable beyond"
            add(name, "m/s", 1 / sqrt(abs(k)), {"understeer": 0.5 * abs(k) ** -1.5}, words, 0.0)
    bend = round(fit["bend"] * HARD_TURN**2, 4)
    low, high = fit.interval({"bend": 100 * HARD_TURN**2}, 100 * bend)
    hardest = max(float(np.percentile(np.abs(s.v * s.r), 99)) for s in driving.stretches)
    if high < 50 and hardest > HARD_TURN / EXTRAPOLATED:
        out.append(
            Quantity(
                "bend",
                "%",
                100 * bend,
                max(low, 0.0),
                max(high, 0.0),
                f"how much less the rover turns for its steering at {HARD_TURN:g} m/s^2 than in gentle turns",
            )
        )
    return ByName(out), tuple(unknown)


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
