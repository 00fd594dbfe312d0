"""The verdict on a run within a second of its end: keep it, repeat it, or discard it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.errors import DataRefused, RoverSweepError
from rover_sweep.live.source import CoherenceBand, ResponseCurve, Verdict
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.quality.coherence import VYDOT_FROM, per_rad, responses, sign_is_wrong
from rover_sweep.quality.faults import each_with_length, is_unexcited
from rover_sweep.quality.verdict import assess
from rover_sweep.session.content import SessionRun, Span
from rover_sweep.spectra.amplitude import RISING_FROM, octaves
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
    """The verdict to repeat. throttle: that of this program, None if the pilot drove; neutral: the
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


def side_remark(found: Mapping[str, FrequencyResponse], speed: float) -> Iterator[str]:
    """A remark if the linkage is reversed, so that rad_per_us of the vehicle file must be negative."""
    r = found["r"]
    if r.input == "pwm" and not sign_is_wrong(r, speed):
        yield "a larger PWM turns this rover left: rad_per_us of its vehicle file is negative"


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
            return replace(verdict_on_run(runs[-1], vehicle), run=name, source=tlog)
    return Verdict(name, "discard", f"discard: {refusal}", source=tlog)


def verdict_on_run(run: Recording, vehicle: Vehicle | None = None) -> Verdict:
    """The verdict on a run with its coherence by octave, for a screen."""
    (run,) = each_with_length([run])
    remarks = tuple(note.text for note in run.notes if note.level == "warning")
    try:
        found = {} if is_unexcited(run) else responses([run], input="delta" if "delta" in run else "pwm")
    except ValueError as error:  # too short for a single window
        return Verdict(run.name, "discard", f"discard: the run is too short ({error})", remarks=remarks)
    measured = assess(run, found, vehicle)
    if run.kind == "doublet" or not found:
        return Verdict(run.name, measured.advice, measured.sentence, remarks=remarks)
    proposal, by_band = measured.next, coherence_bands(found)
    return Verdict(
        run.name,
        measured.advice,
        measured.sentence,
        by_band,
        proposal.amplitude if measured.advice != "discard" else None,
        tuple((b.low, b.high, b.amplitude) for b in proposal.bands),
        remarks=(
            *(f"{response}: {words}" for response, words in spoken(by_band).items()),
            *((f"amplitude: {proposal.sentence}",) if proposal.sentence else ()),
            *(side_remark(found, run.mean_speed) if vehicle is None else ()),
            *remarks,
        ),
        curves=response_curves(found, vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None),
    )
