"""diagnosis.json: the whole diagnosis for programs. Its keys are the contract of `rover-sweep diagnose`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rover_sweep.data.codec import coded_by, decoded, encoded, in_json
from rover_sweep.data.recording import Recording
from rover_sweep.diagnosis.result import Diagnosis, Finding, Fit
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.verdict import hardly_matters, importance_words, turn_change
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.report.export.augmented_model_json import augmented_document, augmented_from
from rover_sweep.report.identification.identification_json import AXES, recording_document
from rover_sweep.report.wording import Provenance, plain

# Origin of a diagnosis: recordings, settings, provenance.


Role = Literal["fit", "held out", "simulation"]


@dataclass(frozen=True, eq=False)
class DiagnosisOrigin:
    """Recordings with their roles, settings and provenance of a diagnosis."""

    provenance: Provenance = field(default_factory=Provenance)
    recordings: tuple[tuple[Role, Recording], ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


FORMAT, FORMAT_VERSION = "rover-sweep diagnosis", 1
UNITS = (
    "SI, rad, rad/s; residual_over_noise is rms over the rms of the noise floor; J in dB and deg; J_rms in "
    "deg/s and ft/s^2"
)
in_json(Fit, sparse=("cost",))
in_json(Finding, held_out="held_out_all")
coded_by(AugmentedModel, augmented_document, augmented_from)
in_json(Diagnosis, left_out=("overlays",))


def diagnosis_document(found: Diagnosis, origin: DiagnosisOrigin) -> dict[str, Any]:
    """The diagnosis in plain JSON types; numbers that are not finite are null, keys keep their order.

    findings[].held_out is the score on the held-out run with the most data, null without a held-out run;
    held_out_all has the scores on all. evidence is flat: {name: number}. form: of the effect's law, "" where
    it has one only. p_none, p_else: probability that nothing which matters is missing, and that something is
    which has no name. cannot_see[].up_to is empty where these runs exclude no size.
    """
    own = encoded(found)
    for f, document in zip(found.findings, own["findings"], strict=True):
        samples = {h.run: sum(o.t.size for o in found.overlays if o.run == h.run) for h in f.held_out}
        best = max(f.held_out, key=lambda h: samples[h.run], default=None)
        document["held_out"] = encoded(best) if best else None
        document |= {"importance": importance_words(f), "hardly_matters": hardly_matters(f.held_out)}
    for u, document in zip(found.cannot_see, own["cannot_see"], strict=True):  # the end farthest from none
        bounds = document["up_to"].items()
        document["up_to"] = {name: {"value": u.up_to[name].value, **bound} for name, bound in bounds}
    vehicle, source = origin.provenance.vehicle, origin.provenance.vehicle_source
    return plain(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            **own,
            "turn": _turn(found),
            "seconds": round(found.seconds, 2),
            "recordings": [{"role": role, **recording_document(run)} for role, run in origin.recordings],
            "settings": origin.settings,
            "vehicle": {
                "name": vehicle.name if vehicle else "",
                "file": source[0] if source else None,
                "sha256": source[1] if source else None,
            },
            "conventions": {"axes": AXES, "units": UNITS},
            "versions": origin.provenance.versions,
            "command": origin.provenance.command or None,
            "made": origin.provenance.made or None,
        }
    )


def _turn(found: Diagnosis) -> dict[str, Any] | None:
    """What all findings together do to a turn; null where that is not known."""
    change = turn_change(found)
    if change is None:
        return None
    (delay, gain), speed = change, found.model.speed if found.model else 0.0
    return {
        "delay_s": delay,
        "gain_percent": 100 * gain,
        "distance_m": delay * speed,
        "speed_m_s": speed,
        "sentence": "; ".join(f.turn for f in found.findings if f.turn),
    }


# Reads diagnosis.json: the diagnosis and its model, without recordings and picture data.


def read_diagnosis(path: Path) -> Diagnosis:
    """The diagnosis in a file written by `diagnose`. UsageError for any other file."""
    try:
        document = read_json(path.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read as a diagnosis: {error}") from None
    return diagnosis_from(document, str(path))


def _refuse_constant(name: str) -> None:
    """Refuse NaN and Infinity, which Python's reader accepts but JSON does not have."""
    raise ValueError(f"{name} is not a JSON number")


def diagnosis_from(document: Any, name: str) -> Diagnosis:
    """The diagnosis in a document. name: of the document, for errors."""
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise UsageError(f"{name} is not a diagnosis.json; give the file that `diagnose` wrote")
    if document.get("format_version") != FORMAT_VERSION:
        found = document.get("format_version")
        raise UsageError(f"{name} has format version {found}; this program reads version {FORMAT_VERSION}")
    try:
        return decoded(document, Diagnosis)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(
            f"{name} is damaged ({type(error).__name__}: {error}); run diagnose again"
        ) from error
