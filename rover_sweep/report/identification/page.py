"""The report as one self-contained HTML page: no network, no other file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rover_sweep.data.recording import Recording
from rover_sweep.data.results import number
from rover_sweep.files.replaced import remove_file, write_file
from rover_sweep.identification.acceptance import (
    TITLES,
    identified_runs,
    judged_runs,
    ordered,
    rejection,
    usable,
)
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.pipeline import Identification, ModelResult
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import (
    error_chart,
    response_chart,
    run_chart,
    verification_chart,
)
from rover_sweep.report.charts.static_svg import ShownChart, by_section
from rover_sweep.report.export.exported_model import exported_model
from rover_sweep.report.identification.comparison import (
    Table,
    coherence_table,
    cost_table,
    filters_table,
    inertia_table,
    numbers_table,
    parameter_table,
    poles_table,
    reduction_table,
    variants_table,
    verification_tables,
)
from rover_sweep.report.identification.identification_json import AXES, identification_document
from rover_sweep.report.identification.terminal import (
    diagnosis_remark,
    filters_known,
    filters_remark,
    finding,
    handling_table,
    to_do,
)
from rover_sweep.report.templates import environment
from rover_sweep.report.wording import SHORT_NAMES, SI, Provenance, ShownUnits, strict_json


def page(
    result: Identification,
    provenance: Provenance,
    pictures: Sequence[ShownChart],
    speed: bool = False,
    units: ShownUnits = SI,
) -> str:
    """The whole page, the charts of each section in the order given. speed: link to speed.html."""
    return (
        environment("report/identification")
        .get_template("page.html.j2")
        .render(
            speed=speed,
            units=units,
            name=provenance.vehicle.name if provenance.vehicle else "",
            result=result,
            provenance=provenance,
            axes=AXES,
            finding=finding(result),
            to_do=to_do(result, provenance),
            main_table=_main_table(result),
            models=[_model(result, name) for name in ordered(result)],
            speeds=" and ".join(f"{group.speed:.2f}" for group in result.groups),
            runs_table=coherence_table(result),
            cost=cost_table(result) if result.models else None,
            verification=verification_tables(result, units),
            inertia=inertia_table(result, provenance),
            handling=handling_table(result, units),
            filters=filters_table(result),
            filters_known=filters_known(result),
            filters_remark=filters_remark(result),
            diagnosis_remark=diagnosis_remark(result),
            recordings=_recordings(result, provenance),
            pictures=by_section(pictures),
        )
    )


def _main_table(result: Identification) -> Table | None:
    """The free parameters of the recommended model with their intervals, below the answer."""
    name = result.recommended
    if not name or rejection(result, name):
        return None
    if numbers := numbers_table(result):
        return numbers
    table = parameter_table(result, name, fixed_rows=False)
    rows = tuple(row[:5] for row in table.rows)
    return Table(f"{TITLES.get(name, name)} model, recommended", table.headings[:5], rows, text_columns=2)


def _model(result: Identification, name: str) -> dict[str, Any]:
    model, rejected = result.models[name], rejection(result, name)
    tables: list[Table | None] = [
        parameter_table(result, name),
        reduction_table(model),
        variants_table(result, name),
        None if rejected or name == "kinematic" else poles_table(model),
    ]
    return {
        "name": name,
        "title": TITLES.get(name, name),
        "reference": model.fit.structure.reference,
        "verdict": model.verdict,
        "recommended": name == result.recommended,
        "tables": [table for table in tables if table],
    }


def _recordings(result: Identification, provenance: Provenance) -> list[dict[str, Any]]:
    fits = [_recording(run, "identification", v.sentence if v else "") for run, v in judged_runs(result)]
    return fits + [_recording(run, "verification", "") for run in provenance.verify_runs]


def _recording(run: Recording, role: str, sentence: str) -> dict[str, Any]:
    start, end = run.span
    return {
        "run": run,
        "role": role,
        "sentence": sentence,
        "duration": end - start,
        "channels": [_channel(run, name) for name in run.channels],
    }


def _channel(run: Recording, name: str) -> tuple[str, ...]:
    signal = run.channels[name]
    rate = number(run.manoeuvre(name).rate, 3)
    return SHORT_NAMES.get(name, name), signal.source or "–", signal.unit, rate, _filter(run, name)


def _filter(run: Recording, channel: str) -> str:
    known = run.filters.get(channel)
    return f"{number(known.cutoff_hz, 3)} Hz ({known.source})" if known else "–"


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
    "Error of the models: |model / measured - 1| over frequency, in the usable band. Within the grey area "
    "(two standard deviations of the random error) the data cannot tell it from zero."
)
RESPONSES = "Orange lines: the usable band (coherence at least 0.6, brief drops allowed)."


def planned(result: Identification, provenance: Provenance, units: ShownUnits = SI) -> tuple[ChartPlan, ...]:
    """All charts of a result, not made yet; every name is different."""
    pictures = [
        *_responses(result, units),
        *_verifications(result, provenance, units),
        *_histories((*identified_runs(result), *provenance.verify_runs), units),
    ]
    return tuple(_distinct(pictures))


def shown_models(result: Identification) -> dict[str, ModelResult]:
    """The models to draw: all valid ones, the kinematic one only if recommended or alone."""
    found = usable(result)
    larger = {n: m for n, m in found.items() if n != "kinematic"}
    return found if result.recommended == "kinematic" or not larger else larger


def _histories(runs: tuple[Recording, ...], units: ShownUnits) -> Iterator[ChartPlan]:
    for run in runs:
        caption = f"Time history of {run.name}. {HISTORY}"
        yield ChartPlan(f"history-{_slug(run.name)}", "recordings", caption, partial(run_chart, run, units))


def _responses(result: Identification, units: ShownUnits) -> Iterator[ChartPlan]:
    models = shown_models(result)
    for group in (g for g in result.groups if g.responses):
        at = f" at {group.speed:.2f} m/s"
        suffix = f"-{group.speed:.2f}mps".replace(".", "p") if len(result.groups) > 1 else ""
        if models:
            caption = f"Measured responses{at} and the models' {MODELS}"
            if "lumped" in models and group is not result.groups[0]:
                caption += f" The lumped model is valid only at {result.speed:.2f} m/s."
            yield ChartPlan(
                f"models{suffix}", "models", caption, partial(response_chart, group, models, units)
            )
            if any(f.band for f in group.responses.values()):
                caption = f"{ERRORS[:20]}{at}{ERRORS[20:]}"
                yield ChartPlan(f"errors{suffix}", "errors", caption, partial(error_chart, group, models))
        else:
            caption = f"Measured frequency responses{at}, windows of {_windows(group)}. {RESPONSES}"
            yield ChartPlan(
                f"responses{suffix}", "models", caption, partial(response_chart, group, {}, units)
            )


def _windows(group: Group) -> str:
    lengths = next(iter(group.responses.values())).windows
    return ", ".join(f"{t:.1f}" for t in lengths) + " s"


def _verifications(result: Identification, provenance: Provenance, units: ShownUnits) -> Iterator[ChartPlan]:
    models = shown_models(result)
    count = max((len(m.verification) for m in models.values()), default=0)
    for k in range(count):
        verdicts = {n: m.verification[k] for n, m in models.items() if k < len(m.verification)}
        name = next(iter(verdicts.values())).run
        run = provenance.verify_runs[k] if k < len(provenance.verify_runs) else None
        caption = (
            f"Verification on {name}, which is not in the fit: its measured steering is the models' input."
        )
        draw = partial(verification_chart, run, verdicts, units)
        yield ChartPlan(f"verification-{_slug(name)}", "verification", caption, draw)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "run"


def _distinct(pictures: list[ChartPlan]) -> Iterator[ChartPlan]:
    seen: dict[str, int] = {}
    for picture in pictures:
        seen[picture.name] = seen.get(picture.name, 0) + 1
        again = seen[picture.name]
        yield picture if again == 1 else replace(picture, name=f"{picture.name}-{again}")


# The report folder: identification.json, report.html, pictures/*.svg, models/<name>.json.


Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class ReportFiles:
    """Paths of the written files: page and pictures for people, document and models for programs."""

    directory: Path
    document: Path
    page: Path
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
    share done, 0..1, and the current file. Models with rejected numbers are not exported. UsageError if the
    directory is not writable. units: of page and pictures; the documents are in SI.
    """
    from rover_sweep.report.charts.static_svg import shown_chart

    report = progress or _silent
    report(0.0, "identification.json")
    document = strict_json(identification_document(result, provenance))
    models = _models(result, provenance)
    plan = planned(result, provenance, units)
    drawn = []
    for k, chart in enumerate(plan):
        report(0.05 + 0.85 * k / len(plan), f"pictures/{chart.name}.svg")
        drawn.append(shown_chart(chart))
    report(0.95, "report.html")
    html = page(result, provenance, drawn, (directory / "speed.html").is_file(), units)
    pictures = {f"{chart.name}.svg": shown.svg for chart, shown in zip(plan, drawn, strict=True)}
    files = _write(directory, document, html, pictures, models)
    report(1.0, "done")
    return files


