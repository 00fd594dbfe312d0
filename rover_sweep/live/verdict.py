"""The verdict on a run within a second of its end: keep it, repeat it, or discard it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Array, Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.advice import WEAK_AMPLITUDE
from rover_sweep.design.demand import HORN_DEG_PER_US, SERVO_60_DEG
from rover_sweep.errors import DataRefused, RoverSweepError
from rover_sweep.live.source import Advice, CoherenceBand, ResponseCurve, Verdict
from rover_sweep.logs.log import STEERING, Log, output_channel, output_limits
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.quality.coherence import (
    RISING_FROM,
    SERVO_TRAVEL,
    VYDOT_FROM,
    WHEEL_LOCK,
    CoherenceVerdict,
    assess,
    judged_responses,
    responses,
    sign_is_wrong,
)
from rover_sweep.quality.faults import advice_on, each_with_length
from rover_sweep.session.content import SessionRun
from rover_sweep.spectra.amplitude import AmplitudeProposal, Limit, octaves, propose_amplitude
from rover_sweep.spectra.response import COHERENCE_GOOD, RISING, FrequencyResponse, unwrapped_phase

# The coherence of a run by response and octave, each with a word or two.


GOOD, WEAK = 0.8, 0.3
POINTS = 80  # of a curve: more than a terminal has columns for


def coherence_bands(found: Mapping[str, FrequencyResponse]) -> tuple[CoherenceBand, ...]:
    """Median coherence of each response in bands of about an octave [rad/s]."""
    return tuple(band for f in found.values() for band in _bands(f))


def _bands(f: FrequencyResponse) -> Iterator[CoherenceBand]:
    edges = octaves(float(f.w[0]), float(f.w[-1])).tolist()
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = (f.w >= low * (1 - 1e-9)) & (f.w <= high * (1 + 1e-9))
        if inside.any():
            coherence = float(np.median(f.coherence[inside]))
            yield CoherenceBand(f.output, low, high, coherence, _words(f, low, high, coherence))


def _words(f: FrequencyResponse, low: float, high: float, coherence: float) -> str:
    if coherence >= GOOD:
        return "good"
    if coherence >= COHERENCE_GOOD:
        return "usable"
    middle = np.sqrt(low * high)
    if f.output == "vydot" and middle < VYDOT_FROM:
        return "weak: the GPS bends the speed"
    if f.output in RISING and middle < RISING_FROM * f.w[0]:
        return "weak: too slow for an answer"
    return "weak" if coherence >= WEAK else "lost in noise"


def response_curves(
    found: Mapping[str, FrequencyResponse], rad_per_us: float | None = None
) -> tuple[ResponseCurve, ...]:
    """At most `POINTS` points of each response, per rad of the road wheels where rad_per_us is known."""
    return tuple(_curve(f if rad_per_us is None else per_rad(f, rad_per_us)) for f in found.values())


def per_rad(f: FrequencyResponse, rad_per_us: float) -> FrequencyResponse:
    """The response to the road-wheel angle; in ArduPilot a larger PWM turns right."""
    return f if f.input == "delta" else replace(f, h=f.h / -rad_per_us, input="delta")


def _curve(f: FrequencyResponse) -> ResponseCurve:
    places = np.unique(np.linspace(0, f.w.size - 1, POINTS).round().astype(int))
    gain = 20.0 * np.log10(np.maximum(np.abs(f.h), 1e-12))
    phase = unwrapped_phase(f.h, f)
    w, db, deg, coherence = (
        tuple(float(f"{value:.4g}") for value in x[places]) for x in (f.w, gain, phase, f.coherence)
    )
    return ResponseCurve(f.output, w, db, deg, coherence, "rad" if f.input == "delta" else "us")


def spoken(found: tuple[CoherenceBand, ...]) -> dict[str, str]:
    """One line per response: where it is good, usable, weak."""
    lines: dict[str, list[tuple[str, float, float]]] = {}
    for band in found:
        parts = lines.setdefault(band.response, [])
        if parts and parts[-1][0] == band.words:
            parts[-1] = (band.words, parts[-1][1], band.high)
        else:
            parts.append((band.words, band.low, band.high))
    return {
        response: ", ".join(_stretch(parts, k) for k in range(len(parts)))
        for response, parts in lines.items()
    }


def _stretch(parts: list[tuple[str, float, float]], k: int) -> str:
    words, low, high = parts[k]
    word, _, reason = words.partition(": ")
    if len(parts) == 1:
        where = ""
    elif k == 0:
        where = f" below {high:.2g} rad/s"
    elif k == len(parts) - 1:
        where = f" above {low:.2g} rad/s"
    else:
        where = f" {low:.2g}-{high:.2g} rad/s"
    return f"{word}{where}{': ' + reason if reason else ''}"


# The limits of the steering amplitude of a rover: applet, servo and tyres, each with its name.


MARGIN = 0.9  # share of the rate at which the applet stops a run


def limits_of(
    found: Mapping[str, FrequencyResponse],
    speed: float,
    parameters: Mapping[str, float],
    scale: float = 1.0,
    middle: float = 0.0,
    vehicle: Vehicle | None = None,
    servo_60_deg: float | None = None,
) -> tuple[Limit, ...]:
    """The limits [us] on the grid of the responses.

    speed [m/s] of the run; parameters: of the vehicle, as far as they are known; scale: input unit of the
    responses per us; middle: offset from trim about which is steered [us]; servo_60_deg: s that the
    servo takes for 60 deg of its horn, by its data sheet (a quick one where not given).
    """
    if not found:
        return ()
    w = next(iter(found.values())).w
    return tuple(
        Limit(words, w, np.broadcast_to(np.maximum(us - abs(middle), 1.0), w.shape))
        for words, us in (
            *_travel(parameters),
            *_servo(w, servo_60_deg),
            *_tyres(found, speed, scale, vehicle),
            *_applet(found, parameters, scale),
        )
    )


def limits_of_wheels(
    found: Mapping[str, FrequencyResponse], speed: float, driven: float, vehicle: Vehicle | None = None
) -> tuple[Limit, ...]:
    """The limits [rad] of a recording that holds the wheels' angle and no servo output. driven: its own."""
    if not found:
        return ()
    w = next(iter(found.values())).w
    scale = vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None
    lock = max(WHEEL_LOCK if scale is None else abs(scale) * SERVO_TRAVEL, driven)
    words = f"the wheels' lock (about {lock:.2g} rad{', assumed' if scale is None else ''})"
    return tuple(
        Limit(said, w, np.broadcast_to(rad, w.shape))
        for said, rad in ((words, np.array(lock)), *_tyres(found, speed, 1.0, vehicle))
    )


