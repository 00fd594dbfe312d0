"""The report folder: identification.json, report.html, pictures/*.png, models/<name>.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.files.replaced import remove_file, write_file
from rover_sweep.identification.pipeline import Identification
from rover_sweep.report.export.exported_model import exported_model
from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.wording.acceptance import usable
from rover_sweep.report.wording.provenance import Provenance
from rover_sweep.report.wording.strict_json import strict_json

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class ReportFiles:
    """What was written. page and pictures are for people, document and models for machines."""

    directory: Path
    document: Path
    page: Path
    pictures: tuple[Path, ...]
    models: tuple[Path, ...]


def write_report(
    result: Identification, directory: Path, provenance: Provenance, progress: Progress | None = None
) -> ReportFiles:
    """Writes the whole report, identification.json last: a folder that holds it is whole and of one result.

    Everything is computed before the first file is touched; then the old identification.json goes, each
    file is replaced at once, and what an older report left is removed. progress is called with the share
    done, 0..1, and what is being made. Models whose numbers were rejected are not exported. UsageError
    where the directory cannot be written.
    """
    from rover_sweep.report.identification.page import page
    from rover_sweep.report.identification.pictures import planned

    told = progress or _silent
    told(0.0, "identification.json")
    document = strict_json(identification_document(result, provenance))
    models = _models(result, provenance)
    plan = planned(result, provenance)
    drawn = []
    for k, picture in enumerate(plan):
        told(0.05 + 0.85 * k / len(plan), f"pictures/{picture.name}.png")
        drawn.append((picture, picture.png()))
    told(0.95, "report.html")
    html = page(result, provenance, drawn)
    pictures = {f"{picture.name}.png": data for picture, data in drawn}
    files = _write(directory, document, html, pictures, models)
    told(1.0, "done")
    return files


def _silent(share: float, what: str) -> None:
    """No progress wanted."""


def _models(result: Identification, provenance: Provenance) -> dict[str, str]:
    """{file name: content} of models/."""
    vehicle = provenance.vehicle
    steering = None
    if vehicle and vehicle.trim_us and vehicle.rad_per_us:
        steering = vehicle.trim_us.value, vehicle.rad_per_us.value
    return {f"{name}.json": strict_json(exported_model(result, name, steering)) for name in usable(result)}


def _write(
    directory: Path, document: str, html: str, pictures: Mapping[str, bytes], models: Mapping[str, str]
) -> ReportFiles:
    remove_file(directory / "identification.json")
    pictures_written = _write_folder(directory / "pictures", "*.png", pictures)
    models_written = _write_folder(directory / "models", "*.json", models)
    page = write_file(directory / "report.html", html)
    last = write_file(directory / "identification.json", document)
    return ReportFiles(directory, last, page, pictures_written, models_written)


def _write_folder(directory: Path, pattern: str, contents: Mapping[str, str | bytes]) -> tuple[Path, ...]:
    written = tuple(write_file(directory / name, content) for name, content in contents.items())
    _remove_others(directory, pattern, written)
    return written


def _remove_others(directory: Path, pattern: str, keep: Sequence[Path]) -> None:
    """A report that is written again must not keep a model that it rejects now."""
    for path in set(directory.glob(pattern)) - set(keep):
        path.unlink()
