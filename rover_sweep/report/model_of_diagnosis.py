"""The model of a diagnosis as plain data, and back: the entry "model" of diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

from rover_sweep.diagnosis.augmented import AugmentedModel
from rover_sweep.identify.geometry import Geometry
from rover_sweep.identify.recording import LowPass


def augmented_document(model: AugmentedModel) -> dict[str, Any]:
    """Everything in it, SI units; "numbers" are the physical ones that follow from the rest."""
    return {
        "name": model.name,
        "baseline": model.baseline,
        "effects": model.effects,
        "numbers": model.numbers,
        "coordinates": model.x,
        "known": asdict(model.rover),
        "speed_m_s": model.speed,
        "filters": {c: {"cutoff_hz": f.cutoff_hz, "source": f.source} for c, f in model.filters.items()},
        "steering": {"trim_us": model.steering[0], "rad_per_us": model.steering[1]}
        if model.steering
        else None,
        "wait_s": model.wait,
        "happened_in": model.happened_in or None,
        "happened_at_s": model.happened_at,
    }


def augmented_from(document: Mapping[str, Any]) -> AugmentedModel:
    """The model out of its document; KeyError, TypeError or ValueError where that is none."""
    from rover_sweep.identify.effects import library

    effects = tuple(document["effects"])
    for effect in effects:
        if effect not in library():
            raise ValueError(f"there is no effect {effect!r}")
    steering = document["steering"]
    known: dict[str, Any] = {f.name: document["known"][f.name] for f in fields(Geometry)}
    return AugmentedModel(
        baseline=str(document["baseline"]),
        rover=Geometry(**{**known, "free": tuple(known["free"])}),
        effects=effects,
        x={str(name): float(value) for name, value in document["coordinates"].items()},
        speed=float(document["speed_m_s"]),
        filters={c: LowPass(f["cutoff_hz"], f["source"]) for c, f in document["filters"].items()},
        steering=(float(steering["trim_us"]), float(steering["rad_per_us"])) if steering else None,
        wait=float(document["wait_s"]),
        happened_in=document["happened_in"] or "",
        happened_at=document["happened_at_s"],
    )
