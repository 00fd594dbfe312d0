"""The report folder: identification.json, report.html, pictures/*.png, models/<name>.json."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.identify.identification import Identification
from rover_sweep.report.document import identification_document
from rover_sweep.report.export import exported_model
from rover_sweep.report.files import write_file
from rover_sweep.report.provenance import Provenance
from rover_sweep.report.standing import usable
from rover_sweep.report.strict_json import dumps

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
    """Writes the whole report; each file is replaced at once, and what an older report left is removed.

    progress is called with the share done, 0..1, and what is being written. Models whose numbers were
    rejected are not exported. UsageError where the directory cannot be written.
    """
    from rover_sweep.report.page import page
    from rover_sweep.report.pictures import planned

    told = progress or _silent
    told(0.0, "identification.json")
    document = write_file(
        directory / "identification.json", dumps(identification_document(result, provenance))
    )
    models = _models(result, directory / "models", provenance)
    plan = planned(result, provenance)
    drawn = []
    for k, picture in enumerate(plan):
        told(0.05 + 0.85 * k / len(plan), f"pictures/{picture.name}.png")
        drawn.append((picture, picture.png()))
    pictures = tuple(write_file(directory / "pictures" / f"{p.name}.png", data) for p, data in drawn)
    _remove_others(directory / "pictures", "*.png", pictures)
    told(0.95, "report.html")
    html = write_file(directory / "report.html", page(result, provenance, drawn))
    told(1.0, "done")
    return ReportFiles(directory, document, html, pictures, models)


def _silent(share: float, what: str) -> None:
    """No progress wanted."""


def _models(result: Identification, directory: Path, provenance: Provenance) -> tuple[Path, ...]:
    vehicle = provenance.vehicle
    steering = None
    if vehicle and vehicle.trim_us and vehicle.rad_per_us:
        steering = vehicle.trim_us.value, vehicle.rad_per_us.value
    written = tuple(
        write_file(directory / f"{name}.json", dumps(exported_model(result, name, steering)))
        for name in usable(result)
    )
    _remove_others(directory, "*.json", written)
    return written


def _remove_others(directory: Path, pattern: str, keep: Sequence[Path]) -> None:
    """A report that is written again must not keep a model that it rejects now."""
    for path in set(directory.glob(pattern)) - set(keep):
        path.unlink()
