"""The model of a diagnosis to and from plain data: the entry "model" of diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from rover_sweep.data.codec import decoded, encoded
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import LowPass
from rover_sweep.diagnosis.result import BASELINES
from rover_sweep.diagnosis.simulation.augmented import DERIVATIVES, AugmentedModel
from rover_sweep.diagnosis.simulation.table_law import TableLaw, refuse_law

LARGEST = 1e6  # largest accepted physical number or derivative, SI units
LARGEST_COORDINATE = 20.0  # of the fit's coordinates: s, rad, m, m/s^2, shares and logarithms
_ABOVE_0 = {"speed_m_s"} | {
    f"known {name}" for name in ("mass", "a", "b", "sprung_mass", "roll_inertia", "yaw_inertia", "friction")
}


def augmented_document(model: AugmentedModel) -> dict[str, Any]:
    """All data of the model in SI units; "numbers" are physical values computed from the rest."""
    return {
        "name": model.name,
        "baseline": model.baseline,
        "effects": model.effects,
        "numbers": model.numbers,
        "coordinates": model.x,
        "known": encoded(model.rover),
        "speed_m_s": model.speed,
        "filters": {c: {"cutoff_hz": f.cutoff_hz, "source": f.source} for c, f in model.filters.items()},
        "steering": {"trim_us": model.steering[0], "rad_per_us": model.steering[1]}
        if model.steering
        else None,
        "wait_s": model.wait,
        "happened_in": model.happened_in or None,
        "happened_at_s": model.happened_at,
        "laws": encoded(model.laws),
        "happened_order": model.happened_order,
        "steering_origin": model.steering_origin,
    }


def augmented_from(document: Mapping[str, Any]) -> AugmentedModel:
    """The model from its document; KeyError, TypeError or ValueError for an invalid one."""
    from rover_sweep.diagnosis.effects import every_form

    effects = tuple(document["effects"])
    for effect in effects:
        if effect not in every_form():
            raise ValueError(f"there is no effect {effect!r}")
    steering = document["steering"]
    model = AugmentedModel(
        baseline=str(document["baseline"]),
        rover=decoded(document["known"], Geometry),
        effects=effects,
        x=decoded(document["coordinates"], dict[str, float]),
        speed=float(document["speed_m_s"]),
        filters={c: LowPass(f["cutoff_hz"], f["source"]) for c, f in document["filters"].items()},
        steering=(float(steering["trim_us"]), float(steering["rad_per_us"])) if steering else None,
        wait=float(document["wait_s"]),
        happened_in=document["happened_in"] or "",
        happened_at=document["happened_at_s"],
        laws=tuple(law_from(law) for law in document.get("laws", ())),
        happened_order=int(document.get("happened_order", 0)),
        steering_origin=str(document.get("steering_origin", "")),
    )
    refuse_implausible(model)
    return model


def law_from(document: Any) -> TableLaw:
    """A law from its document; KeyError, TypeError or ValueError for an invalid one."""
    law = decoded(document, TableLaw)
    refuse_law(law)
    return law


def refuse_implausible(model: AugmentedModel) -> None:
    """ValueError with name and value for a number that no fit can return (a damaged or foreign file)."""
    if model.baseline not in BASELINES:
        raise ValueError(f"there is no baseline {model.baseline!r}")
    known = {f.name: getattr(model.rover, f.name) for f in fields(Geometry) if f.name != "free"}
    at = () if model.happened_at is None else (("happened_at_s", model.happened_at),)
    others = {
        **{f"known {name}": value for name, value in known.items() if value is not None},
        **{f"cutoff_hz of {channel}": f.cutoff_hz for channel, f in model.filters.items()},
        **dict((("speed_m_s", model.speed), ("wait_s", model.wait), *at)),
        **dict(zip(("trim_us", "rad_per_us"), model.steering or (), strict=False)),
    }
    for name, value in others.items():
        _refuse_outside(name, value, LARGEST)
        if name in _ABOVE_0 and value <= 0:
            raise ValueError(f"{name} = {value:g} must be above 0")
    own = {e.key(p.name): 1.01 * max(abs(p.low), abs(p.high)) for e in model.added for p in e.parameters}
    for name, value in model.x.items():
        usual = LARGEST if name in DERIVATIVES else LARGEST_COORDINATE
        _refuse_outside(name, value, own.get(name, usual))


def _refuse_outside(name: str, value: object, most: float) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} = {value!r} is not a number")
    if not abs(value) <= most:  # also true for NaN
        raise ValueError(f"{name} = {value:g} is not between {-most:g} and {most:g}")
