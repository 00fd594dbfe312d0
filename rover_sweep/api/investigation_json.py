"""investigation.json: the steps of an investigation with their reasons, for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rover_sweep.api.investigation import Decision
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.files.replaced import write_file
from rover_sweep.report.wording.strict_json import plain, strict_json

FORMAT, FORMAT_VERSION = "rover-sweep investigation", 1
DOCUMENT = "investigation.json"


def investigation_document(
    decisions: Sequence[Decision], earlier: Sequence[Mapping[str, Any]] = ()
) -> dict[str, Any]:
    """All steps in plain JSON types, those of an earlier call first.

    proposal and settles: the run to drive now and its reason, as in the JSON of `plan`. Of a step:
    expected_bits of its run, told_bits of the run before it.
    """
    step = decisions[-1].step
    steps = [*earlier, *(_step(decision) for decision in decisions)]
    return plain(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "settled": step.action == "settled",
            "action": step.action,
            "sentence": step.reason,
            "effects": step.effects,
            "proposal": [asdict(step.run)] if step.run else [],
            "settles": [step.reason] if step.run else [],
            "steps": [{"number": n, **one} for n, one in enumerate(steps, 1)],
            "units": "amplitude_us, bias_us: us; speed: m/s; heading: deg clockwise from north, null for any",
        }
    )


def _step(decision: Decision) -> dict[str, Any]:
    step, found = decision.step, decision.diagnosis
    return {
        "runs": decision.runs,
        "verdict": found.verdict if found else None,
        "findings": [
            {"effect": f.effect, "look_alikes": f.look_alikes, "probability": f.probability}
            for f in (found.findings if found else ())
        ],
        "action": step.action,
        "reason": step.reason,
        "run": asdict(step.run) if step.run else None,
        "expected_bits": step.bits,
        "told_bits": decision.told,
    }


def write_investigation(
    folder: Path, decisions: Sequence[Decision], earlier: Sequence[Mapping[str, Any]]
) -> Path:
    """Replace investigation.json in a folder; UsageError where it cannot be written."""
    return write_file(folder / DOCUMENT, strict_json(investigation_document(decisions, earlier)))


def steps_before(folder: Path) -> tuple[Mapping[str, Any], ...]:
    """The steps that an earlier call wrote into the folder; () without a document.

    UsageError for a damaged document, which would be lost when it is written again.
    """
    path = folder / DOCUMENT
    try:
        steps = read_json(path.read_text(encoding="utf-8"))["steps"]
        return tuple({k: v for k, v in step.items() if k != "number"} for step in steps)
    except (FileNotFoundError, NotADirectoryError):
        return ()
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(
            f"{path} cannot be read as the steps of an investigation ({error}); rename it to keep it, "
            "or give another folder"
        ) from None
