"""The study's folder: study.json, study.html, figures/*.svg."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import partial
from math import degrees
from pathlib import Path
from typing import Any

from rover_sweep.data.results import Progress
from rover_sweep.data.vehicle_file import MODELS
from rover_sweep.files.documents import write_file
from rover_sweep.identification.handling import handling, has_handling
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import response_chart, run_chart, verification_chart
from rover_sweep.report.document import Badge, Document, Figures, Section, Sentence, Tone
from rover_sweep.report.in_html import in_html, made_charts
from rover_sweep.report.wording import PAPER as PAPER_UNITS
from rover_sweep.report.wording import strict_json, versions, versions_words
from rover_sweep.study import published
from rover_sweep.study.findings import FINDINGS, StudyFinding
from rover_sweep.study.published import PAPER
from rover_sweep.study.virtual_study import (
    CHECKS,
    Practice,
    Study,
    cost_comparison,
    parameter_comparison,
    practices_table,
    verifications,
)

# Sentences on the whole study: how many findings came out, and the virtual rover.


def all_findings(study: Study) -> tuple[StudyFinding, ...]:
    """Every published finding, tested."""
    return tuple(make(study) for make in FINDINGS)


def outcome_counts(found: tuple[StudyFinding, ...]) -> str:
    """How many findings hold, and which do not."""
    came = sum(f.outcome == "came out" for f in found)
    part = sum(f.outcome == "came out in part" for f in found)
    not_out = [f.key for f in found if f.outcome == "did not come out"]
    words = f"{came} of {len(found)} statements came out on this rover, {part} in part"
    return words + (f", {len(not_out)} did not ({', '.join(not_out)})." if not_out else ".")


def rover_sentences(study: Study) -> tuple[str, ...]:
    """Sentences on physics that no structure models, on the firmware, and on assumptions."""
    q, turf, firmware = study.runs.asphalt, study.runs.grass, study.runs.firmware
    softer = 100 * (1 - turf.front_cornering_stiffness / q.front_cornering_stiffness)
    return (
        f"A nonlinear single track with roll and the body of Table 3 ({q.mass:g} kg, a "
        f"{q.cg_to_front_axle:g} m, b {q.cg_to_rear_axle:g} m). Its other physics is in none of the "
        f"three structures: tyres with a friction limit ({q.friction:g} of the load) and unequal axles "
        f"({q.front_cornering_stiffness:g} and {q.rear_cornering_stiffness:g} N/rad); a servo with "
        f"{1000 * q.servo_delay:.0f} ms of delay, {1000 * q.servo_lag:.0f} ms of lag and at most "
        f"{degrees(q.servo_rate_limit):.0f} deg/s; a speed that drops in corners; an uneven road; a "
        "velocity from an estimator.",
        f"The firmware is ArduRover as shipped: main loop {firmware.loop_hz} Hz, gyro low-pass "
        f"{firmware.gyro_filter_hz:g} Hz, accelerometer {firmware.accel_filter_hz:g} Hz. The applet's wave "
        "is computed once per loop and held.",
        "Assumed, because the paper does not give it: the servo, the scale from PWM to angle, the friction, "
        f"the road, the grass (tyres {softer:.0f} % softer, friction {turf.friction:g}, "
        f"{turf.road_force / q.road_force:.1f} times as rough), the amplitudes of the doublets, and that "
        "the published rover ran these filters.",
    )


# Figures 2, 3, 6, 7 and 8 of the paper from the study's runs.


VERIFIED = {"asphalt": "figure-7", "grass": "figure-8a", "fast": "figure-8b"}


def figures(study: Study) -> Iterator[ChartPlan]:
    """The figures in the paper's order and units, drawn later; fits are made as in the paper."""
    caption = "Figure 2: the sweep and the motion of the rover."
    yield ChartPlan("figure-2", caption, partial(run_chart, study.runs.sweeps[0]))
    seen = replace(
        study.paper.group,
        responses={o: replace(f, band=study.coherent[o]) for o, f in study.paper.group.responses.items()},
    )
    caption = (
        f"Figure 3: identified frequency responses at {study.paper.group.speed:.2f} m/s on asphalt. "
        "Orange: where the coherence is at least 0.6."
    )
    yield ChartPlan("figure-3", caption, partial(response_chart, seen, {}, PAPER_UNITS))
    for practice, name in ((study.paper, "figure-6"), (study.known, "figure-6-filters-known")):
        caption = f"Figure 6: the models over the measured responses; {practice.words}."
        models = {m: practice.result.models[m] for m in MODELS}
        draw = partial(response_chart, practice.group, models, PAPER_UNITS)
        yield ChartPlan(name, caption, draw)
    for check, name in VERIFIED.items():
        figure = "Figure 7" if check == "asphalt" else "Figure 8"
        caption = f"{figure}: {CHECKS[check]}, not used in any fit; {study.paper.words}."
        verdicts = {m: study.paper.check(m, check) for m in MODELS}
        draw = partial(verification_chart, study.runs.checks[check], verdicts, PAPER_UNITS)
        yield ChartPlan(name, caption, draw)


