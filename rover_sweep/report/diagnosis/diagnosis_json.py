"""diagnosis.json: the whole diagnosis for programs. Its keys are the contract of `rover-sweep diagnose`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from rover_sweep.data.recording import Recording
from rover_sweep.data.results import ByName, Quantity
from rover_sweep.diagnosis.result import (
    Diagnosis,
    Falsified,
    Finding,
    Fit,
    HeldOut,
    LawCurve,
    LawHeldOut,
    Mismatch,
    Profile,
    TimeHistory,
    Unknown,
    Unseen,
    UpperBound,
)
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


def diagnosis_document(found: Diagnosis, origin: DiagnosisOrigin) -> dict[str, Any]:
    """The diagnosis in plain JSON types; numbers that are not finite are null, keys keep their order.

    findings[].held_out is the score on the held-out run with the most data, null without a held-out run;
    held_out_all has the scores on all. evidence is flat: {name: number}. form: of the effect's law, "" where
    it has one only. p_none, p_else: probability that nothing which matters is missing, and that something is
    which has no name.
    """
    return plain(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "verdict": found.verdict,
            "sentence": found.sentence,
            "baseline": found.baseline,
            "mismatch": [_mismatch(m) for m in found.mismatch],
            "p_none": found.p_none,
            "p_else": found.p_else,
            "findings": [_finding(f, found.overlays) for f in found.findings],
            "turn": _turn(found),
            "unknown": _unknown(found.unknown),
            "cannot_see": [_unseen(u) for u in found.cannot_see],
            "held_out": [_held_out(h) for h in found.held_out],
            "falsified": [
                {"parameter": f.name, "unit": f.unit, "before": f.before, "after": f.after}
                for f in found.falsified
            ],
            "parameters": {v.name: _value(v) for v in found.parameters},
            "curves": [asdict(c) for c in found.curves],
            "model": augmented_document(found.model) if found.model else None,
            "scores": found.scores,
            "remarks": found.remarks,
            "seconds": round(found.seconds, 2),
            "runs": found.runs,
            "held_out_runs": found.held_out_runs,
            "recordings": [{"role": role, **recording_document(run)} for role, run in origin.recordings],
            "settings": origin.settings,
            "vehicle": _vehicle(origin),
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


def largest_held_out(held_out: Sequence[HeldOut], overlays: Sequence[TimeHistory]) -> HeldOut | None:
    """The score on the held-out run with the most samples; the first if the numbers are unknown."""

    def samples(h: HeldOut) -> int:
        return sum(o.t.size for o in overlays if o.run == h.run)

    return max(held_out, key=samples, default=None)


def _mismatch(m: Mismatch) -> dict[str, Any]:
    out = {
        "channel": m.channel,
        "band_rad_s": m.band,
        "condition": m.condition,
        "residual_over_noise": m.residual_over_noise,
        "sentence": m.sentence,
    }
    if m.profile:
        out["profile"] = {
            "over": m.profile.over,
            "unit": m.profile.unit,
            "x": m.profile.x,
            "residual_over_noise": m.profile.ratio,
        }
    return out


def _finding(f: Finding, overlays: Sequence[TimeHistory]) -> dict[str, Any]:
    best = largest_held_out(f.held_out, overlays)
    return {
        "effect": f.effect,
        "look_alikes": f.look_alikes,
        "parameters": {v.name: _value(v) for v in f.parameters},
        "evidence": f.evidence,
        "held_out": _held_out(best) if best else None,
        "held_out_all": [_held_out(h) for h in f.held_out],
        "next_run": f.next_run,
        "sentence": f.sentence,
        "equation": f.equation,
        "form": f.form,
        "probability": f.probability,
        "importance": importance_words(f),
        "turn": f.turn,
        "hardly_matters": hardly_matters(f.held_out),
    }


def _value(v: Quantity) -> dict[str, Any]:
    return {"value": v.value, "unit": v.unit, "low": v.low, "high": v.high, "meaning": v.meaning}


def _held_out(h: HeldOut) -> dict[str, Any]:
    return {"run": h.run, "before": _fit(h.before), "after": _fit(h.after), "share_removed": h.share_removed}


def _fit(fit: Fit) -> dict[str, Any]:
    return {"j_rms": fit.j_rms, "tic": fit.tic} | ({"cost": fit.cost} if fit.cost else {})


def _unknown(u: Unknown | None) -> dict[str, Any] | None:
    if u is None:
        return None
    return {
        "channel": u.channel,
        "depends_on": u.depends_on,
        "residual_over_noise": u.residual_over_noise,
        "sentence": u.sentence,
        "law": u.law or None,
        "law_gain": u.law_gain,
        "place": u.place or None,
        "alternatives": u.alternatives,
        "curves": [asdict(c) for c in u.curves],
        "held_out": [asdict(h) for h in u.held_out],
        "could_be": u.could_be or None,
        "next_run": u.next_run or None,
    }


def _unseen(u: Unseen) -> dict[str, Any]:
    """up_to: null where these runs exclude no size."""
    bounds = {
        name: {"value": b.value, "unit": b.unit, "low": b.low, "high": b.high, "matters": b.matters}
        for name, b in u.up_to.items()
    }
    return {
        "effect": u.effect,
        "why": u.why,
        "up_to": bounds or None,
        "change": u.change,
        "material": u.material,
    }


def _vehicle(origin: DiagnosisOrigin) -> dict[str, Any]:
    vehicle, source = origin.provenance.vehicle, origin.provenance.vehicle_source
    return {
        "name": vehicle.name if vehicle else "",
        "file": source[0] if source else None,
        "sha256": source[1] if source else None,
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
        return _diagnosis(document)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(
            f"{name} is damaged ({type(error).__name__}: {error}); run diagnose again"
        ) from error


def _diagnosis(d: Mapping[str, Any]) -> Diagnosis:
    model = d.get("model")
    return Diagnosis(
        verdict=d["verdict"],
        sentence=d["sentence"],
        baseline=d["baseline"],
        mismatch=tuple(_mismatch_from(m) for m in d["mismatch"]),
        findings=tuple(_finding_from(f) for f in d["findings"]),
        unknown=_unknown_from(d["unknown"]),
        cannot_see=tuple(_unseen_from(u) for u in d["cannot_see"]),
        falsified=tuple(
            Falsified(f["parameter"], f["unit"], f["before"], f["after"]) for f in d["falsified"]
        ),
        parameters=_values(d["parameters"]),
        curves=tuple(_curve(c) for c in d.get("curves") or ()),
        scores=dict(d["scores"]),
        held_out=tuple(_held_out_from(h) for h in d["held_out"]),
        remarks=tuple(d["remarks"]),
        seconds=d["seconds"],
        runs=tuple(d["runs"]),
        held_out_runs=tuple(d["held_out_runs"]),
        p_none=d.get("p_none"),
        p_else=d.get("p_else"),
        model=augmented_from(model) if model else None,
    )


def _unseen_from(u: Mapping[str, Any]) -> Unseen:
    """Files of earlier versions have no bounds."""
    bounds = {
        name: UpperBound(b["unit"], b["low"], b["high"], b["matters"])
        for name, b in (u.get("up_to") or {}).items()
    }
    return Unseen(u["effect"], u["why"], bounds, u.get("change"), u.get("material", True))


def _mismatch_from(m: Mapping[str, Any]) -> Mismatch:
    low, high = m["band_rad_s"]
    shown = m.get("profile")
    profile = (
        Profile(shown["over"], shown["unit"], tuple(shown["x"]), tuple(shown["residual_over_noise"]))
        if shown
        else None
    )
    ratio = m["residual_over_noise"]
    return Mismatch(m["channel"], (low, high), m["condition"], ratio, m["sentence"], profile)


def _finding_from(f: Mapping[str, Any]) -> Finding:
    return Finding(
        f["effect"],
        tuple(f["look_alikes"]),
        _values(f["parameters"]),
        dict(f["evidence"]),
        tuple(_held_out_from(h) for h in f["held_out_all"]),
        f["next_run"],
        f["sentence"],
        f["equation"],
        f.get("form") or "",
        f.get("probability"),
        f.get("turn") or "",
    )


def _values(values: Mapping[str, Mapping[str, Any]]) -> ByName[Quantity]:
    return ByName(
        Quantity(name, v["unit"], v["value"], v["low"], v["high"], v["meaning"]) for name, v in values.items()
    )


def _held_out_from(h: Mapping[str, Any]) -> HeldOut:
    before, after = (Fit(f["j_rms"], f["tic"], f.get("cost", {})) for f in (h["before"], h["after"]))
    return HeldOut(h["run"], before, after, h["share_removed"])


def _unknown_from(u: Mapping[str, Any] | None) -> Unknown | None:
    if u is None:
        return None
    return Unknown(
        u["channel"],
        u["depends_on"],
        u["residual_over_noise"],
        u["sentence"],
        u["law"] or "",
        u["law_gain"],
        u.get("place") or "",
        tuple(u.get("alternatives") or ()),
        tuple(_curve(c) for c in u.get("curves") or ()),
        tuple(LawHeldOut(**h) for h in u.get("held_out") or ()),
        u.get("could_be") or "",
        u.get("next_run") or "",
    )


def _curve(c: Mapping[str, Any]) -> LawCurve:
    lists = {name: tuple(c[name]) for name in ("alternatives", "x", "y", "low", "high")}
    return LawCurve(**{**c, **lists})