def _travel(parameters: Mapping[str, float]) -> Iterator[tuple[str, Array]]:
    if "SWP_PWM_MAX" in parameters:
        yield "SWP_PWM_MAX", np.array(parameters["SWP_PWM_MAX"])
    channel = output_channel(parameters, STEERING) or 1
    if (ends := output_limits(parameters, channel)) is not None:
        trim = parameters.get(f"SERVO{channel}_TRIM", sum(ends) / 2)
        yield f"the end stop (SERVO{channel}_MIN and _MAX)", np.array(min(ends[1] - trim, trim - ends[0]))
    else:
        yield (
            f"a servo's usual travel ({SERVO_TRAVEL:.0f} us, as no SERVOn_MIN was recorded)",
            np.array(SERVO_TRAVEL),
        )


def _servo(w: Array, own: float | None) -> Iterator[tuple[str, Array]]:
    """The rate of a sine of amplitude A is A w."""
    seconds = own or SERVO_60_DEG[0]
    words = f"your servo ({own:g} s/60 deg)" if own else f"even a quick servo ({seconds:g} s/60 deg)"
    yield words, 60 / seconds / HORN_DEG_PER_US / w


def _tyres(
    found: Mapping[str, FrequencyResponse], speed: float, scale: float, vehicle: Vehicle | None
) -> Iterator[tuple[str, Array]]:
    """The side force that V r needs, up to the share of the friction above which runs get a warning."""
    stated = vehicle.friction.value if vehicle and vehicle.friction else None
    friction = stated or FRICTION
    if "r" in found and np.isfinite(speed) and speed > 0:
        words = f"the tyres' grip at {speed:.1f} m/s (friction {friction:g}{'' if stated else ', assumed'})"
        yield words, NEAR * friction * GRAVITY / (speed * _answer(found["r"], scale))