# study.json: every number of the study and the published ones.


def study_document(study: Study, found: tuple[StudyFinding, ...]) -> dict[str, Any]:
    """The study in plain types: findings, published numbers, the rover, and each way of fitting."""
    return {
        "format": "rover-sweep study 1",
        "paper": published.PAPER,
        "seed": study.seed,
        "versions": versions(),
        "findings": {f.key: {"claim": f.claim, "outcome": f.outcome, "text": f.text} for f in found},
        "published": {
            "parameters": {
                m: {n: asdict(p) for n, p in rows.items()} for m, rows in published.PARAMETERS.items()
            },
            "cost": {m: dict(row) for m, row in published.COSTS.items()},
            "verification": {
                c: {m: asdict(v) for m, v in row.items()} for c, row in published.VERIFICATION.items()
            },
            "bands_rad_s": dict(published.BANDS),
        },
        "rover": {"asphalt": asdict(study.runs.asphalt), "grass": asdict(study.runs.grass)},
        "firmware": asdict(study.runs.firmware),
        "speed_m_s": study.paper.group.speed,
        "coherent_bands_rad_s": dict(study.coherent),
        "practices": {
            key: {"title": p.title, "words": p.words, "models": {m: _model(p, m) for m in MODELS}}
            for key, p in study.practices.items()
        },
        "counterfactuals": {
            "roll_yaw_frozen_at_identified_speed_tic": study.counterfactuals.frozen.tic,
            "roll_yaw_cf_cr_free_tic": {k: v.tic for k, v in study.counterfactuals.untied.items()},
            "roll_yaw_gyro_filter_ignored_tau_s": study.counterfactuals.gyro_ignored["tau"].value,
            "roll_yaw_velocity_lag_known_izz_kg_m2": study.counterfactuals.prompt["Izz"].value,
            "lumped_as_table_4_average": study.counterfactuals.as_table_4.average,
        },
    }


def _model(practice: Practice, model: str) -> dict[str, Any]:
    fit, costs = practice.fit(model), practice.result.models[model].costs
    kept = ("value", "unit", "free", "cr_percent", "insensitivity_percent")
    speed = handling(fit).get("critical_speed") if has_handling(fit.structure) else None
    return {
        "parameters": {e.name: {name: getattr(e, name) for name in kept} for e in fit.estimates},
        "cost": {**costs, "average": fit.average, "fitted": list(fit.costs)},
        "verification": {c: _verification(practice, model, c) for c in CHECKS},
        "critical_speed_m_s": speed,
    }


def _verification(practice: Practice, model: str, check: str) -> dict[str, Any]:
    v = practice.check(model, check)
    channels = {o.channel: {"j_rms": o.j_rms, "tic": o.tic, "unit": o.unit} for o in v.overlays}
    return {"speed_m_s": v.speed, "j_rms": v.j_rms, "tic": v.tic, "channels": channels}


def write_study(
    study: Study, found: tuple[StudyFinding, ...], directory: Path, progress: Progress
) -> tuple[Path, Path]:
    """Writes all files, each replaced atomically: (study.json, study.html).

    UsageError if the directory cannot be written.
    """
    document = write_file(directory / "study.json", strict_json(study_document(study, found)))
    shown = study_report(study, found)
    charts = made_charts(shown, progress)
    for name, chart in charts.items():
        write_file(directory / "figures" / f"{name}.svg", chart.svg)
    return document, write_file(directory / "study.html", in_html(shown, charts))


OUTCOMES: dict[str, Tone] = {"came out": "good", "came out in part": "muted"}


def study_report(study: Study, found: tuple[StudyFinding, ...]) -> Document:
    """The study as a document, with the paper's figures."""
    charts = {plan.name: plan for plan in figures(study)}

    def shown(*names: str) -> Figures:
        return Figures(tuple(plan for name, plan in charts.items() if name.startswith(names)))

    models = ("bicycle", "roll-yaw", "lumped")
    verified = Section("", tuple(verifications(study)), beside=True)
    return Document(
        "Three model structures of a rover, compared again on a virtual rover",
        f"After {PAPER}. Seed {study.seed}, rover-sweep {versions()['rover_sweep']}.",
        (Sentence(outcome_counts(found), "strong"), practices_table(study)),
        (
            Section(
                "The paper's findings, one by one",
                tuple(
                    Section(
                        f.claim,
                        (Sentence(f.text),),
                        badges=(Badge(f.outcome, OUTCOMES.get(f.outcome, "warn")),),
                    )
                    for f in found
                ),
                "findings",
            ),
            Section("The virtual rover", tuple(map(Sentence, rover_sentences(study))), "rover", level="page"),
            Section("Table 5", (cost_comparison(study), shown("figure-6")), "costs"),
            Section("Tables 2-4", tuple(parameter_comparison(study, m) for m in models), "parameters"),
            Section("Tables 6-7", (verified, shown("figure-7", "figure-8")), "verification"),
            Section("Figures 2 and 3", (shown("figure-2", "figure-3"),), "responses"),
        ),
        foot=(Sentence(versions_words(versions()), "muted"),),
    )
