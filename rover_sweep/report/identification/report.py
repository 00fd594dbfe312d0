"""The report of an identification: its document, its charts, and its folder."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rover_sweep.data.recording import STEERING_CHANNELS, Recording, origin_remark, steering_of
from rover_sweep.data.results import Progress, number
from rover_sweep.files.documents import remove_file, write_file
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.handling import has_handling
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.pipeline import (
    TITLES,
    Identification,
    identified_runs,
    judged_runs,
    ordered,
    rejection,
    usable,
)
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import (
    error_chart,
    response_chart,
    run_chart,
    verification_chart,
)
from rover_sweep.report.document import (
    ZOOM,
    Badge,
    Document,
    Figures,
    Part,
    Section,
    Sentence,
    Table,
    Terms,
    Tone,
    items,
    made_words,
    small_print,
    some,
    table_of,
)
from rover_sweep.report.export.exported_model import exported_model
from rover_sweep.report.identification.identification_json import AXES, identification_document
from rover_sweep.report.identification.sentences import (
    amplitude_sentence,
    diagnosis_remark,
    filters_known,
    filters_remark,
    handling_sentence,
    handling_table,
    modes_sentence,
    prediction_sentence,
    residual_sentence,
    to_do,
)
from rover_sweep.report.identification.tables import (
    amplitude_table,
    both_ways_table,
    coherence_table,
    cost_table,
    filters_table,
    inertia_table,
    main_table,
    parameter_table,
    poles_table,
    reduction_table,
    variants_table,
    verification_tables,
)
from rover_sweep.report.in_html import in_html, made_charts
from rover_sweep.report.wording import SHORT_NAMES, SI, Provenance, ShownUnits, count, sentence, strict_json

LEVELS: dict[str, Tone] = {"good": "good", "acceptable": "good", "poor": "warn"}
COSTS = (
    ("J", "misfit of a frequency response in dB and deg: up to 50 hardly visible, up to 100 acceptable."),
    (
        "J_rms",
        "rms error of a prediction over all channels together, in the paper's units deg/s and ft/s² (1 "
        "ft/s² is 0.305 m/s²); the rows of one channel are in {units}. Up to 1 to 2 is good.",
    ),
    (
        "TIC",
        "Theil inequality coefficient: the error relative to the motion, from 0 (perfect) to 1; up to 0.25 "
        "to 0.35 is good.",
    ),
)
ACCURACIES = (
    (
        "90 % interval",
        "of this model's fit, with the vehicle file as exact: from repeating the whole method on resampled "
        "data, and from what the bicycle and roll-yaw models leave out. The numbers of the rover at the top "
        "allow for the vehicle file too: use those.",
    ),
    (
        "CR",
        "Cramér-Rao bound in percent of the value, for comparison with CIFER: from the curvature of J, "
        "without the noise level, and usually larger than the scatter; up to 20 % is good.",
    ),
    (
        "I",
        "insensitivity in percent: by how much the parameter may change, alone, with hardly any effect on "
        "J; up to 10 % is good.",
    ),
)
CONVENTIONS = (
    f"Axes are {AXES}. Angles of the models are in rad, frequencies in rad/s. The steering angle is that of "
    "the road wheels; cornering stiffness is per axle (both tyres). CR is the Cramer-Rao bound 2 √(H⁻¹)ᵢᵢ "
    "and I the insensitivity 1/√Hᵢᵢ, in percent of the value, with H the Hessian of the sum of the costs; "
    "guidelines CR ≤ 20 %, I ≤ 10 %. In J, 1 dB counts as much as 7.57 deg. Magnitudes are in dB of the "
    "unit named in each picture.",
    "Method: Tischler & Remple, Aircraft and Rotorcraft System Identification, 2012; models: Ivler, Gowans & "
    "Marfise, System identification of rover dynamics, 2022.",
)


def identification_report(
    result: Identification,
    provenance: Provenance,
    units: ShownUnits = SI,
    links: tuple[tuple[str, str], ...] = (),
    more: Table | None = None,
) -> Document:
    """The result as a document. links: (address, words) of pages beside it; more: a table below."""
    rover = provenance.vehicle.name if provenance.vehicle else ""
    speeds = " and ".join(f"{group.speed:.2f}" for group in result.groups)
    runs = count(sum(1 for _ in judged_runs(result)), "run")
    return Document(
        f"{rover or 'Rover'}: identified steering response",
        f"Identified from {runs} at {speeds} m/s, {made_words(provenance)}",
        _answer(result, provenance),
        (
            Section("", some(main_table(result), both_ways_table(result), amplitude_table(result), more)),
            _pictures(result, provenance, units),
            _comparison(result, provenance, units),
            _models(result),
            _recordings(result, provenance, units),
            Section(
                "Method, units, versions",
                (*(Sentence(words, level="page") for words in CONVENTIONS), *small_print(provenance)),
                "conventions",
                level="page",
            ),
        ),
        links,
    )


def _answer(result: Identification, provenance: Provenance) -> tuple[Part, ...]:
    first = [Sentence(words if words[-1] == "." else sentence(words), "strong") for words in result.summary]
    said = [
        prediction_sentence(result),
        amplitude_sentence(result),
        modes_sentence(result),
        handling_sentence(result),
    ]
    return some(
        *first,
        *(Sentence(sentence(words)) for words in said if words),
        Sentence(sentence(origin_remark(steering_of((*identified_runs(result), *provenance.verify_runs))))),
        *items(to_do(result, provenance)),
        Sentence(residual_sentence(result) or "", level="full"),
        Sentence(filters_remark(result) or "", level="full"),
        Sentence(diagnosis_remark(result) or ""),
    )


def _pictures(result: Identification, provenance: Provenance, units: ShownUnits) -> Section:
    checks = _verifications(result, provenance, units)
    none = None if checks else Sentence("No run was given for verification.", level="page")
    return Section(
        "Pictures",
        (
            Sentence(ZOOM, "muted"),
            *some(
                Section("Measured responses and the models", some(Figures(_responses(result, units)))),
                Section("Residual over frequency", some(Figures(_errors(result)))),
                Section(
                    "Verification on runs not used in the fit", some(none, Figures(checks)), "verification"
                ),
            ),
        ),
        "pictures",
        level="page",
    )


def _comparison(result: Identification, provenance: Provenance, units: ShownUnits) -> Section:
    shown = "SI" if units.name == "SI" else "ft/s² and deg/s"
    terms = Terms(tuple((term, words.format(units=shown)) for term, words in COSTS))
    tables = some(
        cost_table(result) if result.models else None,
        *verification_tables(result, units),
        handling_table(result, units),
        inertia_table(result, provenance),
    )
    parts = (terms, *some(Section("", tables, beside=True))) if tables else ()
    return Section("Comparison of the models", parts, "comparison", level="full")


def _models(result: Identification) -> Section:
    models = [_model(result, name) for name in ordered(result)]
    remark = Sentence(filters_remark(result) or "", "strong")
    effect = some(Sentence(filters_known(result)), remark, filters_table(result))
    filters = Section("Effect of the sensors' filters", effect, "filters", "closed")
    return Section("Models", (Terms(ACCURACIES), *models, filters), "models", level="full")


def _model(result: Identification, name: str) -> Section:
    model, rejected = result.models[name], rejection(result, name)
    chosen = name == result.recommended
    badges = [Badge(model.verdict.level, LEVELS.get(model.verdict.level, "bad"))]
    badges += [Badge("recommended", "good")] if chosen else []
    tables = some(parameter_table(result, name), reduction_table(model))
    in_handling = name == "kinematic" or has_handling(model.fit.structure)
    more = some(variants_table(result, name), None if rejected or in_handling else poles_table(model))
    return Section(
        f"{TITLES.get(name, name)} model",
        (
            Sentence(model.fit.structure.reference, "muted", level="page"),
            *(Sentence(sentence(words)) for words in model.verdict.sentences),
            Section("", tables, beside=True),
            Section("", more, beside=True, level="page"),
        ),
        folded="open" if chosen else "closed",
        badges=tuple(badges),
    )


def _recordings(result: Identification, provenance: Provenance, units: ShownUnits) -> Section:
    fits = [_recording(run, "identification", v.sentence if v else "") for run, v in judged_runs(result)]
    checks = [_recording(run, "verification", "") for run in provenance.verify_runs]
    histories = Figures(
        _distinct(
            ChartPlan(
                f"history-{_slug(run.name)}",
                f"Time history of {run.name}. {HISTORY}",
                partial(run_chart, run, units),
            )
            for run in (*identified_runs(result), *provenance.verify_runs)
        )
    )
    details = "Channels, notes and files of each run"
    return Section(
        "Recordings",
        some(
            coherence_table(result),
            Section("Time histories", some(histories), folded="closed", level="page"),
            Section(details, (*fits, *checks), folded="closed", level="page"),
        ),
        "recordings",
    )


def _recording(run: Recording, role: str, verdict: str) -> Section:
    start, end = run.span
    firmware = f", {run.firmware}" if run.firmware else ""
    notes = (Sentence(n.text, "warn" if n.level == "warning" else "", item=True) for n in run.notes)
    filters = {c: f"{number(f.cutoff_hz, 3)} Hz ({f.source})" for c, f in run.filters.items()}
    rows = (
        (
            SHORT_NAMES.get(name, name),
            (signal.source or "–") + (f" ({signal.origin})" if name in STEERING_CHANNELS else ""),
            signal.unit,
            number(run.manoeuvre(name).rate, 3),
            filters.get(name, "–"),
        )
        for name, signal in run.channels.items()
    )
    headings = ("channel", "source", "unit", "rate, Hz", "known low-pass")
    files = (Sentence(f"{file}: sha256 {digest}", "muted", code=True) for file, digest in run.sources)
    return Section(
        run.name,
        some(
            Sentence(sentence(verdict)),
            Sentence(f"{run.kind}, {end - start:.1f} s{firmware}", "muted"),
            *notes,
            table_of("Channels", headings, rows, text_columns=3),
            *files,
        ),
        badges=(Badge(role, "muted"),),
    )


# The report's charts, their captions, and the functions that make them.


HISTORY = (
    "White: the manoeuvre, used for the spectra. Light blue: standstill and straight driving, used to "
    "estimate biases."
)
MODELS = (
    "with the sensors' known filters. The fit uses the range between the orange lines, but no response "
    "whose title says that it is not in the fit."
)
ERRORS = (
    "Error of the models{at}: |model / measured - 1| over frequency, in the usable band. Within the grey "
    "area (two standard deviations of the random error) the data cannot tell it from zero."
)
RESPONSES = "Orange lines: the usable band (coherence at least 0.6, brief drops allowed)."


def shown_models(result: Identification) -> dict[str, ModelResult]:
    """The models to draw: all valid ones, the kinematic one only if recommended or alone."""
    found = usable(result)
    larger = {n: m for n, m in found.items() if n != "kinematic"}
    return found if result.recommended == "kinematic" or not larger else larger


def _responses(result: Identification, units: ShownUnits) -> tuple[ChartPlan, ...]:
    models, plans = shown_models(result), []
    for group in (g for g in result.groups if g.responses):
        at = f" at {group.speed:.2f} m/s"
        windows = ", ".join(f"{t:.1f}" for t in next(iter(group.responses.values())).windows)
        name = "responses"
        caption = f"Measured frequency responses{at}, windows of {windows} s. {RESPONSES}"
        if models:
            name, caption = "models", f"Measured responses{at} and the models' {MODELS}"
            if "lumped" in models and group is not result.groups[0]:
                caption += f" The lumped model is valid only at {result.speed:.2f} m/s."
        draw = partial(response_chart, group, models, units)
        plans.append(ChartPlan(f"{name}{_suffix(result, group)}", caption, draw))
    return tuple(plans)


def _errors(result: Identification) -> tuple[ChartPlan, ...]:
    models = shown_models(result)
    having = [g for g in result.groups if models and any(f.band for f in g.responses.values())]
    return tuple(
        ChartPlan(
            f"errors{_suffix(result, group)}",
            ERRORS.format(at=f" at {group.speed:.2f} m/s"),
            partial(error_chart, group, models),
        )
        for group in having
    )


def _suffix(result: Identification, group: Group) -> str:
    return f"-{group.speed:.2f}mps".replace(".", "p") if len(result.groups) > 1 else ""


def _verifications(
    result: Identification, provenance: Provenance, units: ShownUnits
) -> tuple[ChartPlan, ...]:
    models, plans = shown_models(result), []
    for k in range(max((len(m.verification) for m in models.values()), default=0)):
        verdicts = {n: m.verification[k] for n, m in models.items() if k < len(m.verification)}
        name = next(iter(verdicts.values())).run
        run = provenance.verify_runs[k] if k < len(provenance.verify_runs) else None
        caption = (
            f"Verification on {name}, which is not in the fit: its measured steering is the models' input."
        )
        draw = partial(verification_chart, run, verdicts, units)
        plans.append(ChartPlan(f"verification-{_slug(name)}", caption, draw))
    return _distinct(plans)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "run"


def _distinct(plans: Iterable[ChartPlan]) -> tuple[ChartPlan, ...]:
    """The charts, runs of the same name told apart by a number."""
    seen: dict[str, int] = {}
    out = []
    for plan in plans:
        seen[plan.name] = again = seen.get(plan.name, 0) + 1
        out.append(plan if again == 1 else replace(plan, name=f"{plan.name}-{again}"))
    return tuple(out)


# The report folder: identification.json, report.html, responses.csv, pictures/*.svg, models/<name>.json.


NAMED = ("speed_m_s", "input", "output", "unit")
MEASURED = ("w_rad_s", "magnitude_db", "phase_deg", "coherence", "random_error", "usable")


def responses_csv(result: Identification) -> str:
    """The measured responses as CSV, a row for each frequency; random_error is relative, 0 to 1."""
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow((*NAMED, *MEASURED))
    for group in result.groups:
        for f in (f for found in (group.responses, *group.others.values()) for f in found.values()):
            low, high = f.band or (math.inf, -math.inf)
            columns = (f.w, f.magnitude_db, f.phase_deg, f.coherence, f.random_error)
            for values in zip(*columns, strict=True):
                head = (f"{group.speed:.4g}", f.input, f.output, f.unit)
                rows.writerow((*head, *(f"{v:.6g}" for v in values), int(low <= values[0] <= high)))
    return out.getvalue()


@dataclass(frozen=True)
class ReportFiles:
    """Paths of the written files: page, pictures for people; document, responses, models for programs."""

    directory: Path
    document: Path
    page: Path
    responses: Path
    pictures: tuple[Path, ...]
    models: tuple[Path, ...]


def write_report(
    result: Identification,
    directory: Path,
    provenance: Provenance,
    progress: Progress | None = None,
    units: ShownUnits = SI,
) -> ReportFiles:
    """Write the whole report, identification.json last: a folder with it is complete and of one result.

    Everything is computed before the first file is changed. Then the old identification.json is removed,
    each file is replaced atomically, and files of an older report are removed. progress is called with the
    current file and the share done, 0..1. Models with rejected numbers are not exported. UsageError if the
    directory is not writable. units: of page and pictures; the documents are in SI.
    """
    report: Progress = progress or (lambda step, share: None)
    report("identification.json", 0.0)
    text = strict_json(identification_document(result, provenance))
    vehicle, steering = provenance.vehicle, None
    if vehicle and vehicle.trim_us and vehicle.rad_per_us:
        steering = vehicle.trim_us.value, vehicle.rad_per_us.value
    models = {n: strict_json(exported_model(result, n, steering)) for n in usable(result)}
    links = (("speed.html", "Speed"),) if (directory / "speed.html").is_file() else ()
    document = identification_report(result, provenance, units, links)
    charts = made_charts(document, lambda step, share: report(step, 0.05 + 0.85 * share))
    report("report.html", 0.95)
    page, responses = in_html(document, charts), responses_csv(result)
    remove_file(directory / "identification.json")
    pictures = _write_folder(directory / "pictures", ".svg", {n: c.svg for n, c in charts.items()})
    exported = _write_folder(directory / "models", ".json", models)
    html = write_file(directory / "report.html", page)
    table = write_file(directory / "responses.csv", responses)
    last = write_file(directory / "identification.json", text)
    report("done", 1.0)
    return ReportFiles(directory, last, html, table, pictures, exported)


def _write_folder(directory: Path, suffix: str, contents: Mapping[str, str]) -> tuple[Path, ...]:
    """Removes files of an older report, such as models that are now rejected."""
    written = tuple(write_file(directory / f"{n}{suffix}", text) for n, text in contents.items())
    for path in set(directory.glob(f"*{suffix}")) - set(written):
        path.unlink()
    return written
