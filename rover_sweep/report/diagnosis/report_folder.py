"""Folder of a diagnosis: diagnosis.html, diagnosis.json, and variant.toml for the simulated rover."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.files.replaced import remove_file, write_file
from rover_sweep.report.diagnosis.diagnosis_json import diagnosis_document
from rover_sweep.report.diagnosis.origin import DiagnosisOrigin
from rover_sweep.report.wording.strict_json import strict_json


@dataclass(frozen=True)
class DiagnosisFiles:
    """Paths of the written files."""

    document: Path
    page: Path
    variant: Path | None = None
    """The model as a simulated rover; None if the data were refused, or for a lumped model."""


def write_diagnosis(
    found: Diagnosis,
    directory: Path,
    origin: DiagnosisOrigin,
    progress: Callable[[float, str], None] | None = None,
) -> DiagnosisFiles:
    """Write all files, diagnosis.json last: a folder with diagnosis.json is complete and of one diagnosis.

    All content is computed before the first file is changed. progress is called with the share done, 0..1,
    and the current step. UsageError if the directory is not writable.
    """
    from rover_sweep.report.diagnosis.page import diagnosis_page
    from rover_sweep.report.diagnosis.pictures import planned
    from rover_sweep.report.export.plant_variant import variant_text
    from rover_sweep.report.pictures.drawn_pictures import drawn_pictures

    document = strict_json(diagnosis_document(found, origin))
    drawn = drawn_pictures(planned(found), progress)
    page = diagnosis_page(found, origin, drawn)
    text = variant_text(found.model) if found.model and not found.model.lumped else None
    for name in ("diagnosis.json", "variant.toml"):
        remove_file(directory / name)
    html = write_file(directory / "diagnosis.html", page)
    variant = write_file(directory / "variant.toml", text) if text else None
    return DiagnosisFiles(write_file(directory / "diagnosis.json", document), html, variant)
