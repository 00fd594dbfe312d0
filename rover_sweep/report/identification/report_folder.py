"""The report folder: identification.json, report.html, pictures/*.svg, models/<name>.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.files.replaced import remove_file, write_file
from rover_sweep.identification.acceptance import usable
from rover_sweep.identification.pipeline import Identification
from rover_sweep.report.export.exported_model import exported_model
from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.wording.provenance import Provenance
from rover_sweep.report.wording.shown_units import SI, ShownUnits
from rover_sweep.report.wording.strict_json import strict_json

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
    from rover_sweep.report.charts.shown_chart import shown_chart
    from rover_sweep.report.identification.page import page
    from rover_sweep.report.identification.pictures import planned

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
