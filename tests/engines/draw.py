"""Draws a set: a rover of an engine, its four runs, and what is concealed in it."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

import rover_sweep as rs
from rover_sweep.api.read import with_delta
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import parse
from tests.engines.engine import MODULES, Engine, driven, engine
from tests.engines.rover import EngineRover, drawn_rover
from tests.engines.sizing import Sizing
from tests.foreign.drive import Drive, drives
from tests.foreign.law import Law
from tests.foreign.recorded import logged
from tests.foreign.rover import vehicle_toml

KINDS = {"none": 0, "single": 1, "double": 2, "outside": 1}
TRIALS = 10  # effects that are tried until enough of them show in this rover
VERSION = 2  # of the cached sets: another number where the drawing has changed


@dataclass(frozen=True)
class BenchSet:
    """One set. hidden: effect ids, "outside:..." outside the list. truth: engine, size, laws; JSON types."""

    engine: str
    kind: str
    seed: int
    runs: rs.Runs
    held_out: tuple[Recording, ...]
    hidden: tuple[str, ...]
    truth: dict[str, Any]


def drawn_set(engine_name: str, kind: str, seed: int, cache: Path | None = None) -> BenchSet:
    """The same set for the same arguments. cache: a folder of pickled sets, made where it is missing."""
    kept = cache / f"{engine_name}-{kind}-{seed}-v{VERSION}.pickle" if cache else None
    if kept and kept.exists():
        return pickle.loads(kept.read_bytes())  # type: ignore[no-any-return]
    found = _drawn(engine(engine_name), kind, seed)
    if kept:
        kept.parent.mkdir(parents=True, exist_ok=True)
        part = kept.with_suffix(".part")
        part.write_bytes(pickle.dumps(found))
        part.replace(kept)
    return found


def _drawn(used: Engine, kind: str, seed: int) -> BenchSet:
    rng = np.random.default_rng([list(MODULES).index(used.name), list(KINDS).index(kind), seed])
    rover = drawn_rover(rng, used.sizes[int(rng.integers(len(used.sizes)))])
    plan = drives(rng, rover)
    concealed, hidden = hidden_in(used, kind, rover, plan, rng)
    vehicle = parse(vehicle_toml(rover.told))
    recordings = [
        with_delta(logged(rover.instruments, drive, *driven(used, concealed, drive, rng), "rover"), vehicle)
        for drive in plan
    ]
    runs = rs.Runs(tuple(recordings[:3]), vehicle)
    truth = {"engine": used.name, "kind": kind, "seed": seed, "size": rover.size, "hidden": hidden}
    effects = tuple(one["effect"] for one in hidden)
    return BenchSet(used.name, kind, seed, runs, tuple(recordings[3:]), effects, truth)


def hidden_in(
    used: Engine, kind: str, rover: EngineRover, plan: tuple[Drive, ...], rng: Generator
) -> tuple[EngineRover, list[dict[str, Any]]]:
    """(rover with the effects, what is hidden)."""
    sizing, found, places = Sizing(used, rover, plan, rng), rover, set()
    hidden: list[dict[str, Any]] = []
    for _ in range(TRIALS):
        if len(hidden) == KINDS[kind]:
            break
        law = _some_law(used, kind, places, rng)
        extras = law.extras(rng)
        sized = sizing.sized(law, extras, rng)
        if sized is None:
            continue
        size, visibility = sized
        both = law.apply(found, size, extras)
        if hidden and not sizing.in_control(law, both):  # type: ignore[arg-type]
            continue
        found = both  # type: ignore[assignment]
        places.add(law.place)
        hidden.append(
            {
                "effect": law.effect,
                "form": law.form,
                "value": float(f"{law.value(rover, size):.4g}"),
                "unit": law.unit,
                "visibility": round(visibility, 2),
                "extras": dict(extras),
            }
        )
    return found, hidden


def _some_law(used: Engine, kind: str, places: set[str], rng: Generator) -> Law:
    """Each effect is as likely as every other, whatever the number of its forms."""
    laws = used.outside if kind == "outside" else used.listed
    free = [law for law in laws if law.place not in places]
    effects = sorted({law.effect for law in free})
    effect = effects[int(rng.integers(len(effects)))]
    forms = [law for law in free if law.effect == effect]
    return forms[int(rng.integers(len(forms)))]
