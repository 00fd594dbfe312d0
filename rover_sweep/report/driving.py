"""The steering identified from any driving, as document and as driving.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from rover_sweep.data.results import ends_words, number
from rover_sweep.driving.answer import SWEEP, SWEEP_SPEED, DrivingAnswer
from rover_sweep.driving.fit import fitted_yaw_rate
from rover_sweep.driving.stretches import RATE, DrivenPart
from rover_sweep.report.charts.chart import AFTER, DATA, Chart, ChartPlan, Curve, Panel, Stack
from rover_sweep.report.document import (
    Badge,
    Cell,
    Document,
    Figures,
    Section,
    Sentence,
    Table,
    Tone,
    items,
    some,
)
from rover_sweep.report.identification.identification_json import number_document
from rover_sweep.report.wording import count, sentence, unit, versions, versions_words

TONES: dict[str, Tone] = {"good": "good", "rough": "warn", "none": "bad"}
WORTH = 0.7  # a sweep is advised for numbers whose intervals it narrows below this share
LAW = (
    "Law: r = V g w / (1 + k V² + q a²), then a delay and two lags, one of them growing with the "
    "speed. g: curvature per unit of steering; w: steering from straight, corrected for the sides and the "
    "steering curve; a: lateral acceleration. The 90 % intervals allow for errors that are correlated in "
    "time and a speed error of 0.015 m/s. A wrong speed scale changes the curvature by the same percentage."
)
SHOWN = 6  # stretches drawn, the longest


def driving_document(answer: DrivingAnswer) -> dict[str, Any]:
    """The answer as plain data."""
    driving = answer.driving
    return {
        "format": "rover-sweep driving",
        "format_version": 1,
        "level": answer.level,
        "reasons": list(answer.reasons),
        "numbers": {q.name: number_document(q) for q in answer.numbers},
        "unknown": list(answer.unknown),
        "explained": answer.fit.explained if answer.fit else None,
        "seconds_used": driving.seconds,
        "seconds_left_out": driving.left_out,
        "speeds_in_turns_m_s": list(answer.speeds),
        "steering_unit": driving.unit,
        "steering_amplitude": answer.amplitude,
        "steering_band_hz": list(answer.band),
        "half_width_after_sweep": dict(answer.after_sweep),
        "each": {name: driving_document(of_file) for name, of_file in answer.each.items()},
    }


def driving_report(answer: DrivingAnswer, names: str, read: Sequence[str] = ()) -> Document:
    """The answer as a document. names: of the logs, for the subtitle; read: how they were read."""
    made = versions()
    said = some(*items([sentence(words) for words in read]))
    how_read = (Section("How the files were read", said, "read"),) if read else ()
    return Document(
        "Steering from any driving",
        f"{names}; rover-sweep {made['rover_sweep']}",
        some(
            Sentence(_first(answer), "strong", badge=Badge(answer.level, TONES[answer.level])),
            *items([sentence(words) for words in answer.reasons]),
            _numbers(answer),
            *(_numbers(of_file, name) for name, of_file in answer.each.items()),
            *(Sentence(sentence(words)) for words in _remarks(answer)),
        ),
        (
            *how_read,
            Section("What was driven", some(*_driven(answer)), "driven"),
            Section("Yaw rate", some(Figures(tuple(_charts(answer)))), "runs", level="page"),
        ),
        (),
        some(Sentence(LAW if answer.fit else "", "muted"), Sentence(versions_words(made), "muted")),
    )


def _first(answer: DrivingAnswer) -> str:
    found = answer.numbers
    if answer.each:
        return "These logs are not of one rover in one state: the numbers of each follow."
    if answer.level == "none":
        return "This driving does not show how the rover steers."
    late = ""
    if "response_time" in found:
        late = (
            f", and the turn follows {number(1000 * found['response_time'].value, 3)} ms after the steering"
        )
    if "curvature" in found:
        per = number(found["curvature"].value, 3)
        return f"The path curves by {per} 1/m for each 100 us of steering{late}."
    if "full_radius" in found:
        radius = number(found["full_radius"].value, 3)
        return f"The rover turns with a radius of {radius} m at full steering{late}."
    seen = number(found["wheelbase_seen"].value, 3)
    return f"The rover turns like one of {seen} m wheelbase at the recorded angle{late}."


def _numbers(answer: DrivingAnswer, of: str = "the steering") -> Table | None:
    rows = []
    for q in answer.numbers:
        scale, shown = (1000.0, "ms") if q.unit == "s" else (1.0, unit(q.unit))
        low, high = (None if end is None else scale * end for end in (q.low, q.high))
        digits = 4 if q.name == "straight" and q.unit == "us" else 3
        words = ends_words(low, high, digits)
        name = Cell(q.name.replace("_", " "), "strong")
        value = Cell(number(scale * q.value, digits), "strong")
        rows.append((name, Cell(unit(q.meaning)), value, Cell(shown), Cell(words)))
    headings = ("", "meaning", "value", "unit", "90 % interval")
    return Table(f"Numbers of {of}", headings, tuple(rows), text_columns=(0, 1, 3)) if rows else None


def _remarks(answer: DrivingAnswer) -> Iterator[str]:
    found, trim = answer.numbers, answer.driving.trim
    if "straight" in found and trim is not None and answer.driving.unit == "us":
        q = found["straight"]
        if q.low is not None and q.high is not None and not q.low - 2 <= trim <= q.high + 2:
            yield f"The rover drives straight at {q.value:.0f} us, its trim is {trim:.0f} us: set SERVOn_TRIM"
    for words in answer.unknown:
        yield f"Unknown: {words[0].lower()}{words[1:]}"
    better = []
    for name, half in answer.after_sweep:
        q = next((q for q in found if q.name == name), None)
        if q is not None and q.low is not None and q.high is not None and half < WORTH * (q.high - q.low) / 2:
            better.append(f"{name.replace('_', ' ')} (by {100 - 200 * half / (q.high - q.low):.0f} %)")
    if better:
        yield (
            f"A sweep of {SWEEP.amplitude:.0f} us at {SWEEP_SPEED:g} m/s ({SWEEP.duration:.0f} s) would make "
            f"these intervals narrower: {', '.join(better)}"
        )


def _driven(answer: DrivingAnswer) -> Iterator[Sentence | Table]:
    driving = answer.driving
    yield Sentence(f"Used: {driving.seconds:.0f} s in {count(len(driving.stretches), 'part')}.")
    if answer.fit is not None and answer.level != "none":
        low, high = answer.band
        size = (
            f"{answer.amplitude:.0f} us" if driving.unit == "us" else f"{answer.amplitude:.2g} {driving.unit}"
        )
        yield Sentence(
            f"Turns at {answer.speeds[0]:.1f} to {answer.speeds[2]:.1f} m/s, steering within {size} of "
            f"straight ahead, most of its power at {low:.2g} to {high:.2g} Hz. In parts of the drive that "
            f"were not fitted, the steering explains {100 * answer.fit.explained:.1f} % of the yaw rate."
        )
    rows = [(Cell(why), Cell(f"{seconds:.0f}")) for why, seconds in driving.left_out.items() if seconds >= 1]
    if rows and answer.level != "none":
        yield Table("Left out", ("", "s"), tuple(rows))


def _charts(answer: DrivingAnswer) -> Iterator[ChartPlan]:
    if answer.fit is None:
        return
    longest = sorted(answer.driving.stretches, key=lambda s: -s.seconds)[:SHOWN]
    words = "Yaw rate, measured and by the law; steering as recorded."
    for k, s in enumerate(sorted(longest, key=lambda s: float(s.t[0]))):
        yield ChartPlan(f"driving-{k + 1}", words, partial(_chart, answer, s))


def _chart(answer: DrivingAnswer, s: DrivenPart) -> Chart:
    assert answer.fit is not None
    degrees = 180 / np.pi
    step = max(1, round(s.t.size / (60 * RATE)))
    t = s.t[::step] - s.t[0]
    fitted = fitted_yaw_rate(answer.fit, s)
    panels = (
        Panel(
            f"steering, {unit(answer.driving.unit)}", t, (Curve("recorded", s.steered(0.0)[::step], DATA),)
        ),
        Panel("speed V, m/s", t, (Curve("recorded", s.v[::step], DATA),), height=80),
        Panel(
            "yaw rate r, deg/s",
            t,
            (
                Curve("measured", degrees * s.r[::step], DATA),
                Curve("by the law", degrees * fitted[::step], **AFTER),
            ),
        ),
    )
    return Chart((Stack(f"{s.name}, from {s.t[0]:.0f} s", "time, s", panels, (0.0, float(t[-1]))),))
