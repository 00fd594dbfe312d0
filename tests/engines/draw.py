"""Draws a set: a rover of an engine, its four runs, and what is concealed in it."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import exp, isfinite, log
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, sosfiltfilt

import rover_sweep as rs
from rover_sweep.api.read import with_delta
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import parse
from tests.engines.engine import MODULES, Array, Engine, EngineRover, drawn_rover, driven, engine
from tests.foreign.laws import Extras, Law
from tests.foreign.plant import DT
from tests.foreign.recorded import Drive, drives, logged
from tests.foreign.rover import vehicle_toml

CHANNELS = ("r", "ay", "p", "vy")
EVERY = 20  # steps between two samples
BAND_HZ = 6.0
LEAST, LOW, HIGH = 0.35, 0.4, 2.5  # visibility: at least, and the range from which it is drawn
WILD = 1.8  # of the nominal peak of a_y: no such rover is driven
NOT_FIRST = 2  # the large sweep


@dataclass(frozen=True)
class Scale:
    """Nominal runs (channels, samples) over the noise, rms noise (channels,), and what parameters change."""

    plan: tuple[Drive, ...]
    nominal: Array
    noise: Array
    imitations: tuple[Array, ...]

    def visibility(self, changed: Array, law: Law) -> float:
        """Of the runs of a rover with the law; inf if it is out of control."""
        limit = WILD * np.max(np.abs(self.nominal), axis=1)
        if not np.all(np.isfinite(changed)) or np.any(np.max(np.abs(changed), axis=1)[:3] > limit[:3] + 6.0):
            return float("inf")
        rows = slice(3, 4) if law.place == "ekf" else slice(0, 3)
        difference = (changed - self.nominal)[rows]
        if not law.absolute:
            difference = _unimitated(difference, [one[rows] for one in self.imitations])
        return float(np.max(np.sqrt(np.mean(difference**2, axis=1))))


@dataclass
class Sizing:
    """Scales of the runs of one rover; each is simulated when it is first asked for."""

    engine: Engine
    rover: EngineRover
    plan: tuple[Drive, ...]
    rng: Generator
    _scales: dict[int, Scale] = field(default_factory=dict)

    def scale(self, run: int) -> Scale:
        """The nominal sweep of a run (1, 2, 3), its noise and what parameters change in it."""
        if run not in self._scales:
            self._scales[run] = self._measured(self.plan[run - 1])
        return self._scales[run]

    def _measured(self, drive: Drive) -> Scale:
        plain = self._run(self.rover, drive)
        noisy = self._run(self.rover, drive, self.rng)
        noise = np.std(noisy - plain, axis=1)
        n = self.rover.numbers
        others = (
            self.rover.of(Cf=1.05 * n.Cf, Cr=1.05 * n.Cr),
            self.rover.of(Izz=1.05 * n.Izz),
            self.rover.of(kphi=1.05 * n.kphi),
            self.rover.of(bphi=1.1 * n.bphi),
            self.rover.of(h=1.1 * n.h),
            self.rover.of(Ixx=1.1 * n.Ixx),
            replace(self.rover, rad_per_us=1.02 * self.rover.rad_per_us),
        )
        changes = [self._run(one, drive) - plain for one in others]
        changes.append(np.gradient(plain, EVERY * DT, axis=1) * 0.004)  # of a delay
        scaled = tuple(one / noise[:, None] for one in changes)
        return Scale((drive,), plain / noise[:, None], noise, scaled)

    def _run(self, rover: EngineRover, drive: Drive, rng: Generator | None = None) -> Array:
        found = driven(self.engine, rover, drive, rng or np.random.default_rng(0), rng is not None)[2]
        inside = slice(round(drive.begin / DT), round(drive.end / DT), EVERY)
        rows = np.array([found[name][inside] for name in CHANNELS])
        if not np.all(np.isfinite(rows)):
            return np.full(rows.shape, np.nan)
        return np.asarray(sosfiltfilt(butter(4, BAND_HZ * 2 * DT * EVERY, output="sos"), rows, axis=1))

    def visibility(self, law: Law, size: float, extras: Extras) -> float:
        """Of the effect at this size; inf where the rover is out of control."""
        scale = self.scale(int(extras.get("run", NOT_FIRST)))
        changed = law.apply(self.rover, size, extras)
        return scale.visibility(self._run(changed, scale.plan[0]) / scale.noise[:, None], law)

    def in_control(self, law: Law, concealed: EngineRover) -> bool:
        """Whether a rover with several effects, the last of them `law`, still drives its large sweep."""
        scale = self.scale(NOT_FIRST)
        return isfinite(scale.visibility(self._run(concealed, scale.plan[0]) / scale.noise[:, None], law))

    def sized(self, law: Law, extras: Extras, rng: Generator) -> tuple[float, float] | None:
        """(size, visibility) that shows plainly; None if no size does."""

        def seen(size: float) -> float:
            return self.visibility(law, size, extras)

        return chosen(seen, law, rng, searches=5, near=0.3)  # an engine takes seconds


def _unimitated(difference: Array, imitations: Sequence[Array]) -> Array:
    """The difference (channels, samples) without its best fit by parameters and a constant a channel."""
    rows, samples = difference.shape
    constants = [np.kron(np.eye(rows)[k], np.ones(samples)) for k in range(rows)]
    basis = np.column_stack([*(one.ravel() for one in imitations), *constants])
    basis = basis / np.maximum(np.linalg.norm(basis, axis=0), 1e-12)
    weights = np.linalg.lstsq(basis, difference.ravel(), rcond=None)[0]
    return np.asarray(difference.ravel() - basis @ weights).reshape(rows, samples)


def chosen(
    seen: Callable[[float], float], law: Law, rng: Generator, searches: int, near: float
) -> tuple[float, float] | None:
    """(size, visibility) of a drawn visibility, None if even the largest size does not show.

    seen: the visibility of a size. By false position on logarithms, from the largest size down, at most
    `searches` times and until it is within `near` (logarithm).
    """
    if law.absolute:
        size = exp(rng.uniform(log(law.low), log(law.high)))
        visibility = seen(size)
        return (size, visibility) if isfinite(visibility) and visibility >= LEAST else None
    wanted = exp(rng.uniform(log(LOW), log(HIGH)))
    high = (law.high, seen(law.high))
    if high[1] < LEAST:
        return None
    if high[1] <= wanted:
        return high
    low = (law.low, seen(law.low))
    if low[1] >= wanted or not isfinite(low[1]):
        return low if isfinite(low[1]) else None
    for _ in range(searches):
        known = isfinite(high[1]) and low[1] > 0
        share = log(wanted / low[1]) / log(high[1] / low[1]) if known else 0.5
        middle = exp(log(low[0]) + min(0.85, max(0.15, share)) * log(high[0] / low[0]))
        found = (middle, seen(middle))
        if abs(log(max(found[1], 1e-9) / wanted)) < near:
            return found
        low, high = (found, high) if found[1] < wanted else (low, found)
    return low if low[1] >= LEAST else high if isfinite(high[1]) else None


# how many effects; foreign_form: of a form that the list does not have
KINDS = {"none": 0, "single": 1, "double": 2, "outside": 1, "triple": 3, "foreign_form": 1}
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
    runs, held_out = driven_runs(used, concealed, plan, rng)
    truth = {"engine": used.name, "kind": kind, "seed": seed, "size": rover.size, "hidden": hidden}
    effects = tuple(one["effect"] for one in hidden)
    return BenchSet(used.name, kind, seed, runs, held_out, effects, truth)


def driven_runs(
    used: Engine, rover: EngineRover, plan: tuple[Drive, ...], rng: Generator, side: str = ""
) -> tuple[rs.Runs, tuple[Recording, ...]]:
    """(three sweeps, what is held out) with the vehicle file of the owner. side: begins their names."""
    vehicle = parse(vehicle_toml(rover.told))
    found = []
    for drive in plan:
        run = logged(rover.instruments, drive, *driven(used, rover, drive, rng), side or "rover")
        found.append(with_delta(replace(run, name=f"{side}{run.name}"), vehicle))
    return rs.Runs(tuple(found[:3]), vehicle), tuple(found[3:])


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
    free = [law for law in laws if law.place not in places and not (kind == "foreign_form" and law.own)]
    effects = sorted({law.effect for law in free})
    effect = effects[int(rng.integers(len(effects)))]
    forms = [law for law in free if law.effect == effect]
    return forms[int(rng.integers(len(forms)))]
