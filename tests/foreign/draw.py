"""Draws a set: a rover of some size, its four runs, and what is concealed in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator

from tests.foreign.drive import Drive, drives
from tests.foreign.law import Extras, Law
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.rover import SIZES, Rover, draw_rover
from tests.foreign.sensor_laws import SENSORS
from tests.foreign.sizing import Scale, scale_of, sized
from tests.foreign.steering_laws import STEERING
from tests.foreign.vehicle_laws import VEHICLE

LISTED: tuple[Law, ...] = (*STEERING, *VEHICLE, *SENSORS)
KINDS = {"none": 0, "single": 1, "double": 2, "triple": 3, "foreign_form": 1, "outside": 1}
TRIALS = 12  # laws that are tried until one shows in this rover


@dataclass(frozen=True)
class Hidden:
    """A concealed law. value in `unit`; visibility: see `sizing`; extras: its other numbers."""

    effect: str
    form: str
    value: float
    unit: str
    visibility: float
    extras: Extras


@dataclass(frozen=True)
class ForeignSet:
    """A rover with everything concealed in it, and its runs; the last is to be held out."""

    kind: str
    seed: int
    rover: Rover
    plan: tuple[Drive, ...]
    hidden: tuple[Hidden, ...]

    def truth(self) -> dict[str, Any]:
        """In plain JSON types."""
        return {"kind": self.kind, "seed": self.seed, "size": self.rover.size} | {
            "hidden": [{**vars(one), "extras": dict(one.extras)} for one in self.hidden]
        }


def laws(kind: str) -> tuple[Law, ...]:
    """The laws from which a kind is drawn."""
    if kind == "outside":
        return OUTSIDE_LAWS
    return tuple(law for law in LISTED if law.own != (kind == "foreign_form"))


def draw(kind: str, seed: int) -> ForeignSet:
    """A set of KINDS; the same for the same arguments."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    rover = draw_rover(rng, SIZES[int(rng.integers(len(SIZES)))])
    plan = drives(rng, rover)
    concealed, hidden, places = rover, [], set()
    scale = scale_of(rover, plan, rng) if KINDS[kind] else None
    for _ in range(TRIALS):
        if scale is None or len(hidden) == KINDS[kind]:
            break
        law = _some_law(rng, kind, places)
        found = conceal(rover, law, scale, rng)
        if found is None:
            continue
        one, size = found
        concealed = law.apply(concealed, size, one.extras)
        hidden.append(one)
        places.add(law.place)
    return ForeignSet(kind, seed, concealed, plan, tuple(hidden))


def _some_law(rng: Generator, kind: str, places: set[str]) -> Law:
    """Each effect is as likely as every other, whatever the number of its forms."""
    free = [law for law in laws(kind) if law.place not in places]
    effects = sorted({law.effect for law in free})
    effect = effects[int(rng.integers(len(effects)))]
    forms = [law for law in free if law.effect == effect]
    return forms[int(rng.integers(len(forms)))]


def conceal(rover: Rover, law: Law, scale: Scale, rng: Generator) -> tuple[Hidden, float] | None:
    """(what is hidden, its size), None where it would not show in this rover."""
    extras = law.extras(rng)
    found = sized(rover, law, extras, scale, rng)
    if found is None:
        return None
    size, visibility = found
    value = float(f"{law.value(rover, size):.4g}")
    return Hidden(law.effect, law.form, value, law.unit, round(visibility, 2), extras), size
