"""The verdict on a run: keep it, repeat it with which change, or discard it.

`identify`, `coherence`, the session and Python give the same verdict. The first fault decides, in the order
recording, mounting, driving; without a fault, the coherence of r, a_y and p decides. The amplitude of the
next run follows from the noise, within the limits of applet, servo and tyres.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Array, Recording, data_frame
from rover_sweep.data.results import Advice, PlainNumbers, ShortTable, Shown, band_words
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.advice import WEAK_AMPLITUDE
from rover_sweep.design.demand import HORN_DEG_PER_US, SERVO_60_DEG
from rover_sweep.quality.coherence import (
    OutputCoherence,
    judged_responses,
    output_coherence,
    per_rad,
    responses,
    sign_is_wrong,
)
from rover_sweep.quality.faults import advice_on, is_short, is_unexcited
from rover_sweep.spectra.amplitude import AmplitudeProposal, Limit, propose_amplitude
from rover_sweep.spectra.response import COHERENCE_GOOD, Band, FrequencyResponse

Responses = Mapping[str, FrequencyResponse]
Said = tuple[Advice, str]

COVERED = 0.8  # of the swept range, in log w
NO_ANSWER = 0.3  # median coherence of the yaw rate below which it does not follow the steering
CURVING = 0.3  # mean yaw rate over its standard deviation above which a sweep is not straight
UNSTEADY = 0.25  # standard deviation of the speed over its mean
SERVO_TRAVEL = 500.0  # us from the trim, when the log does not have it
WHEEL_LOCK = 0.6  # rad, largest road-wheel angle of a car or rover
MARGIN = 0.9  # share of the rate at which the applet stops a run
NOTHING = AmplitudeProposal(0.0, (), None, None, "")
# How notes on a recording begin if its run must be repeated (from `logs.wave` and `logs.judgement`).
NOT_WHOLE = (
    "The recording ends before",
    "The recording has a hole",
    "The recording begins after",
    "The applet stopped this run",
    "Steering is at its end stop",
)


@dataclass(frozen=True, repr=False)
class CoherenceVerdict(PlainNumbers, Shown):
    """Keep a run, repeat or discard it. range: excited (low, high) [rad/s]; amplitude in amplitude_unit.

    sentence: verdict and reason. next: the amplitude for the next run like this one.
    """

    run: str
    advice: Advice
    range: Band
    amplitude: float
    amplitude_unit: str
    outputs: tuple[OutputCoherence, ...]
    sentence: str
    next: AmplitudeProposal = NOTHING

    @property
    def keep(self) -> bool:
        """True to keep the run."""
        return self.advice == "keep"

    def table(self) -> ShortTable:
        """The usable band of each output; the verdict."""
        rows = tuple(
            (o.output, band_words(o.band), f"{100 * o.covered:.0f} %", f"{o.lowest:.2f} at {o.lowest_at:.2g}")
            for o in self.outputs
        )
        headings = ("output", "usable band, rad/s", "range at >= 0.6", "lowest coherence")
        return ShortTable(f"coherence of {self.run}", headings, rows, (self.sentence,))


class CoherenceTable(Shown, tuple[CoherenceVerdict, ...]):
    """The verdict on each run, in their order; it prints as one table."""

    __slots__ = ()
    __repr__ = Shown.__repr__

    def table(self) -> ShortTable:
        """A row for each run with its usable bands; below, a sentence on each run to repeat."""
        outputs = tuple(dict.fromkeys(o.output for v in self for o in v.outputs))
        rows = []
        for v in self:
            bands = {o.output: band_words(o.band) for o in v.outputs}
            amplitude = f"{v.amplitude:.3g} {v.amplitude_unit}"
            rows.append((v.run, v.advice, amplitude, *(bands.get(o, "-") for o in outputs)))
        again = tuple(f"{v.run}: {v.sentence}" for v in self if not v.keep)
        title = "coherence at least 0.6, usable bands in rad/s"
        return ShortTable(title, ("run", "verdict", "amplitude", *outputs), tuple(rows), again)

    def to_frame(self) -> Any:
        """A row for each output of each run as a pandas.DataFrame; UsageError without pandas.

        Columns: run, keep, output, low and high [rad/s] of the usable band (nan for none), covered (share of
        the swept range), lowest (coherence), lowest_at [rad/s].
        """
        rows = [(v, o, o.band or (np.nan, np.nan)) for v in self for o in v.outputs]
        columns = {
            "run": [v.run for v, _, _ in rows],
            "keep": [v.keep for v, _, _ in rows],
            "output": [o.output for _, o, _ in rows],
            "low": [band[0] for _, _, band in rows],
            "high": [band[1] for _, _, band in rows],
            "covered": [o.covered for _, o, _ in rows],
            "lowest": [o.lowest for _, o, _ in rows],
            "lowest_at": [o.lowest_at for _, o, _ in rows],
        }
        return data_frame(columns)


def assess(
    run: Recording,
    found: Responses | None = None,
    vehicle: Vehicle | None = None,
    servo_60_deg: float | None = None,
) -> CoherenceVerdict:
    """The verdict on one run.

    found: the run's responses, if already computed; conditioned ones are judged by partial coherence. The
    roll rate is judged only when it has a usable band. vehicle: its file, for friction and the sign of the
    steering. servo_60_deg [s]: time of the servo for 60 deg of its horn (default: a quick servo).
    """
    input = "delta" if "delta" in run else "pwm"
    broken = advice_on(run)
    if broken and is_unexcited(run):
        return CoherenceVerdict(run.name, broken[0], (0.0, 0.0), 0.0, run[input].unit, (), broken[1])
    measured = found or responses([run], input=input)
    outputs = {name: output_coherence(f) for name, f in measured.items()}
    judged = judged_responses(measured)
    worst = min(judged, key=lambda name: outputs[name].covered)
    swept = (float(judged[worst].w[0]), float(judged[worst].w[-1]))
    amplitude, unit = driven_amplitude(run, input)
    next_run = NOTHING
    advice: Advice
    if broken:
        advice, sentence = broken
    elif run.kind == "doublet":
        advice, sentence = "keep", "keep: a doublet, for verification; its coherence is not judged"
    elif run.kind == "other" and is_short(run):
        advice, sentence = "keep", "short trial: one average of many, so its own coherence is not judged"
    else:
        next_run = _proposed(run, judged, vehicle, servo_60_deg)
        fault = next(iter((*_of_mounting(run, measured, vehicle), *_of_driving(run))), None)
        advice, sentence = fault or _by_coherence(measured, outputs, outputs[worst], next_run, unit)
    found_outputs = tuple(outputs.values())
    return CoherenceVerdict(run.name, advice, swept, amplitude, unit, found_outputs, sentence, next_run)


def driven_amplitude(run: Recording, input: str = "delta") -> tuple[float, str]:
    """(amplitude of the steering in the manoeuvre, its unit): of the PWM in us where it was recorded."""
    signal = run.manoeuvre("pwm" if "pwm" in run else input)
    return float(np.ptp(signal.x)) / 2, signal.unit


def _by_coherence(
    measured: Responses,
    outputs: Mapping[str, OutputCoherence],
    worst: OutputCoherence,
    next_run: AmplitudeProposal,
    unit: str,
) -> Said:
    """Of a run without a fault."""
    f = measured[worst.output]
    taken = " and ".join(f.conditioned_on)
    kind = f"partial coherence (effect of {taken} removed)" if taken else "coherence"
    if worst.covered < COVERED:
        return "repeat", _repeat(worst, kind, next_run, unit)
    low, high = f.w[0], f.w[-1]
    bands = ", ".join(f"{o.output} {o.band[0]:.2g}-{o.band[1]:.3g}" for o in outputs.values() if o.band)
    poor = [name for name, o in outputs.items() if o.band is None]
    rest = f"; {', '.join(poor)} not usable" if poor else ""
    better = "" if next_run.amplitude is None else f"; better with {_us(next_run.amplitude, unit)} {unit}"
    return "keep", f"keep: {kind} >= 0.6 over {low:.2g}-{high:.3g} rad/s ({bands} rad/s{rest}){better}"


def _repeat(poor: OutputCoherence, kind: str, next_run: AmplitudeProposal, unit: str) -> str:
    """The sentence to repeat with more amplitude, or with a lower w_max if no more is possible."""
    why = (
        f"{kind} of {poor.output} is below {COHERENCE_GOOD:g} over {100 * (1 - poor.covered):.0f} % of "
        f"the range (down to {poor.lowest:.2f} at {poor.lowest_at:.2g} rad/s)"
    )
    lower = f"lower w_max to {next_run.w_max:.2g} rad/s" if next_run.w_max else ""
    if next_run.amplitude is not None:
        more = f"repeat with {_us(next_run.amplitude, unit)} {unit} in place of {_us(next_run.driven, unit)}"
        capped = f"; {next_run.sentence}" if any(band.cap for band in next_run.bands) else ""
        return f"{more}{f' and {lower}' if lower else ''}: {why}{capped}"
    if lower:
        return f"repeat, and {lower}: {why}; {next_run.sentence}"
    if any(band.cap for band in next_run.bands):
        return f"repeat faster or with a longer T_rec: {why}; {next_run.sentence}"
    return f"repeat at a steady speed and straighter: {why}, though the amplitude is enough"


def _us(amplitude: float, unit: str) -> str:
    return f"{amplitude:.0f}" if unit == "us" else f"{amplitude:.2g}"


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
    ay, low = found.get("ay"), r.w <= np.sqrt(r.w[0] * r.w[-1])
    # for any rover the cross product of both answers, V |r|^2 in the lower half of the range, has V's sign
    way = np.sign(run.mean_speed)
    if ay is not None and way * np.sum((r.h.conj() * ay.h * r.coherence * ay.coherence)[low]).real < 0:
        yield (
            "discard",
            "discard: a_y and the yaw rate point to opposite sides: the autopilot is not mounted as "
            "AHRS_ORIENTATION says, or the rover drove in reverse and its speed has no sign",
        )
    scale = vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None
    if scale is not None and sign_is_wrong(per_rad(r, scale), way):
        yield (
            "discard",
            "discard: the rover yaws to the opposite side of the steering: rad_per_us of the vehicle file "
            "has the wrong sign, or the autopilot is not mounted as AHRS_ORIENTATION says",
        )


def _of_driving(run: Recording) -> Iterator[Said]:
    """Faults that a repeat removes. Who drives by hand turns and changes the speed."""
    for note in run.notes:
        if note.text.startswith(NOT_WHOLE):
            yield "repeat", f"repeat: {note.text[0].lower()}{note.text[1:]}"
    if run.kind == "other":
        return
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


def _proposed(
    run: Recording, judged: Responses, vehicle: Vehicle | None, servo_60_deg: float | None
) -> AmplitudeProposal:
    """The amplitude for the next run like this one [us; rad for a .csv that has the wheels' angle]."""
    driven, unit = driven_amplitude(run)
    if "pwm" not in run:
        limits = _limits_of_wheels(run, judged, driven, vehicle)
        return propose_amplitude(judged, driven, limits, unit=unit or "rad")
    scale = float(np.ptp(run.manoeuvre(next(iter(judged.values())).input).x)) / 2 / driven
    limits = _limits(run, judged, scale, vehicle, servo_60_deg)
    return propose_amplitude(judged, driven, limits, WEAK_AMPLITUDE)


def _limits(
    run: Recording, found: Responses, scale: float, vehicle: Vehicle | None, servo_60_deg: float | None
) -> tuple[Limit, ...]:
    """The limits [us] on the grid of the responses. scale: input unit of the responses per us."""
    if not found:
        return ()
    w = next(iter(found.values())).w
    x, middle = run.manoeuvre("pwm").x, 0.0
    if run.kind == "bias_sweep":
        middle = float((x.max() + x.min()) / 2 - x[0])  # about which is steered, from the trim
    return tuple(
        Limit(words, w, np.broadcast_to(np.maximum(us - abs(middle), 1.0), w.shape))
        for words, us in _servo_limits(run, found, scale, vehicle, servo_60_deg)
    )


def _limits_of_wheels(
    run: Recording, found: Responses, driven: float, vehicle: Vehicle | None
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
        for said, rad in ((words, np.array(lock)), *_tyres(found, run.mean_speed, 1.0, vehicle))
    )


def _servo_limits(
    run: Recording, found: Responses, scale: float, vehicle: Vehicle | None, own: float | None
) -> Iterator[tuple[str, Array]]:
    """(words, limit [us] or limits (n_w,) [us]) of travel, servo, tyres and applet. own: s/60 deg."""
    limits = run.limits
    if "SWP_PWM_MAX" in limits:
        yield "SWP_PWM_MAX", np.array(limits["SWP_PWM_MAX"])
    ends = {name.rpartition("_")[2]: us for name, us in limits.items() if name.startswith("SERVO")}
    if {"MIN", "MAX"} <= ends.keys():
        trim = ends.get("TRIM", 0.5 * (ends["MIN"] + ends["MAX"]))
        servo = next(name for name in limits if name.startswith("SERVO")).partition("_")[0]
        words = f"the end stop ({servo}_MIN and _MAX)"
        yield words, np.array(min(ends["MAX"] - trim, trim - ends["MIN"]))
    else:
        words = f"a servo's usual travel ({SERVO_TRAVEL:.0f} us, as no SERVOn_MIN was recorded)"
        yield words, np.array(SERVO_TRAVEL)
    seconds = own or SERVO_60_DEG[0]  # the rate of a sine of amplitude A is A w
    words = f"your servo ({own:g} s/60 deg)" if own else f"even a quick servo ({seconds:g} s/60 deg)"
    yield words, 60 / seconds / HORN_DEG_PER_US / next(iter(found.values())).w
    yield from _tyres(found, run.mean_speed, scale, vehicle)
    for output, name in (("r", "SWP_R_MAX"), ("p", "SWP_P_MAX")):  # at which the applet stops the run
        if output in found and name in limits:
            yield name, MARGIN * np.radians(limits[name]) / _answer(found[output], scale)


def _tyres(
    found: Responses, speed: float, scale: float, vehicle: Vehicle | None
) -> Iterator[tuple[str, Array]]:
    """The side force that V r needs, up to the share of the friction above which runs get a warning."""
    stated = vehicle.friction.value if vehicle and vehicle.friction else None
    friction = stated or FRICTION
    if "r" in found and np.isfinite(speed) and speed:
        words = (
            f"the tyres' grip at {abs(speed):.1f} m/s (friction {friction:g}{'' if stated else ', assumed'})"
        )
        yield words, NEAR * friction * GRAVITY / (abs(speed) * _answer(found["r"], scale))


def _answer(f: FrequencyResponse, scale: float) -> Array:
    """Coherent output per us (n_w,)."""
    return np.asarray(np.maximum(np.abs(f.h) * np.sqrt(f.coherence) * abs(scale), 1e-9))
