"""Checks of how fast and how true the data come: loop rate, the sensors' filters, streams, clock."""

from __future__ import annotations

from math import atan2, ceil, degrees, hypot, isnan, pi, sqrt

from rover_sweep.manoeuvre.applet_values import LEAST_SAMPLES
from rover_sweep.vehicle.link.streams import fastest_interval_ms, poor_words
from rover_sweep.vehicle.preflight.item import Check, Remedy, State
from rover_sweep.vehicle.preflight.observed import Observation

LOOP_RATE = 100  # Hz, as identification.param: streams of 50 Hz, and scripts wait 17 instead of 72 ms
CUTOFF = 20.0  # Hz, as identification.param
_FILTERS = {"INS_GYRO_FILTER": "gyro", "INS_ACCEL_FILTER": "accelerometer"}
_CLEAR, _SPOILT = 4.0, 2.0  # cut-off over the top frequency: 21 deg and 43 deg of phase at the top
_TIMELY, _LATE = 0.05, 0.2  # s of jitter of the arrival
_FAR = 3600.0  # s
_LIVE = 0.02  # the clocks' rates differ by more only in a simulation that is not in real time
_GAP = 3.0  # intervals: in so short a look a longer one is no chance


def loop_rate(seen: Observation) -> Check:
    """SCHED_LOOP_RATE against the streams that are wanted and the top of the sweep."""
    rate = seen.parameter("SCHED_LOOP_RATE")
    if isnan(rate):
        return Check("loop_rate", "unknown", "not told", "the rover has no SCHED_LOOP_RATE")
    told = f"{rate:.0f} Hz"
    samples = 2 * pi * rate / seen.w_max
    needed = max(LOOP_RATE, 100 * ceil(seen.w_max * LEAST_SAMPLES / (2 * pi) / 100))
    remedy = _faster(needed)
    if samples < LEAST_SAMPLES:
        sentence = (
            f"{seen.w_max:g} rad/s has {samples:.1f} samples a period at {rate:.0f} Hz, "
            f"and {LEAST_SAMPLES} are needed"
        )
        return Check("loop_rate", "bad", told, sentence, remedy)
    if "SCHED_LOOP_RATE" in seen.pending:
        return Check("loop_rate", "bad", told, "it counts after a reboot only", Remedy("reboot", reboot=True))
    if rate < LOOP_RATE:
        fastest = 1000 / fastest_interval_ms(rate)
        sentence = (
            f"streams end at {fastest:.0f} Hz and a script may wait 72 ms at a loop rate of {rate:.0f} Hz"
        )
        return Check("loop_rate", "bad", told, sentence, remedy)
    return Check("loop_rate", "good", told, f"{samples:.0f} samples a period at {seen.w_max:g} rad/s")


def _faster(loop: int) -> Remedy:
    sets = (("SCHED_LOOP_RATE", float(loop)),)
    return Remedy(f"set SCHED_LOOP_RATE to {loop} and reboot", reboot=True, sets=sets)


def filters(seen: Observation) -> Check:
    """The low-passes of gyro and accelerometer against the top of the sweep, and what they cost.

    ArduPilot's are of second order, Butterworth (LowPassFilter2p, 4.6.3): lag sqrt(2) / (2 pi fc) at low
    frequency. The tool puts the known filters into the models, but cannot bring back what they took.
    """
    cutoffs = {name: seen.parameter(name) for name in _FILTERS}
    if any(isnan(fc) for fc in cutoffs.values()):
        return Check("filters", "unknown", "not told", "the rover has no INS_GYRO_FILTER or INS_ACCEL_FILTER")
    told = ", ".join(
        f"{_FILTERS[name]} {fc:g} Hz" if fc else f"{_FILTERS[name]} off" for name, fc in cutoffs.items()
    )
    top = seen.w_max / (2 * pi)
    worst_name, worst = min(cutoffs.items(), key=lambda item: item[1] or 1e9)
    wanted = max(CUTOFF, 5 * ceil(top))
    raised = tuple((name, wanted) for name, fc in cutoffs.items() if 0 < fc < wanted)
    remedy = Remedy(f"set {' and '.join(name for name, _ in raised)} to {wanted:g} Hz", sets=raised)
    if worst and worst < _CLEAR * top:
        sentence = f"{worst_name} {worst:g} Hz: {cost(worst, top)}"
        return Check("filters", "bad" if worst < _SPOILT * top else "doubtful", told, sentence, remedy)
    folded = [name for name, fc in cutoffs.items() if not fc or fc > 0.4 * seen.parameter("SCHED_LOOP_RATE")]
    if folded:
        sentence = (
            f"{folded[0]} lets vibration through that folds down at the loop rate of "
            f"{seen.parameter('SCHED_LOOP_RATE'):.0f} Hz"
        )
        lower = Remedy(f"set {folded[0]} to {wanted:g} Hz", sets=((folded[0], wanted),))
        return Check("filters", "doubtful", told, sentence, lower)
    return Check("filters", "good", told, cost(worst, top))


