"""comparison.json and twin.json: the answers for programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rover_sweep.comparison.answer import Comparison, Difference
from rover_sweep.comparison.corrected import Twin
from rover_sweep.diagnosis.result import EffectValue, UpperBound
from rover_sweep.report.wording.provenance import Provenance
from rover_sweep.report.wording.strict_json import plain


def comparison_document(found: Comparison, provenance: Provenance) -> dict[str, Any]:
    """The comparison in plain JSON types. Levels are rms over the noise of both sides together."""
    return plain(_head("rover-sweep comparison", provenance) | _comparison(found))


def twin_document(found: Twin, provenance: Provenance) -> dict[str, Any]:
    """All rounds of a corrected simulation, in plain JSON types."""
    return plain(
        _head("rover-sweep twin", provenance)
        | {
            "agrees": found.agrees,
            "sentence": found.sentence,
            "corrections": [asdict(c) for c in found.corrections],
            "left": found.left,
            "remarks": found.remarks,
            "rounds": [
                {
                    "simulator": r.simulator,
                    **_comparison(r.comparison),
                    "corrections": [asdict(c) for c in r.corrections],
                }
                for r in found.rounds
            ],
            "seconds": round(found.seconds, 2),
        }
    )


def _head(name: str, provenance: Provenance) -> dict[str, Any]:
    return {
        "format": name,
        "format_version": 1,
        "versions": provenance.versions,
        "command": provenance.command or None,
        "made": provenance.made or None,
    }


def _comparison(found: Comparison) -> dict[str, Any]:
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "differences": [_difference(d) for d in found.differences],
        "minor": [_difference(d) for d in found.minor],
        "instruments": [asdict(i) for i in found.instruments],
        "places": [
            {
                "channel": m.channel,
                "band_rad_s": m.band,
                "condition": m.condition,
                "difference_over_noise": m.residual_over_noise,
                "sentence": m.sentence,
            }
            for m in found.places
        ],
        "agreement": [asdict(a) for a in found.agreement],
        "could_differ": {
            name: {p: _bound(b) for p, b in bounds.items()} for name, bounds in found.could_differ.items()
        },
        "remarks": found.remarks,
        "seconds": round(found.seconds, 2),
    }


def _difference(d: Difference) -> dict[str, Any]:
    return {
        "kind": d.kind,
        "name": d.name,
        "simulation": {v.name: _value(v) for v in d.simulation},
        "recordings": {v.name: _value(v) for v in d.recordings},
        "change": d.change,
        "relative": d.relative,
        "gain": d.gain,
        "look_alikes": d.look_alikes,
        "sentence": d.sentence,
    }


def _value(v: EffectValue) -> dict[str, Any]:
    return {"value": v.value, "unit": v.unit, "low": v.low, "high": v.high, "meaning": v.meaning}


def _bound(b: UpperBound) -> dict[str, Any]:
    return {"unit": b.unit, "low": b.low, "high": b.high, "matters": b.matters}
