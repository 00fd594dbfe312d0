"""diagnosis.json: the whole diagnosis for programs. Its keys are the contract of `rover-sweep diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rover_sweep.diagnosis.result import (
    Diagnosis,
    EffectValue,
    Finding,
    Fit,
    HeldOut,
    Mismatch,
    Overlay,
    Unknown,
    Unseen,
)
from rover_sweep.diagnosis.verdict import hardly_matters, importance_words, turn_change
from rover_sweep.report.diagnosis.origin import DiagnosisOrigin
from rover_sweep.report.export.augmented_model_json import augmented_document
from rover_sweep.report.identification.identification_json import AXES, recording_document
from rover_sweep.report.wording.strict_json import plain

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


def largest_held_out(held_out: Sequence[HeldOut], overlays: Sequence[Overlay]) -> HeldOut | None:
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


def _finding(f: Finding, overlays: Sequence[Overlay]) -> dict[str, Any]:
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


def _value(v: EffectValue) -> dict[str, Any]:
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
