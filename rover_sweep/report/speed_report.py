"""The throttle sweeps as one self-contained page: answer and settings first, then the charts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from rover_sweep.data.results import ends_words, number
from rover_sweep.gains.proposal import SteeringLimits
from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal
from rover_sweep.identification.identify_speed import SHARE, SpeedResult, speed_parameters
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import (
    speed_step_chart,
    throttle_response_chart,
    throttle_run_chart,
)
from rover_sweep.report.document import (
    Badge,
    Cell,
    Cells,
    Document,
    Figures,
    Section,
    Sentence,
    Table,
    Tone,
    items,
    some,
    table_of,
)
from rover_sweep.report.wording import count, sentence, unit, versions, versions_words

# The response of the speed to the throttle as plain data, for speed.json.


_KEPT = ("CRUISE_", "ATC_SPEED_", "ATC_ACCEL", "ATC_DECEL", "ATC_BRAKE", "MOT_", "SCHED_LOOP_RATE")


def speed_document(result: SpeedResult) -> dict[str, Any]:
    """The result; keys include units. "law" is null without one; throttles are shares of full throttle."""
    fit, found, first, coasting = result.fit, result.coherence, result.runs[0], result.coasting
    law = None
    if fit is not None:
        m = fit.model
        law = {"gain_m_s": m.gain, "lag_s": m.lag, "delay_s": m.delay, "offset": m.offset}
    return {
        "format": "rover-sweep speed",
        "format_version": 1,
        "runs": [run.name for run in result.runs],
        "sources": [list(source) for run in result.runs for source in run.sources],
        "level": result.level,
        "reasons": list(result.reasons),
        "speeds_m_s": list(result.speeds),
        "throttles": list(result.throttles),
        "neutral_us": first.neutral_us,
        "travel_us": first.travel_us,
        "law": law,
        "intervals": {name: list(ends) for name, ends in fit.intervals.items()} if fit else {},
        "fit": fit.fit if fit else None,
        "residual_m_s": fit.residual if fit else None,
        "band_rad_s": list(found.band) if found and found.band else None,
        "coherence": {
            "w_rad_s": found.w.tolist(),
            "coherence": found.coherence.tolist(),
            "gain_m_s": found.gain.tolist(),
            "phase_rad": found.phase.tolist(),
        }
        if found
        else None,
        "coasting": {
            "speed_m_s": coasting.speed,
            "deceleration_m_s2": coasting.deceleration,
            "interval_m_s2": list(coasting.interval),
            "seconds": coasting.seconds,
            "dead_zone": coasting.dead_zone,
            "dead_zone_interval": list(coasting.dead_zone_interval) if coasting.dead_zone_interval else None,
        }
        if coasting
        else None,
        "parameters": {n: v for n, v in sorted(first.parameters.items()) if n.startswith(_KEPT)},
    }


# The response of the speed, the proposed settings and the recordings as tables.


UNITS = {
    "CRUISE_SPEED": "m/s",
    "CRUISE_THROTTLE": "%",
    "ATC_SPEED_P": "",
    "ATC_SPEED_I": "",
    "ATC_SPEED_D": "",
    "ATC_ACCEL_MAX": "m/s²",
}
FREEWHEELS = "The motor freewheels at neutral, so the dead zone cannot be separated from the drag."
NOT_COASTED = "No coasting was recorded: let the rover roll out with the throttle at neutral."


def speed_parameter_table(result: SpeedResult) -> Table | None:
    """Gain, lag, delay, dead zone and drag with their intervals; None without a law."""
    if result.fit is None:
        return None
    found = speed_parameters(result)
    rows = []
    for p in found:
        scale, shown = (100.0, "% throttle") if p.unit == SHARE else (1.0, unit(p.unit))
        scale, shown = (1000.0, "ms") if p.name == "delay" else (scale, shown)
        low, high = (None if end is None else scale * end for end in (p.low, p.high))
        value = Cell(number(scale * p.value, 3), "strong")
        name = "coasting" if p.name == "coasting_drag" else p.name.replace("_", " ")  # short, for a phone
        rows.append((Cell(name, "strong"), f"{p.meaning}, {shown}", value, ends_words(low, high)))
    note = "" if "dead_zone" in found else FREEWHEELS if result.coasting is not None else NOT_COASTED
    share = f"The law explains {number(100 * result.fit.fit, 3)} % of the speed's variation."
    headings = ("", "meaning, unit", "value", "90 %")
    return table_of("Response of the speed to the throttle", headings, rows, f"{share} {note}".strip(), 2)


def speed_gains_table(
    proposal: SpeedProposal, limits: SteeringLimits | None, current: Mapping[str, float]
) -> Table | None:
    """Parameters, current and proposed; None without settings to compare."""
    if proposal.now is None or proposal.proposed is None:
        return None
    new = proposal.proposed.settings.parameters
    rows = [
        _setting(name, UNITS[name], value, new[name], name in proposal.loop.assumed)
        for name, value in proposal.now.settings.parameters.items()
    ]
    if proposal.throttle_min is not None:
        rows.append(_setting("MOT_THR_MIN", "%", 100 * proposal.loop.least, proposal.throttle_min))
    if limits is not None:
        rows += [
            _setting(name, shown, current.get(name), value)
            for name, shown, value in (
                ("ATC_STR_RAT_MAX", "deg/s", limits.rate_max),
                ("ATC_TURN_MAX_G", "g", limits.turn_g),
            )
            if value is not None
        ]
    note = (
        "ATC_STR_RAT_MAX: 90 % of what the steering's stops reach. ATC_TURN_MAX_G: confirmed by the runs."
        if limits is not None
        else "ATC_STR_RAT_MAX and ATC_TURN_MAX_G need steering sweeps in the same folder of results."
    )
    if limits is not None and limits.lowers:
        note += " It is below the current value only because more was not tested: keep the current one."
    return table_of("Settings", ("parameter", "unit", "now", "proposed"), rows, note, 2)


def _setting(name: str, shown: str, now: float | None, new: float, assumed: bool = False) -> Cells:
    was = f"{now:.4g}{' (default)' if assumed else ''}" if now is not None else "–"
    same = now is not None and f"{now:.4g}" == f"{new:.4g}"
    return Cell(name, "strong"), shown, was, Cell(f"{new:.4g}", "" if same else "strong")


def speed_margin_table(proposal: SpeedProposal) -> Table | None:
    """Margins and predicted step of the current and the proposed settings."""
    pairs = (("now", proposal.now), ("proposed", proposal.proposed))
    columns = {words: _judged(judged) for words, judged in pairs if judged is not None}
    if not columns or proposal.now is None:
        return None
    labels = list(next(iter(columns.values())))
    rows = ((label, *(column[label] for column in columns.values())) for label in labels)
    step = proposal.now.step
    note = (
        "Worst: within the 90 % intervals, with a battery 10 % up or down; at least 6 dB and 45 deg are "
        f"kept. Step from {step.start:.2f} to {step.start + step.size:.2f} m/s; the tracking error "
        "is from the target after the firmware's acceleration limit."
    )
    return table_of("Margins and predicted step", ("", *columns), rows, note)


def _judged(judged: AssessedSpeed) -> dict[str, str]:
    step, margins = judged.step, judged.margins
    return {
        "gain margin, dB": number(margins.gain_db, 3),
        "phase margin, deg": number(margins.phase_deg, 3),
        "worst gain margin, dB": number(judged.worst_gain, 3),
        "worst phase margin, deg": number(judged.worst_phase, 3),
        "crossover frequency, rad/s": number(margins.crossover, 3),
        "rise time of the step, s": number(step.rise, 3),
        "overshoot, %": number(step.overshoot, 2),
        "tracking error, m/s rms": number(step.error, 2),
        "largest throttle, %": number(100 * step.throttle, 2),
    }


def throttle_run_table(result: SpeedResult) -> Table:
    """Each sweep with its duration, swept frequencies, firmware and file."""
    rows = (
        (
            run.name,
            ", ".join(f"{name} ({sha[:12]})" for name, sha in run.sources),
            run.firmware,
            run.stopped or "complete",
            number(run.span[1] - run.span[0], 3),
            f"{number(run.swept[0], 2)}–{number(run.swept[1], 3)}",
        )
        for run in result.runs
    )
    headings = ("run", "file (SHA-256)", "firmware", "", "s", "rad/s")
    return table_of("Throttle sweeps", headings, rows, text_columns=4)


TONES: dict[str, Tone] = {"good": "good", "acceptable": "warn", "poor": "bad", "none": "bad"}


@dataclass(frozen=True, eq=False)
class SpeedFindings:
    """What the page shows. limits: of the steering, None without steering sweeps; current: the autopilot's
    parameters by name; steering: whether report.html is in the same folder."""

    result: SpeedResult
    proposal: SpeedProposal
    limits: SteeringLimits | None = None
    current: Mapping[str, float] = field(default_factory=dict)
    steering: bool = False


def speed_gains_report(proposal: SpeedProposal) -> Document:
    """Current and proposed settings of the speed loop as a document."""
    low, _, high = proposal.found.speeds
    words = {
        "gains": f"Speed loop for {low:.2f} to {high:.2f} m/s",
        "cruise only": "Only CRUISE_SPEED and CRUISE_THROTTLE can be computed",
        "none": "No speed gains can be computed from these throttle sweeps",
    }
    verdict = f"{words[proposal.level]} (identification: {proposal.found.level})."
    settings = speed_gains_table(proposal, None, {})
    tables = some(settings and replace(settings, note=""), speed_margin_table(proposal))
    return Document(
        "Gains of the speed",
        "",
        (Sentence(verdict, "strong"), *items([f"because {reason}" for reason in proposal.reasons])),
        (Section("", (*tables, *items([f"note: {words}" for words in _notes(proposal)]))),),
    )


LAW = (
    "Law: T dv/dt = K (u(t − delay) − offset) − v, with lag T, gain K, throttle u (share of full) and speed "
    "v. Intervals are 90 %, with noise that is correlated in time; they do not include errors of the law "
    "itself."
)
RESPONSE = (
    "Response of the speed to the throttle, measured (Welch's averages) and of the law. Grey: coherence "
    "below 0.6."
)
STEP = "Predicted by simulation of the firmware's speed loop around the law, with all its limits."
TRY = (
    "Write them to a file: rover-sweep gains FOLDER --out speed.param. Try it with the wheels off the ground "
    "first, then at low speed with room ahead."
)


def speed_report(found: SpeedFindings) -> Document:
    """The throttle sweeps as a document."""
    result, proposal = found.result, found.proposal
    low, _, high = result.speeds
    remarks = proposal.reasons if proposal.level != "none" else ()  # else those of the identification
    words = "Throttle and speed, measured and simulated by the law. Grey: not part of the fit."
    drives = [
        ChartPlan(f"throttle-{run.name}", words, partial(throttle_run_chart, run, result.fit, k))
        for k, run in enumerate(result.runs)
    ]
    response = []
    if result.fit is not None and result.coherence is not None:
        draw = partial(throttle_response_chart, result.coherence, result.fit)
        response.append(ChartPlan("speed-response", RESPONSE, draw))
    step = []
    if proposal.now is not None and proposal.proposed is not None:
        step.append(ChartPlan("speed-step", STEP, partial(speed_step_chart, proposal)))
    runs, made = count(len(result.runs), "throttle sweep"), versions()
    return Document(
        "Speed and throttle",
        f"{runs}, {low:.2f} to {high:.2f} m/s; rover-sweep {made['rover_sweep']}",
        some(
            Sentence(_answer(found), "strong", badge=Badge(result.level, TONES[result.level])),
            *items([sentence(words) for words in result.reasons]),
            speed_parameter_table(result),
            speed_gains_table(proposal, found.limits, found.current),
            Sentence(TRY if proposal.proposed else "", level="page"),
        ),
        (
            Section(
                "Margins and predicted step of the speed",
                some(speed_margin_table(proposal), Figures(tuple(step))) if step else (),
                "step",
                level="page",
            ),
            Section("", tuple(Sentence(sentence(w), "muted") for w in (*remarks, *_notes(proposal)))),
            Section("Recordings", (Figures(tuple(drives)), throttle_run_table(result)), "runs", level="page"),
            Section("Frequency response", some(Figures(tuple(response))), "response", level="page"),
        ),
        (("report.html", "Steering"),) if found.steering else (),
        (Sentence(LAW, "muted"), Sentence(versions_words(made), "muted")),
    )


def _answer(found: SpeedFindings) -> str:
    """The one sentence of the page."""
    judged, low, high = found.proposal.proposed, found.result.speeds[0], found.result.speeds[2]
    if found.result.fit is None:
        return "The response of the speed to the throttle was not identified."
    if judged is None:
        return "The response of the speed was identified, but it supports no gains."
    if found.proposal.level != "gains":
        return "Only CRUISE_SPEED and CRUISE_THROTTLE can be computed."
    s, step = judged.settings, judged.step
    return (
        f"ATC_SPEED_P {s.p:.3g} and ATC_SPEED_I {s.i:.3g} for {low:.2f} to {high:.2f} m/s: predicted "
        f"overshoot {step.overshoot:.0f}\N{NO-BREAK SPACE}%, rise {step.rise:.2f} s, margins at least "
        f"{judged.worst_gain:.0f} dB and {judged.worst_phase:.0f} deg."
    )


def _notes(proposal: SpeedProposal) -> Iterator[str]:
    yield from proposal.remarks
    if proposal.now is not None and proposal.loop.assumed:
        yield f"assumed at the firmware's defaults: {', '.join(proposal.loop.assumed)}"
