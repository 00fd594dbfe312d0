"""Export of a diagnosis: the linear part of its model, or the whole model as a simulated rover."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json


def diagnosis_file(place: Path) -> Path | None:
    """The diagnosis file given by a file or a folder (itself or its report/); None for anything else."""
    if place.is_file():
        return place if _is_diagnosis(place) else None
    for folder in (place, place / "report"):
        if (folder / "diagnosis.json").is_file():
            return folder / "diagnosis.json"
    return None


def read_augmented_model(path: Path) -> tuple[AugmentedModel, str]:
    """(model, verdict) of a diagnosis.json or a saved diagnosis; UsageError if it has no model."""
    from rover_sweep.api.diagnose import load_diagnosis
    from rover_sweep.api.simulate import model_of as kept

    found = load_diagnosis(path)
    return kept(found), found.verdict


def exported(path: Path, name: str | None, speed: float | None) -> dict[str, Any]:
    """The linear part as plain data; see `exported_augmented`."""
    from rover_sweep.report.export.diagnosed import exported_augmented

    model, verdict = read_augmented_model(path)
    if name not in (None, model.name):
        raise UsageError(f"{path} has only the model {model.name!r}; remove --model {name}")
    return exported_augmented(model, verdict, speed)


def _is_diagnosis(path: Path) -> bool:
    try:
        document = read_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    if not isinstance(document, dict):
        return False
    saved = document.get("result")
    kept = isinstance(saved, dict) and str(saved.get("is", "")).endswith(":FullDiagnosis")
    return kept or document.get("format") == "rover-sweep diagnosis"
