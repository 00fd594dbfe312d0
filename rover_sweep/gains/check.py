"""Checks from a log of driving in ACRO or AUTO if the gains suit the rover, and what to change next."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.controller_log import ControllerLog
from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.gains.controller import simulate_loop
from rover_sweep.gains.identified import Identified
from rover_sweep.gains.proposal import REACH, family_of
from rover_sweep.gains.steering_chain import Autopilot, Gains, SampledPlant, autopilot
from rover_sweep.gains.target_loop import swinging_target, target_loop
from rover_sweep.gains.tracking import (
    Even,
    Limited,
    Oscillation,
    Response,
    Tracking,
    against,
    even_stretches,
    held_feed_forward,
    limited,
    oscillation,
    response,
    tracking,
    while_moving,
)
from rover_sweep.gains.tuning import MOST_CHANGE, beside_integrator, bound

LOWEST_FF, HIGHEST_FF = 0.75, 1.25  # of the output of a steady turn: outside, FF is wrong
LEAST_FIT = 0.5  # share of the turn rate's variance; below it the steering's response is not known
TURNED = -0.7  # correlation of turn rate and output; the controller then steers away from its target
LEAST_TURNING = math.radians(3.0)  # rms of the target, rad/s; below it nothing is judged
LEAST_SHARE_OF_TARGET = 0.5  # rms of a swinging target's line over that of the target
LEAST_OSCILLATION = math.radians(1.5)  # rad/s rms
LEAST_SPEED_OSCILLATION = 0.05  # m/s rms
LEAST_SHARE = 0.05  # of the driving time: shorter at a limit is normal
LONG_RAMP, LAGS_OF_RAMP = 0.5, 3.0  # s, and lags of the rover: a longer ramp slows the turn down
RAISE_G = 1.25  # factor by which ATC_TURN_MAX_G is raised at once: the rover may tip over
WIDE = 1.0  # of FF: an interval this wide says nothing; turns that were held at the stops may say more
USUAL_LAG = 0.2  # s, of a rover whose turns at the stops do not show it
STEADY = 0.3  # m/s^2; a target speed that changes less is steady
SIMULATED_HZ = 100.0  # highest main loop rate of a simulated drive


@dataclass(frozen=True)
class GainFault:
    """A change to make. name: two words; words: a sentence with the evidence; parameter with its value
    now and the next one, "" and nan if no parameter helps."""

    name: str
    words: str
    parameter: str = ""
    now: float = math.nan
    value: float = math.nan


@dataclass(frozen=True, eq=False)
class SteeringCheck:
    """Check of a log with constant parameters. feed_forward: FF that holds a steady turn with its 90 %
    interval, None if it is not known; predicted: by the identified model for the same targets, None without
    one; after: prediction with the first finding's change, by that model or the log's own response, None if
    no gain changes. skipped: sentences on what could not be checked."""

    log: ControllerLog
    autopilot: Autopilot
    achieved: Tracking
    response: Response | None
    feed_forward: tuple[float, float, float] | None
    oscillation: Oscillation | None
    limits: tuple[Limited, ...]
    findings: tuple[GainFault, ...]
    predicted: Tracking | None = None
    after: Tracking | None = None
    skipped: tuple[str, ...] = ()

    @property
    def speed(self) -> float:
        """Mean forward speed of the driving [m/s], negative in reverse."""
        return float(np.mean(while_moving(self.log).speed))


def check_steering(log: ControllerLog, found: Identified | None = None) -> SteeringCheck:
    """Check the steering rate controller. found: an identified model of the rover.

    ValueError for a log without driving.
    """
    loop, rows = autopilot({**_gains_of_terms(log), **log.parameters}), while_moving(log)
    parts = even_stretches(rows)
    if not parts:
        raise ValueError(f"{log.name}: the rover did not drive for 2 s or more with the controller on")
    achieved, limits = tracking(parts), limited(rows, loop)
    if achieved.target_rms < LEAST_TURNING:
        words = (
            f"the target turn rate is {math.degrees(achieved.target_rms):.1f} deg/s rms, too little to judge "
            "the gains: drive turns to both sides"
        )
        return SteeringCheck(log, loop, achieved, None, None, None, limits, (), skipped=(words,))
    if (turned := against(parts, loop)) < TURNED:
        return SteeringCheck(log, loop, achieved, None, None, None, limits, (_reversed(loop, turned),))
    swing, fitted = oscillation(rows, parts, LEAST_OSCILLATION), response(parts, loop)
    skipped: tuple[str, ...] = ()
    right = None
    share = 0.0 if fitted is None else fitted.fit
    if fitted is not None and fitted.fit >= LEAST_FIT:
        ends = sorted(replace(fitted, gain=end).feed_forward(loop) for end in fitted.interval)
        right = (fitted.feed_forward(loop), ends[0], ends[1])
    if right is None or right[2] - right[1] > WIDE * right[0]:
        fitted, right = None, held_feed_forward(parts, loop) or right
        if right is None:
            skipped = (f"FF: the steering explains only {100 * share:.0f} % of the turn rate",)
    if swing is not None:
        skipped += ("FF and the stops: check again when the loop no longer oscillates",)
    if found is not None and found.structure is not None and not found.has_servo:
        skipped += ("the prediction: the model may lack the servo; `gains` without --check says why",)
    findings = (
        *_oscillates(swing, loop.gains, "ATC_STR_RAT", "deg/s", math.degrees(1.0)),
        *(_feed_forward(loop.gains, fitted, right) if swing is None else ()),
        *_limits([limit for limit in limits if limit.parameter or swing is None], loop, fitted),
        *_target_swings(rows, parts, achieved),
    )
    plant = _identified(found, fitted, loop)
    own = _own(fitted, loop)
    changed = _changed(loop.gains, findings)
    after = plant or own
    return SteeringCheck(
        log,
        loop,
        achieved,
        fitted,
        right,
        swing,
        limits,
        findings,
        _simulated(parts, plant, loop.gains) if plant else None,
        _simulated(parts, after, changed) if after and changed else None,
        skipped,
    )


def _gains_of_terms(log: ControllerLog) -> dict[str, float]:
    """FF and P from the logged terms, for a log without parameters."""
    pairs = {"FF": (log.ff, log.target), "P": (log.p, log.target - log.actual)}
    return {
        f"ATC_STR_RAT_{name}": max(float(term @ of / (of @ of)), 0.0)
        for name, (term, of) in pairs.items()
        if of @ of > 0
    }


def _reversed(loop: Autopilot, turned: float) -> GainFault:
    name = f"SERVO{loop.servo}_REVERSED"
    words = (
        f"the rover turns to the other side of the controller's output (correlation {turned:.2f}), so the "
        "controller steers away from its target and no gain helps. If the stick in MANUAL steers to the "
        f"wrong side too, {name} is wrong; if not, RC1_REVERSED hides it there. If {name} is right, the gyro "
        "is not mounted as AHRS_ORIENTATION says"
    )
    return GainFault("steering reversed", words, name, float(loop.reversed), float(not loop.reversed))


def _target_swings(rows: ControllerLog, parts: Sequence[Even], achieved: Tracking) -> Iterator[GainFault]:
    """A target that itself swings, which no gain of this controller ends."""
    swing = swinging_target(parts, max(LEAST_TURNING, LEAST_SHARE_OF_TARGET * achieved.target_rms))
    made_by = target_loop(rows.mode, rows.parameters, swing.hz) if swing else None
    if swing is None or made_by is None:  # the pilot swings the stick
        return
    words = (
        f"the target turn rate itself swings at {swing.hz:.2g} Hz with {math.degrees(swing.rms):.2g} deg/s "
        f"rms ({100 * swing.share:.0f} % of it), unless the mission weaves so: {made_by.name} makes it"
    )
    others = made_by.parameters[1:] if made_by.parameters else ()
    words += f"; look at {' and '.join(others)} too" if others else ""
    words += f"; the rover follows {achieved.lag:.2f} s late, which adds to it"
    first = made_by.parameters[0] if made_by.parameters and math.isfinite(made_by.value) else ""
    yield GainFault("target swings", words, first, made_by.now, made_by.value)


def _oscillates(
    swing: Oscillation | None, gains: Gains, controller: str, unit: str, per: float
) -> Iterator[GainFault]:
    if swing is None:
        return
    now = float(getattr(gains, swing.term.lower()))
    yield GainFault(
        "oscillates",
        f"at {swing.hz:.1f} Hz with {per * swing.rms:.2g} {unit} rms, which is not in the target; "
        f"{swing.term} makes {100 * swing.shares[swing.term]:.0f} % of it in the output",
        f"{controller}_{swing.term}",
        now,
        float(f"{now / 2:.3g}"),
    )


def _feed_forward(
    gains: Gains, fitted: Response | None, right: tuple[float, float, float] | None
) -> Iterator[GainFault]:
    if right is None:
        return
    steady, low, high = right
    share = gains.ff / steady
    if gains.ff / low >= LOWEST_FF and gains.ff / high <= HIGHEST_FF:
        return
    late = USUAL_LAG if fitted is None else fitted.lag + fitted.delay
    wanted = float(beside_integrator(steady, np.array([gains.i]), late)[0])
    value = float(f"{min(wanted, bound('ATC_STR_RAT_FF', gains.ff)):.3g}")
    yield GainFault(
        "FF too low" if share < 1 else "FF too high",
        f"ATC_STR_RAT_FF is {100 * share:.0f} % of the output that holds a turn: {steady:.3g} "
        f"({low:.3g} to {high:.3g})",
        "ATC_STR_RAT_FF",
        gains.ff,
        value,
    )


def _limits(limits: Sequence[Limited], loop: Autopilot, fitted: Response | None) -> Iterator[GainFault]:
    reach = math.inf if fitted is None else fitted.gain * abs(fitted.speed)
    for limit in limits:
        if limit.share >= LEAST_SHARE and (found := _LIMITS[limit.parameter](limit, loop, fitted, reach)):
            yield found


def _at(limit: Limited) -> str:
    return f"{limit.seconds:.1f} s ({100 * limit.share:.0f} % of the driving)"


def _rate_limit(limit: Limited, loop: Autopilot, fitted: Response | None, reach: float) -> GainFault:
    now, most = math.degrees(loop.rate_max), math.degrees(REACH * reach)
    words = f"the target was at ATC_STR_RAT_MAX {now:.0f} deg/s for {_at(limit)}"
    value = math.floor(min(MOST_CHANGE * now, most))
    if value <= now:
        return GainFault(
            "limit hit", f"{words}; the steering reaches {most / REACH:.0f} deg/s, so ask for less"
        )
    return GainFault("limit hit", words, "ATC_STR_RAT_MAX", now, value)


def _force_limit(limit: Limited, loop: Autopilot, fitted: Response | None, reach: float) -> GainFault:
    now = loop.lateral_g_max
    words = f"the target was at ATC_TURN_MAX_G {now:.2g} g for {_at(limit)}"
    most = math.inf if fitted is None else REACH * reach * abs(fitted.speed) / STANDARD_GRAVITY
    value = math.floor(100 * min(RAISE_G * now, most)) / 100
    if value <= now:
        return GainFault("limit hit", f"{words}; the steering reaches no more, so drive turns slower")
    flat = "raise it only if the rover stays flat on its wheels, or drive turns slower"
    return GainFault("limit hit", f"{words}; {flat}", "ATC_TURN_MAX_G", now, value)


def _acceleration_limit(
    limit: Limited, loop: Autopilot, fitted: Response | None, reach: float
) -> GainFault | None:
    slow = LONG_RAMP if fitted is None else max(LONG_RAMP, LAGS_OF_RAMP * (fitted.lag + fitted.delay))
    if limit.ramp < slow:
        return None
    now = math.degrees(loop.accel_max)
    words = (
        f"the target was at ATC_STR_ACC_MAX {now:.0f} deg/s^2 for {_at(limit)}, {limit.ramp:.1f} s at a time"
    )
    return GainFault("limit hit", words, "ATC_STR_ACC_MAX", now, MOST_CHANGE * now)


def _stops(limit: Limited, loop: Autopilot, fitted: Response | None, reach: float) -> GainFault:
    words = f"the steering was at its stops for {_at(limit)}"
    now, value = math.degrees(loop.rate_max), math.degrees(REACH * reach)
    if not math.isfinite(value) or 0 < now <= value:
        return GainFault(
            "limit hit", f"{words}, though the target is within reach: lower the gain named above"
        )
    full = f"{words}: it turns at {math.degrees(reach):.0f} deg/s at most"
    return GainFault("limit hit", full, "ATC_STR_RAT_MAX", now, math.floor(value))


_LIMITS: dict[str, Callable[[Limited, Autopilot, Response | None, float], GainFault | None]] = {
    "ATC_STR_RAT_MAX": _rate_limit,
    "ATC_TURN_MAX_G": _force_limit,
    "ATC_STR_ACC_MAX": _acceleration_limit,
    "": _stops,
}


# Predicted drives: the logged targets through a model.

Modelled = tuple[SampledPlant, float, Autopilot]
"""Plant, road-wheel angle per output of 1, and the loop that it is sampled for."""


def _identified(found: Identified | None, fitted: Response | None, loop: Autopilot) -> Modelled | None:
    if found is None or found.structure is None or found.rad_per_us is None or fitted is None:
        return None
    if not found.has_servo:  # a drive without its servo would be predicted
        return None
    slower = _slower(loop)
    family = family_of(replace(found, intervals={}), slower, abs(fitted.speed))
    return (family.nominal, family.angle_per_output[0], slower) if family.nominal.stable else None


def _own(fitted: Response | None, loop: Autopilot) -> Modelled | None:
    return None if fitted is None else (fitted.plant(_slower(loop)), 1.0, _slower(loop))


def _slower(loop: Autopilot) -> Autopilot:
    return replace(loop, loop_hz=min(loop.loop_hz, SIMULATED_HZ))


def _changed(gains: Gains, findings: Sequence[GainFault]) -> Gains | None:
    """The gains with the first finding's change; None if it changes no gain."""
    first = findings[0].parameter if findings else ""
    name = first.removeprefix("ATC_STR_RAT_").lower()
    if not first.startswith("ATC_STR_RAT_") or name not in ("ff", "p", "i", "d"):
        return None
    return replace(gains, **{name: findings[0].value})