def cost(cutoff: float, top: float) -> str:
    """What a second-order Butterworth low-pass takes at `top`, both in Hz, in words."""
    ratio = top / cutoff
    gain = 1 / hypot(1 - ratio**2, sqrt(2) * ratio)
    phase = degrees(atan2(sqrt(2) * ratio, 1 - ratio**2))
    lag = 1000 * sqrt(2) / (2 * pi * cutoff)
    return (
        f"{lag:.0f} ms of lag, gain {gain:.2f} and {phase:.0f} deg of phase "
        f"at the sweep's top of {top:.1f} Hz"
    )


def streams(seen: Observation) -> Check:
    """What was asked, what was granted, and what came in two seconds of the vehicle's clock."""
    denied = [s for s in seen.streams if s.advice]
    came = {q.message: q for q in seen.quality}
    rates = [q.hz for q in seen.quality if q.count > 2]
    slowest = f"{min(rates):.0f} to {max(rates):.0f} Hz" if rates else "nothing came"
    told = f"{len(rates)} of {len(came)}, {slowest}"
    absent = [s.message for s in seen.streams if s.hz and s.message in came and came[s.message].count < 3]
    granted = {s.message: s.hz for s in seen.streams}
    poor = [
        words
        for q in seen.quality
        if q.count > 2 and (words := poor_words(q, hz := granted.get(q.message) or q.hz, _GAP / hz))
    ]
    if not seen.streams:
        return Check("streams", "unknown", "not asked", "no stream was asked for")
    if denied:
        capped = any("SCHED_LOOP_RATE" in s.advice for s in denied)
        remedy = _faster(LOOP_RATE) if capped else None
        return Check("streams", "doubtful", told, "; ".join(s.advice for s in denied), remedy)
    if absent:
        sentence = f"{', '.join(absent)} did not come though granted"
        if absent == ["LOCAL_POSITION_NED"]:
            sentence += ": it comes when the EKF has an origin"
        return Check("streams", "doubtful", told, sentence, Remedy("wait, and look again", by_hand=True))
    if poor:
        hand = Remedy(
            "go closer, take USB or a faster radio; the log on the card does not suffer", by_hand=True
        )
        return Check("streams", "doubtful", told, "; ".join(poor), hand)
    jitter = max((q.jitter_ms for q in seen.quality), default=0.0)
    return Check("streams", "good", told, f"no gap, jitter {jitter:.1f} ms at most")


def clock(seen: Observation) -> Check:
    """The .tlog's clock (arrival here) against the vehicle's (in the messages)."""
    c = seen.clock
    if c is None:
        return Check("clock", "unknown", "not told", "too few messages with a time stamp came")
    told = f"arrival within {1000 * c.jitter:.0f} ms"
    if abs(c.rate - 1) > _LIVE and abs(c.drift) > c.bound:
        sentence = (
            f"the vehicle's clock runs {c.rate:.3g} times as fast as this computer's: a simulation; "
            "the stamps of the .tlog are of no use there, those in the messages are"
        )
        return Check("clock", "good", f"{c.rate:.3g} x", sentence)
    seen_drift = f"drift {1e6 * c.drift:+.0f} ppm" if abs(c.drift) > c.bound else "no drift seen"
    drift = f"{seen_drift}, known to {1e6 * c.bound:.0f} ppm after {c.span:.0f} s"
    off = f"{c.behind_utc:+.1f} s" if abs(c.behind_utc) < _FAR else f"{c.behind_utc / _FAR:+.0f} h"
    utc = "" if isnan(c.behind_utc) else f"; this computer is {off} from GPS time"
    sentence = f"{drift}{utc}"
    if c.jitter > _TIMELY:
        state: State = "bad" if c.jitter > _LATE else "doubtful"
        late = f"messages come up to {1000 * c.jitter:.0f} ms late: only their own time stamps are to be used"
        hand = Remedy("go closer, or take USB", by_hand=True)
        return Check("clock", state, told, f"{late}; {sentence}", hand)
    return Check("clock", "good", told, sentence)
