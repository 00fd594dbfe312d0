"""The report folder: identification.json, report.html, pictures/*.png, models/<name>.json."""

from __future__ import annotations

from collections.abc import Callable
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
    """Writes the whole report; each file is replaced at once.

    progress is called with the share done, 0..1, and what is being written. Models whose numbers were
    rejected are not exported. UsageError where the directory cannot be written.
    """
    told = progress or (lambda share, what: None)
    told(0.0, "identification.json")
    document = write_file(
        directory / "identification.json", dumps(identification_document(result, provenance))
    )
    models = _models(result, directory, provenance)
    pictures = _pictures(result, directory, provenance, told)
    told(0.95, "report.html")
    from rover_sweep.report.page import page

    html = write_file(directory / "report.html", page(result, provenance, pictures))
    told(1.0, "done")
    paths = tuple(directory / "pictures" / f"{name}.png" for name in pictures)
    return ReportFiles(directory, document, html, paths, models)


def _models(result: Identification, directory: Path, provenance: Provenance) -> tuple[Path, ...]:
    vehicle = provenance.vehicle
    steering = None
    if vehicle and vehicle.trim_us and vehicle.rad_per_us:
        steering = vehicle.trim_us.value, vehicle.rad_per_us.value
    for stale in (directory / "models").glob("*.json"):
        stale.unlink()
    return tuple(
        write_file(directory / "models" / f"{name}.json", dumps(exported_model(result, name, steering)))
        for name in usable(result)
    )


def _pictures(
    result: Identification, directory: Path, provenance: Provenance, told: Progress
) -> dict[str, bytes]:
    """Every picture by name, written to pictures/ as soon as it is drawn."""
    from rover_sweep.report.pictures import planned

    plan = planned(result, provenance)
    done: dict[str, bytes] = {}
    for k, (name, draw) in enumerate(plan.items()):
        told(0.05 + 0.9 * k / len(plan), f"pictures/{name}.png")
        done[name] = draw()
        write_file(directory / "pictures" / f"{name}.png", done[name])
    return done
