"""A diagnosis in plain JSON types, and the diagnosis itself with its time."""

from __future__ import annotations

import time
import traceback
from collections.abc import Sequence
from typing import Any

from rover_sweep.api.diagnose import FullDiagnosis, diagnose
from rover_sweep.api.read import Runs
from rover_sweep.data.recording import Recording
from rover_sweep.report.diagnosis.diagnosis_json import diagnosis_document

KEPT = (
    "verdict",
    "sentence",
    "findings",
    "unknown",
    "cannot_see",
    "held_out",
    "remarks",
    "scores",
    "p_none",
    "p_else",
)
LATER = ("form", "probability")  # fields of a finding that a version of the tool may have or lack


def answered(runs: Runs, held_out: Sequence[Recording], **settings: Any) -> dict[str, Any]:
    """`answer` of these runs with "seconds"; an exception gives the verdict "failed" with its traceback."""
    started = time.monotonic()
    try:
        found = answer(diagnose(runs, held_out, **settings))
    except Exception:  # a traceback is a result here
        found = {"verdict": "failed", "sentence": traceback.format_exc(), "findings": [], "unknown": None}
    return {**found, "seconds": round(time.monotonic() - started, 1)}


def answer(found: FullDiagnosis) -> dict[str, Any]:
    """What is graded and kept of a diagnosis; keys as in diagnosis.json."""
    document = diagnosis_document(found, found.origin)
    kept = {key: document.get(key) for key in KEPT}
    for one, finding in zip(kept["findings"], found.findings, strict=True):
        one.update({name: getattr(finding, name) for name in LATER if hasattr(finding, name)})
    kept["cannot_see"] = [one for one in kept["cannot_see"] if one.get("up_to")]
    return kept
