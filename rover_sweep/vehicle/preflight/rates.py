"""Checks of the data rates and their fidelity: loop rate, sensor filters, streams, clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, ceil, degrees, hypot, isnan, nan, pi, sqrt

from firmware_params.applet_parameters import AUX_FUNCTION, SWITCH_HIGH, SWITCH_LOW
from rover_sweep.manoeuvre.sweep import LEAST_SAMPLES
from rover_sweep.vehicle.link.inbox import ADVICE, LinkQuality
from rover_sweep.vehicle.link.streams import LOST, StreamQuality, fastest_interval_ms, stream_fault
from rover_sweep.vehicle.preflight.read_rover import Check, ClockComparison, Observation, Remedy, State
from rover_sweep.vehicle.run.controls import NEUTRAL_ZONE, SCRIPTING_1

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


# Check of the link: lost or damaged frames, and the time to an answer.


_LEAST_FRAMES = 50  # fewer give too rough an estimate of the lost share


def link(observed: Observation) -> Check:
    """Loss from the sequence numbers of the frames, and the time from a request to its answer."""
    quality = observed.link
    if quality is None or quality.frames < _LEAST_FRAMES:
        return Check("link", "unknown", "not measured", "too few frames arrived to measure the loss")
    value = _value(quality)
    if not quality.poor:
        return Check("link", "good", value, f"measured on {quality.frames} frames in {quality.seconds:.0f} s")
    hand = Remedy(ADVICE, by_hand=True)
    return Check("link", "bad" if quality.bad else "doubtful", value, quality.words, hand)


def _value(quality: LinkQuality) -> str:
    lost = f"{quality.lost:.1%} lost" if quality.lost else "nothing lost"
    answers = "" if quality.latency is None else f", answers in {1000 * quality.latency:.0f} ms"
    return lost + answers


# Checks of the pilot's radio (present, sticks at rest, failsafe) and of the applet's switch.


_PULSES = (800, 2200)  # us: RC_MIN_LIMIT_PWM, RC_MAX_LIMIT_PWM
_NOTICE = Remedy(
    "set FS_THR_ENABLE to 1 and FS_ACTION to 2 (Hold)", sets=(("FS_THR_ENABLE", 1.0), ("FS_ACTION", 2.0))
)
_SIX = Remedy(f"set RC6_OPTION to {SCRIPTING_1}", sets=(("RC6_OPTION", float(SCRIPTING_1)),))


def switch_of(parameters: Mapping[str, float], otherwise: int = 6) -> int:
    """RC channel (1-based) of the applet's switch: SWP_CHAN, else the one with RCn_OPTION 300."""
    if (raw := int(parameters.get("SWP_CHAN", 0))) > 0:
        return raw
    return next((n for n in range(1, 17) if parameters.get(f"RC{n}_OPTION") == AUX_FUNCTION), otherwise)


def rc(observed: Observation) -> Check:
    """Whether the receiver gives pulses, both sticks are at rest, and a failsafe detects its loss."""
    if not observed.channels:
        sentence = "no radio: only this computer could stop the rover"
        return Check("rc", "bad", "no receiver", sentence, Remedy("switch the transmitter on", by_hand=True))
    if observed.radio is False:  # RC_CHANNELS keeps the last values (4.6.3, SIM_RC_FAIL 1)
        sentence = "the rover reports that it does not hear its radio (SYS_STATUS)"
        hand = Remedy("switch the transmitter on", by_hand=True)
        return Check("rc", "bad", "radio lost", sentence, hand)
    steering, throttle = _stick(observed, "RCMAP_ROLL", 1), _stick(observed, "RCMAP_THROTTLE", 3)
    value = f"{len(observed.channels)} channels, steering {steering[1]:.0f} us, throttle {throttle[1]:.0f} us"
    if observed.channels.get(throttle[0], 0) < observed.parameter("FS_THR_VALUE"):
        sentence = f"throttle {throttle[1]:.0f} us is below FS_THR_VALUE: the receiver lost the radio"
        return Check("rc", "bad", value, sentence, Remedy("switch the transmitter on", by_hand=True))
    for words, (number, pwm, trim, zone) in (("steering", steering), ("throttle", throttle)):
        if abs(pwm - trim) > zone:
            sentence = (
                f"the {words} stick (channel {number}) is {pwm - trim:+.0f} us off its trim of {trim:.0f} us"
            )
            return Check(
                "rc", "bad", value, sentence, Remedy("leave the sticks alone, or trim them", by_hand=True)
            )
    if not observed.parameter("FS_THR_ENABLE") > 0 or observed.parameter("FS_ACTION") == 0:
        sentence = "the rover would not react to a loss of the radio (FS_THR_ENABLE, FS_ACTION)"
        return Check("rc", "bad", value, sentence, _NOTICE)
    return _override_time(observed, value)