def _simulated(parts: Sequence[Even], modelled: Modelled, gains: Gains) -> Tracking:
    plant, angle, slower = modelled
    p, i, ff = (np.array([g]) for g in (gains.p, gains.i, gains.ff))
    driven = []
    for part in parts:
        t = np.arange(part.target.size) * part.dt
        wanted = np.interp(np.arange(0.0, t[-1] + slower.period, slower.period), t, part.target)
        drive = simulate_loop(slower, plant, angle, wanted, p, i, ff, gains)
        driven.append(replace(part, actual=np.interp(t, drive.t, drive.rate[:, 0])))
    return tracking(driven)


# The speed controller.


@dataclass(frozen=True, eq=False)
class SpeedCheck:
    """Check of a log with constant parameters. cruise: CRUISE_THROTTLE [%] that holds CRUISE_SPEED with its
    90 % interval, None if no steady speed was driven."""

    log: ControllerLog
    achieved: Tracking
    oscillation: Oscillation | None
    cruise: tuple[float, float, float] | None
    findings: tuple[GainFault, ...]


def check_speed(log: ControllerLog) -> SpeedCheck | None:
    """Check the speed controller; None for a log without driving."""
    rows = while_moving(log)
    parts = even_stretches(rows)
    if not parts:
        return None
    swing, cruise = oscillation(rows, parts, LEAST_SPEED_OSCILLATION), _cruise(rows)
    p = log.parameters
    gains = Gains(0.0, *(p.get(f"ATC_SPEED_{name}", 0.0) for name in "PID"))
    findings = (*_oscillates(swing, gains, "ATC_SPEED", "m/s", 1.0), *_base_throttle(log, cruise))
    return SpeedCheck(log, tracking(parts), swing, cruise, findings)