def _applet(
    found: Mapping[str, FrequencyResponse], parameters: Mapping[str, float], scale: float
) -> Iterator[tuple[str, Array]]:
    """The rates at which the applet stops the run."""
    for output, name in (("r", "SWP_R_MAX"), ("p", "SWP_P_MAX")):
        if output in found and name in parameters:
            yield name, MARGIN * np.radians(parameters[name]) / _answer(found[output], scale)


def _answer(f: FrequencyResponse, scale: float) -> Array:
    """Coherent output per us (n_w,)."""
    return np.asarray(np.maximum(np.abs(f.h) * np.sqrt(f.coherence) * abs(scale), 1e-9))


# The verdict on a run that did not come to its end, with what to change before it is driven again.


# as the applet says it, and as `vehicle.run.right_to_move` does
_TOO_FAST = re.compile(r"speed ([\d.]+) (?:> ([\d.]+) m/s|m/s is above SWP_V_MAX ([\d.]+))$")
BELOW_LIMIT = 0.8  # of SWP_V_MAX: the highest speed that a lowered throttle is meant for


def too_fast(reason: str) -> tuple[float, float] | None:
    """(speed, SWP_V_MAX) [m/s] if that limit stopped the run."""
    found = _TOO_FAST.match(reason)
    return (float(found[1]), float(found[2] or found[3])) if found else None


def stopped_verdict(
    planned: SessionRun, reason: str, tlog: Path, throttle: int | None = None, neutral: int | None = None
) -> Verdict:
    """To repeat the run. throttle: with which this program drove, None if the pilot did; neutral: the
    throttle's trim, None if unknown [us].

    A throttle that is too high is lowered in proportion to the speed. The speed was still rising, and a motor
    has a dead zone: so the rover may still be too fast or become too slow, and the proposal is a first step.
    """
    fast = too_fast(reason)
    if fast is None:
        return _repeat_stopped(planned, f"it did not come to its end ({reason}): drive it again", tlog)
    speed, limit = fast
    aim = min(planned.speed or limit, BELOW_LIMIT * limit)
    above = f"the speed passed SWP_V_MAX {limit:g} m/s: "
    if throttle is None:
        return _repeat_stopped(planned, f"{above}drive it again with less throttle, at {aim:g} m/s", tlog)
    sentence = f"{above}the throttle of {throttle} us is too high for {aim:g} m/s; drive it again with less"
    lower = None if neutral is None else neutral + int((throttle - neutral) * aim / max(speed, limit))
    return _repeat_stopped(planned, sentence, tlog, None if lower is None else (throttle, lower))


def _repeat_stopped(
    planned: SessionRun, sentence: str, tlog: Path, throttle: tuple[int, int] | None = None
) -> Verdict:
    return Verdict(planned.name, "repeat", sentence, source=tlog, throttle=throttle)


# Keep, repeat or discard a run, and the sentence that says why: the first fault that counts.


NO_ANSWER = 0.3  # median coherence of the yaw rate below which it does not follow the steering
CURVING = 0.3  # mean yaw rate over its standard deviation above which a run is not straight
UNSTEADY = 0.25  # standard deviation of the speed over its mean
# How notes on a recording begin if its run must be repeated (from `logs.completeness` and `logs.judge`).
NOT_WHOLE = (
    "The recording ends before",
    "The recording has a hole",
    "The recording begins after",
    "The applet stopped this run",
    "Steering is at its end stop",
)

Responses = Mapping[str, FrequencyResponse]
Said = tuple[Advice, str]


def advice(
    run: Recording,
    found: Responses,
    measured: CoherenceVerdict,
    proposal: AmplitudeProposal,
    vehicle: Vehicle | None,
) -> Said:
    """What to do with a sweep or multisine, and why."""
    if broken := advice_on(run):
        return broken
    for fault in (*_of_mounting(run, found, vehicle), *_of_driving(run)):
        return fault
    unit = measured.amplitude_unit
    if not measured.keep:
        return "repeat", _repeat(judged_responses(found), measured, proposal)
    better = "" if proposal.amplitude is None else f"; better with {_us(proposal.amplitude, unit)} {unit}"
    return "keep", measured.sentence + better


