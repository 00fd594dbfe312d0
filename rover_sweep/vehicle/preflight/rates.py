"""Checks of the data rates and their fidelity: loop rate, sensor filters, streams, clock."""

from __future__ import annotations

from math import atan2, ceil, degrees, hypot, isnan, pi, sqrt

from rover_sweep.manoeuvre.applet_values import LEAST_SAMPLES
from rover_sweep.vehicle.link.streams import fastest_interval_ms, stream_fault
from rover_sweep.vehicle.preflight.item import Check, Remedy, State
from rover_sweep.vehicle.preflight.observed import Observation

LOOP_RATE = 100  # Hz, as identification.param: allows streams of 50 Hz; scripts wait 17 instead of 72 ms
CUTOFF = 20.0  # Hz, as identification.param
_FILTERS = {"INS_GYRO_FILTER": "gyro", "INS_ACCEL_FILTER": "accelerometer"}
_CLEAR, _SPOILT = 4.0, 2.0  # cut-off over the top frequency: phase lag of 21 deg and 43 deg at the top
_TIMELY, _LATE = 0.05, 0.2  # s of jitter of the arrival
_HOUR = 3600.0  # s
_REAL_TIME = 0.02  # the clocks' rates differ by more only in a simulation that is not in real time
_GAP = 3.0  # intervals: in such a short measurement, a longer gap is not chance


def loop_rate(observed: Observation) -> Check:
    """SCHED_LOOP_RATE against the rates of the streams and the top frequency of the sweep."""
    rate = observed.parameter("SCHED_LOOP_RATE")
    if isnan(rate):
        return Check("loop_rate", "unknown", "not reported", "the rover has no SCHED_LOOP_RATE")
    value = f"{rate:.0f} Hz"
    samples = 2 * pi * rate / observed.w_max
    needed = max(LOOP_RATE, 100 * ceil(observed.w_max * LEAST_SAMPLES / (2 * pi) / 100))
    remedy = _faster(needed)
    if samples < LEAST_SAMPLES:
        sentence = (
            f"{observed.w_max:g} rad/s has only {samples:.1f} samples a period at {rate:.0f} Hz, "
            f"and {LEAST_SAMPLES} are needed"
        )
        return Check("loop_rate", "bad", value, sentence, remedy)
    if "SCHED_LOOP_RATE" in observed.pending:
        return Check(
            "loop_rate", "bad", value, "it takes effect after a reboot", Remedy("reboot", reboot=True)
        )
    if rate < LOOP_RATE:
        fastest = 1000 / fastest_interval_ms(rate)
        sentence = (
            f"at a loop rate of {rate:.0f} Hz, streams are limited to {fastest:.0f} Hz and a script may wait "
            "72 ms"
        )
        return Check("loop_rate", "bad", value, sentence, remedy)
    return Check("loop_rate", "good", value, f"{samples:.0f} samples a period at {observed.w_max:g} rad/s")


def _faster(loop: int) -> Remedy:
    sets = (("SCHED_LOOP_RATE", float(loop)),)
    return Remedy(f"set SCHED_LOOP_RATE to {loop} and reboot", reboot=True, sets=sets)


def filters(observed: Observation) -> Check:
    """The low-pass filters of gyro and accelerometer against the top frequency of the sweep.

    ArduPilot uses second-order Butterworth filters (LowPassFilter2p, 4.6.3): lag sqrt(2) / (2 pi fc) at low
    frequency. The models include the known filters, but cannot restore the signal that they removed.
    """
    cutoffs = {name: observed.parameter(name) for name in _FILTERS}
    if any(isnan(fc) for fc in cutoffs.values()):
        return Check(
            "filters", "unknown", "not reported", "the rover has no INS_GYRO_FILTER or INS_ACCEL_FILTER"
        )
    value = ", ".join(
        f"{_FILTERS[name]} {fc:g} Hz" if fc else f"{_FILTERS[name]} off" for name, fc in cutoffs.items()
    )
    top = observed.w_max / (2 * pi)
    worst_name, worst = min(cutoffs.items(), key=lambda item: item[1] or 1e9)
    wanted = max(CUTOFF, 5 * ceil(top))
    raised = tuple((name, wanted) for name, fc in cutoffs.items() if 0 < fc < wanted)
    remedy = Remedy(f"set {' and '.join(name for name, _ in raised)} to {wanted:g} Hz", sets=raised)
    if worst and worst < _CLEAR * top:
        sentence = f"{worst_name} {worst:g} Hz: {filter_loss(worst, top)}"
        return Check("filters", "bad" if worst < _SPOILT * top else "doubtful", value, sentence, remedy)
    folded = [
        name for name, fc in cutoffs.items() if not fc or fc > 0.4 * observed.parameter("SCHED_LOOP_RATE")
    ]
    if folded:
        sentence = (
            f"{folded[0]} lets vibration through, which appears as slow motion (aliasing) at a loop rate of "
            f"{observed.parameter('SCHED_LOOP_RATE'):.0f} Hz"
        )
        lower = Remedy(f"set {folded[0]} to {wanted:g} Hz", sets=((folded[0], wanted),))
        return Check("filters", "doubtful", value, sentence, lower)
    return Check("filters", "good", value, filter_loss(worst, top))