def _override_time(observed: Observation, value: str) -> Check:
    """Whether RC_OVERRIDE_TIME lets the rover take an override, and forget it soon."""
    seconds = observed.parameter("RC_OVERRIDE_TIME")
    back = observed.parameter("SWP_BACK") if observed.parameter("SWP_LAPSE") > 0 else nan
    usual = 3.0 if isnan(back) else back
    sets = Remedy(f"set RC_OVERRIDE_TIME to {usual:g}", sets=(("RC_OVERRIDE_TIME", usual),))
    if seconds == 0:
        sentence = "RC_OVERRIDE_TIME is 0: the rover accepts no throttle or switch from this program"
        return Check("rc", "doubtful", value, sentence, sets)
    if not isnan(back):
        sentence = (
            f"RC_OVERRIDE_TIME is {seconds:g} s instead of {back:g} s, for a program that overrides the "
            "radio; if none runs, the applet ended with it"
        )
        return Check("rc", "doubtful", value, sentence, sets)
    if not 0 < seconds <= 3.0:
        holds = "for ever" if seconds < 0 else f"for {seconds:g} s"
        sentence = f"RC_OVERRIDE_TIME {seconds:g}: what a dead program of any kind sent last holds {holds}"
        return Check("rc", "doubtful", value, sentence, sets)
    return Check("rc", "good", value)


def _stick(observed: Observation, mapping: str, usual: int) -> tuple[int, float, float, float]:
    """(channel, PWM [us], trim [us], largest offset from trim that counts as rest [us])."""
    mapped = observed.parameter(mapping)
    number = usual if isnan(mapped) else int(mapped)
    trim, zone = observed.parameter(f"RC{number}_TRIM"), observed.parameter(f"RC{number}_DZ")
    pwm = float((observed.channels or {}).get(number, 0))
    return number, pwm, 1500.0 if isnan(trim) else trim, NEUTRAL_ZONE if isnan(zone) else zone


def switch(observed: Observation) -> Check:
    """Whether the switch is its own and low: the applet does not start if it is high at its first reading."""
    number = switch_of(observed.parameters, 0)
    if number == 0:
        sentence = "no channel starts the applet: none has option 300, and SWP_CHAN is 0"
        return Check("switch", "bad", "none", sentence, _SIX)
    pwm = (observed.channels or {}).get(number, 0)
    value = f"channel {number}: {pwm} us"
    if observed.parameter("MODE_CH") == number:
        sentence = (
            f"channel {number} starts the applet and is also the mode switch (MODE_CH): throwing it changes "
            "the mode, and the applet runs only in MANUAL"
        )
        words = "set MODE_CH to the channel of the mode switch, or start the applet by another channel"
        return Check("switch", "bad", value, sentence, Remedy(words, by_hand=True))
    if not _PULSES[0] <= pwm <= _PULSES[1]:
        sentence = f"channel {number} has no pulses: the position of the switch is unknown"
        hand = Remedy(f"give channel {number} a switch on the transmitter", by_hand=True)
        return Check("switch", "unknown", value, sentence, hand)
    if pwm >= SWITCH_LOW:
        where = "high" if pwm > SWITCH_HIGH else "in the middle"
        sentence = f"switch {number} is {where}; it must be low before the rover is armed"
        return Check("switch", "bad", value, sentence, Remedy(f"throw switch {number} low", by_hand=True))
    return Check("switch", "good", f"{value}, low")


# A sentence on the telemetry of a finished run: its quality, and whether it is needed.


Granted = Mapping[str, float]  # Hz by message, as the vehicle granted it


def telemetry_words(
    quality: Sequence[StreamQuality], granted: Granted, clock: ClockComparison | None, logs: bool
) -> str:
    """One sentence. granted: rates [Hz]. logs: whether the vehicle's log is fetched after the session."""
    poor = [words for q in quality if (words := stream_fault(q, granted.get(q.message, 0.0)))]
    came = "; ".join(poor) if poor else _came(quality)
    return f"telemetry: {came}{_clock(clock)}; {_source(bool(poor), logs)}"


def _came(quality: Sequence[StreamQuality]) -> str:
    if not quality:
        return "not judged"
    slowest, fastest = min(q.mean_hz for q in quality), max(q.mean_hz for q in quality)
    rates = f"{slowest:.0f}" if round(slowest) == round(fastest) else f"{slowest:.0f} to {fastest:.0f}"
    lost = max(q.lost for q in quality)
    return (
        f"{rates} Hz, jitter {max(q.jitter_ms for q in quality):.1f} ms, "
        f"longest gap {max(q.gap_ms for q in quality):.0f} ms, {f'{lost:.1%}' if lost else 'nothing'} lost"
    )


def _clock(c: ClockComparison | None) -> str:
    """'' in a simulation that is not in real time: there the arrival has no meaning."""
    if c is None or abs(c.rate - 1) > 0.02:
        return ""
    drift = f", drift {1e6 * c.drift:+.0f} ppm" if abs(c.drift) > c.bound else ""
    return f", arrival within {1000 * c.jitter:.0f} ms of the rover's clock{drift}"


def _source(poor: bool, logs: bool) -> str:
    if logs:
        need = "needed: the telemetry is too poor" if poor else "the telemetry would also be good enough"
        return f"the run is identified from the rover's log, once it is fetched ({need})"
    if poor:
        return (
            f"the run is identified from the telemetry, although losses above {LOST:.0%} or long gaps spoil "
            "a response"
        )
    return "the run is identified from the telemetry, because the log is not fetched"
