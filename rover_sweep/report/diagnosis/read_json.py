"""Reads diagnosis.json: the diagnosis and its model, without recordings and picture data."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rover_sweep.data.by_name import ByName
from rover_sweep.diagnosis.result import (
    Diagnosis,
    EffectValue,
    Falsified,
    Finding,
    Fit,
    HeldOut,
    LawCurve,
    LawHeldOut,
    Mismatch,
    Profile,
    Unknown,
    Unseen,
    UpperBound,
)
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.report.diagnosis.diagnosis_json import FORMAT, FORMAT_VERSION
from rover_sweep.report.export.augmented_model_json import augmented_from


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
        mismatch=tuple(_mismatch(m) for m in d["mismatch"]),
        findings=tuple(_finding(f) for f in d["findings"]),
        unknown=_unknown(d["unknown"]),
        cannot_see=tuple(_unseen(u) for u in d["cannot_see"]),
        falsified=tuple(
            Falsified(f["parameter"], f["unit"], f["before"], f["after"]) for f in d["falsified"]
        ),
        parameters=_values(d["parameters"]),
        curves=tuple(_curve(c) for c in d.get("curves") or ()),
        scores=dict(d["scores"]),
        held_out=tuple(_held_out(h) for h in d["held_out"]),
        remarks=tuple(d["remarks"]),
        seconds=d["seconds"],
        runs=tuple(d["runs"]),
        held_out_runs=tuple(d["held_out_runs"]),
        p_none=d.get("p_none"),
        p_else=d.get("p_else"),
        model=augmented_from(model) if model else None,
    )


def _unseen(u: Mapping[str, Any]) -> Unseen:
    """Files of earlier versions have no bounds."""
    bounds = {
        name: UpperBound(b["unit"], b["low"], b["high"], b["matters"])
        for name, b in (u.get("up_to") or {}).items()
    }
    return Unseen(u["effect"], u["why"], bounds, u.get("change"), u.get("material", True))


def _mismatch(m: Mapping[str, Any]) -> Mismatch:
    low, high = m["band_rad_s"]
    shown = m.get("profile")
    profile = (
        Profile(shown["over"], shown["unit"], tuple(shown["x"]), tuple(shown["residual_over_noise"]))
        if shown
        else None
    )
    ratio = m["residual_over_noise"]
    return Mismatch(m["channel"], (low, high), m["condition"], ratio, m["sentence"], profile)


def _finding(f: Mapping[str, Any]) -> Finding:
    return Finding(
        f["effect"],
        tuple(f["look_alikes"]),
        _values(f["parameters"]),
        dict(f["evidence"]),
        tuple(_held_out(h) for h in f["held_out_all"]),
        f["next_run"],
        f["sentence"],
        f["equation"],
        f.get("form") or "",
        f.get("probability"),
        f.get("turn") or "",
    )


def _values(values: Mapping[str, Mapping[str, Any]]) -> ByName[EffectValue]:
    return ByName(
        EffectValue(name, v["unit"], v["value"], v["low"], v["high"], v["meaning"])
        for name, v in values.items()
    )


def _held_out(h: Mapping[str, Any]) -> HeldOut:
    before, after = (Fit(f["j_rms"], f["tic"], f.get("cost", {})) for f in (h["before"], h["after"]))
    return HeldOut(h["run"], before, after, h["share_removed"])


def _unknown(u: Mapping[str, Any] | None) -> Unknown | None:
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