def filter_loss(cutoff: float, top: float) -> str:
    """Lag, gain and phase of a second-order Butterworth low-pass at `top`, as a phrase. Both in Hz."""
    ratio = top / cutoff
    gain = 1 / hypot(1 - ratio**2, sqrt(2) * ratio)
    phase = degrees(atan2(sqrt(2) * ratio, 1 - ratio**2))
    lag = 1000 * sqrt(2) / (2 * pi * cutoff)
    return (
        f"{lag:.0f} ms of lag, gain {gain:.2f} and {phase:.0f} deg of phase lag "
        f"at the sweep's top frequency of {top:.1f} Hz"
    )


def streams(observed: Observation) -> Check:
    """The rates requested, granted, and measured over two seconds of the vehicle's clock."""
    denied = [s for s in observed.streams if s.advice]
    came = {q.message: q for q in observed.quality}
    rates = [q.hz for q in observed.quality if q.count > 2]
    slowest = f"{min(rates):.0f} to {max(rates):.0f} Hz" if rates else "nothing came"
    value = f"{len(rates)} of {len(came)}, {slowest}"
    absent = [s.message for s in observed.streams if s.hz and s.message in came and came[s.message].count < 3]
    granted = {s.message: s.hz for s in observed.streams}
    poor = [
        words
        for q in observed.quality
        if q.count > 2 and (words := stream_fault(q, hz := granted.get(q.message) or q.hz, _GAP / hz))
    ]
    if not observed.streams:
        return Check("streams", "unknown", "not requested", "no stream was requested")
    if denied:
        capped = any("SCHED_LOOP_RATE" in s.advice for s in denied)
        remedy = _faster(LOOP_RATE) if capped else None
        return Check("streams", "doubtful", value, "; ".join(s.advice for s in denied), remedy)
    if absent:
        sentence = f"{', '.join(absent)} did not arrive, although the vehicle granted it"
        if absent == ["LOCAL_POSITION_NED"]:
            sentence += "; it is sent once the EKF has an origin"
        return Check("streams", "doubtful", value, sentence, Remedy("wait, then check again", by_hand=True))
    if poor:
        hand = Remedy(
            "go closer, use USB or a faster radio; the log on the card is not affected", by_hand=True
        )
        return Check("streams", "doubtful", value, "; ".join(poor), hand)
    jitter = max((q.jitter_ms for q in observed.quality), default=0.0)
    return Check("streams", "good", value, f"no gap, jitter {jitter:.1f} ms at most")


def clock(observed: Observation) -> Check:
    """The .tlog's clock (arrival at this computer) against the vehicle's (in the messages)."""
    c = observed.clock
    if c is None:
        return Check("clock", "unknown", "not reported", "too few messages with a time stamp arrived")
    value = f"arrival within {1000 * c.jitter:.0f} ms"
    if abs(c.rate - 1) > _REAL_TIME and abs(c.drift) > c.bound:
        sentence = (
            f"the vehicle's clock runs {c.rate:.3g} times as fast as this computer's: a simulation; "
            "use the time stamps in the messages, not those of the .tlog"
        )
        return Check("clock", "good", f"{c.rate:.3g} x", sentence)
    measured = f"drift {1e6 * c.drift:+.0f} ppm" if abs(c.drift) > c.bound else "no drift measured"
    drift = f"{measured}, uncertain by {1e6 * c.bound:.0f} ppm after {c.span:.0f} s"
    off = f"{c.behind_utc:+.1f} s" if abs(c.behind_utc) < _HOUR else f"{c.behind_utc / _HOUR:+.0f} h"
    utc = "" if isnan(c.behind_utc) else f"; this computer is {off} from GPS time"
    sentence = f"{drift}{utc}"
    if c.jitter > _TIMELY:
        state: State = "bad" if c.jitter > _LATE else "doubtful"
        late = f"messages arrive up to {1000 * c.jitter:.0f} ms late: use only the time stamps in them"
        hand = Remedy("go closer, or use USB", by_hand=True)
        return Check("clock", state, value, f"{late}; {sentence}", hand)
    return Check("clock", "good", value, sentence)