def _cruise(rows: ControllerLog) -> tuple[float, float, float] | None:
    """CRUISE_THROTTLE [%] for CRUISE_SPEED and its 90 % interval, from the output at steady targets."""
    at = rows.parameters.get("CRUISE_SPEED", 0.0)
    steady = np.abs(np.gradient(rows.target, rows.t)) < STEADY
    steady &= np.abs(rows.actual) > 0.5 * np.abs(rows.target)
    share = (rows.output / rows.actual)[steady & (np.abs(rows.actual) > 0)]
    if not at > 0 or share.size < 20:
        return None
    blocks = [100 * at * float(np.median(block)) for block in np.array_split(share, 10)]
    low, middle, high = np.percentile(blocks, [5, 50, 95])
    return float(middle), float(low), float(high)


def _base_throttle(log: ControllerLog, cruise: tuple[float, float, float] | None) -> Iterator[GainFault]:
    now = log.parameters.get("CRUISE_THROTTLE", 0.0)
    if cruise is None or not now > 0:
        return
    steady, low, high = cruise
    if low > 0 and (now / low < LOWEST_FF or now / high > HIGHEST_FF):
        at = log.parameters["CRUISE_SPEED"]
        words = f"{steady:.0f} % ({low:.0f} to {high:.0f} %) hold CRUISE_SPEED {at:g} m/s, not {now:.0f} %"
        yield GainFault("base throttle wrong", words, "CRUISE_THROTTLE", now, round(min(steady, 100.0)))