def _silent(share: float, what: str) -> None:
    """Default progress: does nothing."""


def _models(result: Identification, provenance: Provenance) -> dict[str, str]:
    """{file name: content} of models/."""
    vehicle = provenance.vehicle
    steering = None
    if vehicle and vehicle.trim_us and vehicle.rad_per_us:
        steering = vehicle.trim_us.value, vehicle.rad_per_us.value
    return {f"{name}.json": strict_json(exported_model(result, name, steering)) for name in usable(result)}


def _write(
    directory: Path, document: str, html: str, pictures: Mapping[str, str], models: Mapping[str, str]
) -> ReportFiles:
    remove_file(directory / "identification.json")
    pictures_written = _write_folder(directory / "pictures", "*.svg", pictures)
    models_written = _write_folder(directory / "models", "*.json", models)
    page = write_file(directory / "report.html", html)
    last = write_file(directory / "identification.json", document)
    return ReportFiles(directory, last, page, pictures_written, models_written)


def _write_folder(directory: Path, pattern: str, contents: Mapping[str, str]) -> tuple[Path, ...]:
    written = tuple(write_file(directory / name, content) for name, content in contents.items())
    _remove_others(directory, pattern, written)
    return written


def _remove_others(directory: Path, pattern: str, keep: Sequence[Path]) -> None:
    """Remove files of an older report, such as models that are now rejected."""
    for path in set(directory.glob(pattern)) - set(keep):
        path.unlink()