def _of_mounting(run: Recording, found: Responses, vehicle: Vehicle | None) -> Iterator[Said]:
    """Faults that no other amplitude removes."""
    r = found["r"]
    if np.median(r.coherence) < NO_ANSWER:
        yield (
            "discard",
            "discard: the yaw rate does not follow the steering output (coherence "
            f"{np.median(r.coherence):.2f}): do the front wheels move, and is it the right output?",
        )
        return
    if "ay" in found and _low_end(r, found["ay"]) < 0:
        yield (
            "discard",
            "discard: a_y and the yaw rate point to opposite sides: the autopilot is not mounted as "
            "AHRS_ORIENTATION says, or the rover drove backwards",
        )
    scale = vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None
    if scale is not None and sign_is_wrong(per_rad(r, scale)):
        yield (
            "discard",
            "discard: the rover yaws to the opposite side of the steering: rad_per_us of the vehicle file "
            "has the wrong sign, or the autopilot is not mounted as AHRS_ORIENTATION says",
        )


def _low_end(r: FrequencyResponse, ay: FrequencyResponse) -> float:
    """Cross product of both answers in the lower half of the range: V |r|^2, positive, for any rover."""
    low = r.w <= np.sqrt(r.w[0] * r.w[-1])
    return float(np.sum((r.h.conj() * ay.h * r.coherence * ay.coherence)[low]).real)


def side_remark(found: Responses) -> Iterator[str]:
    """A remark if the linkage is reversed, so that rad_per_us of the vehicle file must be negative."""
    r = found["r"]
    if r.input == "pwm" and not sign_is_wrong(r):
        yield "a larger PWM turns this rover left: rad_per_us of its vehicle file is negative"


def _of_driving(run: Recording) -> Iterator[Said]:
    """Faults that a repeat removes."""
    for note in run.notes:
        if note.text.startswith(NOT_WHOLE):
            yield "repeat", f"repeat: {note.text[0].lower()}{note.text[1:]}"
    r, speed = run.manoeuvre("r").x, run.manoeuvre("speed").x
    mean = float(np.mean(r)) - (run.bias("r") or 0.0)
    if run.kind != "bias_sweep" and abs(mean) > CURVING * float(np.std(r)):
        side = "left" if mean > 0 else "right"
        yield (
            "repeat",
            f"repeat, and drive straighter: the rover turns {side} on average, by "
            f"{abs(np.degrees(mean)):.0f} deg/s; trim the steering or take more room",
        )
    if np.std(speed) > UNSTEADY * abs(np.mean(speed)):
        low, high = np.percentile(speed, (5, 95))
        yield "repeat", f"repeat at a steady speed: it went from {low:.1f} to {high:.1f} m/s"


def _repeat(judged: Responses, measured: CoherenceVerdict, proposal: AmplitudeProposal) -> str:
    """The sentence to repeat with more amplitude, or with a lower w_max if no more is possible."""
    poor = min((o for o in measured.outputs if o.output in judged), key=lambda o: o.covered)
    unit = measured.amplitude_unit
    why = (
        f"coherence of {poor.output} is below {COHERENCE_GOOD:g} over {100 * (1 - poor.covered):.0f} % of "
        f"the range (down to {poor.lowest:.2f} at {poor.lowest_at:.2g} rad/s)"
    )
    lower = f"lower w_max to {proposal.w_max:.2g} rad/s" if proposal.w_max else ""
    if proposal.amplitude is not None:
        more = f"repeat with {_us(proposal.amplitude, unit)} {unit} in place of {_us(proposal.driven, unit)}"
        capped = f"; {proposal.sentence}" if any(band.cap for band in proposal.bands) else ""
        return f"{more}{f' and {lower}' if lower else ''}: {why}{capped}"
    if lower:
        return f"repeat, and {lower}: {why}; {proposal.sentence}"
    if any(band.cap for band in proposal.bands):
        return f"repeat faster or with a longer T_rec: {why}; {proposal.sentence}"
    return f"repeat at a steady speed and straighter: {why}, though the amplitude is enough"


def _us(amplitude: float, unit: str) -> str:
    return f"{amplitude:.0f}" if unit == "us" else f"{amplitude:.2g}"


Span = tuple[float, float]


def judge(tlog: Path, span: Span, name: str, vehicle: Vehicle | None = None) -> Verdict:
    """The verdict on the run within `span` [s of the vehicle's clock] of a recording, .tlog or .BIN.

    vehicle: its file, for the friction and the sign of the steering. Never raises for bad data: the verdict
    names their fault.
    """
    try:
        logs = read_logs(str(tlog))
    except RoverSweepError as error:
        said = f"this recording cannot be judged: {error}"
        return Verdict(name, "repeat", f"{said}; the vehicle's log may still be good", source=tlog)
    refusal = (
        f"no run was found between {span[0]:.0f} and {span[1]:.0f} s: was the rover steered and driving?"
    )
    for log in reversed(logs):
        try:
            runs = [run for run in runs_of(log) if run.span[0] < span[1] and run.span[1] > span[0]]
        except DataRefused as error:
            refusal = str(error)
            continue
        if runs:
            return renamed(verdict_on_log(runs[-1], log, vehicle), name, tlog)
    return Verdict(name, "discard", f"discard: {refusal}", source=tlog)


def renamed(verdict: Verdict, name: str, source: Path) -> Verdict:
    """The verdict under the run's name, with the recording that was judged."""
    return replace(verdict, run=name, source=source)


def verdict_on_log(run: Recording, log: Log, vehicle: Vehicle | None = None) -> Verdict:
    """The verdict on a run of a log."""
    (run,) = each_with_length([run])
    remarks = tuple(note.text for note in run.notes if note.level == "warning")
    if run.kind == "doublet" and (broken := advice_on(run)):
        return Verdict(run.name, *broken, remarks=remarks)
    if run.kind == "doublet":
        said = "keep: a doublet, for verification; its coherence is not judged"
        return Verdict(run.name, "keep", said, remarks=remarks)
    input = "delta" if "delta" in run else "pwm"
    try:
        found = responses([run], input=input)
    except ValueError as error:  # too short for a single window
        return Verdict(run.name, "discard", f"discard: the run is too short ({error})", remarks=remarks)
    measured = assess(run, found)
    proposal = proposed(run, found, log.parameters, vehicle)
    word, sentence = advice(run, found, measured, proposal, vehicle)
    by_band = coherence_bands(found)
    return Verdict(
        run.name,
        word,
        sentence,
        by_band,
        proposal.amplitude if word != "discard" else None,
        tuple((b.low, b.high, b.amplitude) for b in proposal.bands),
        remarks=(
            *(f"{response}: {words}" for response, words in spoken(by_band).items()),
            *((f"amplitude: {proposal.sentence}",) if proposal.sentence else ()),
            *(side_remark(found) if vehicle is None else ()),
            *remarks,
        ),
        curves=response_curves(found, vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None),
    )


def proposed(
    run: Recording,
    found: Mapping[str, FrequencyResponse],
    parameters: Mapping[str, float],
    vehicle: Vehicle | None = None,
    servo_60_deg: float | None = None,
) -> AmplitudeProposal:
    """The amplitude for the next run like this one [us; rad for a .csv that has the wheels' angle]."""
    judged = judged_responses(found)
    if "pwm" not in run:
        unit = run["delta"].unit or "rad"
        driven = _amplitude(run, "delta")
        limits = limits_of_wheels(judged, run.mean_speed, driven, vehicle)
        return propose_amplitude(judged, driven, limits, unit=unit)
    driven = _amplitude(run, "pwm")
    scale = _amplitude(run, next(iter(found.values())).input) / driven
    middle = _middle(run) if run.kind == "bias_sweep" else 0.0
    limits = limits_of(judged, run.mean_speed, parameters, scale, middle, vehicle, servo_60_deg)
    return propose_amplitude(judged, driven, limits, WEAK_AMPLITUDE)


def _amplitude(run: Recording, channel: str) -> float:
    return float(np.ptp(run.manoeuvre(channel).x)) / 2


def _middle(run: Recording) -> float:
    x = run.manoeuvre("pwm").x
    return float((x.max() + x.min()) / 2 - x[0])
