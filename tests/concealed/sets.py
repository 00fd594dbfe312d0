"""A set of concealed data: four runs and a vehicle file in one folder, the truth in another."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tests.concealed.drive import Drive, draw_plan, steer
from tests.concealed.effects import UNKNOWN, Effect, Hidden, Sizes, draw_effect, ids, part
from tests.concealed.flash import log_bytes
from tests.concealed.messages import messages
from tests.concealed.rover import Nuisance, Rng, Rover, draw_nuisance, draw_rover, vehicle_file
from tests.concealed.run import Roughness, change_instant, draw_roughness, move
from tests.concealed.sensors import measure

Kind = Literal["none", "single", "double", "unknown"]
RUNS = ("run1.BIN", "run2.BIN", "run3.BIN", "run4.BIN")
BASELINE_QUESTIONS = (
    "tyre_slip",
    "roll_dof",
)  # always in the rover; concealed by asking for a smaller baseline


@dataclass(frozen=True)
class Case:
    """Everything about one set, drawn from its seed."""

    seed: tuple[int, int]
    kind: Kind
    rover: Rover
    off: Nuisance
    plan: tuple[Drive, ...]
    rough: Roughness
    filters: tuple[float, float]
    hidden: Hidden
    baseline: str


def draw_case(
    seed: int,
    number: int,
    kind: Kind,
    factor: float = 2.0,
    effect: str | None = None,
    sizes: Sizes | None = None,
) -> Case:
    """Set `number` of a seed. The rover, its plan and its noise do not depend on what is concealed.

    sizes: detectable sizes of this plan; an effect that has none there is not drawn.
    """
    rover_rng, plan_rng, effect_rng = (stream(seed, number, k) for k in range(3))
    rover, off, rough = draw_rover(rover_rng), draw_nuisance(rover_rng), draw_roughness(rover_rng)
    plan = draw_plan(plan_rng, rover)
    filters = [(20.0, 20.0), (20.0, 20.0), (20.0, 20.0), (20.0, 10.0), (10.0, 20.0)][
        int(plan_rng.integers(5))
    ]
    names = _names(kind, effect, effect_rng, tuple(sizes) if sizes else ids())
    effects = (draw_effect(name, factor, rover, effect_rng, sizes) for name in names)
    drawn = tuple(_settled(one, rover, plan) for one in effects)
    return Case((seed, number), kind, rover, off, plan, rough, filters, drawn, _baseline(names))


def stream(seed: int, number: int, which: int) -> Rng:
    """The random numbers number `which` of a set; streams do not touch one another."""
    return np.random.default_rng([seed, number, which])


def _names(kind: Kind, effect: str | None, rng: Rng, known: tuple[str, ...]) -> tuple[str, ...]:
    if kind == "none":
        return ()
    if kind == "unknown":
        return (effect or str(rng.choice(UNKNOWN)),)
    first = effect or str(rng.choice(known))
    if kind == "single":
        return ("tyre_slip", "roll_dof") if first == "tyre_slip" else (first,)
    others = [name for name in known if name != first and name not in BASELINE_QUESTIONS]
    if first in BASELINE_QUESTIONS:
        first = str(rng.choice(others))
        others.remove(first)
    return first, str(rng.choice([name for name in others if not _same_place(first, name)]))


def _same_place(one: str, other: str) -> bool:
    """Pairs that no plan could tell from one effect: two of the same look-alike family."""
    families = [
        {"servo_lag", "transport_delay", "clock_offset"},
        {"steering_deadband", "steering_backlash"},
        {"tyre_saturation", "load_transfer"},
        {"velocity_lag", "clock_offset"},
    ]
    return any({one, other} <= family for family in families)


def _baseline(names: tuple[str, ...]) -> str:
    if "tyre_slip" in names:
        return "kinematic"
    return "bicycle" if "roll_dof" in names else "roll-yaw"


def _settled(effect: Effect, rover: Rover, plan: tuple[Drive, ...]) -> Effect:
    """A surface change with its instant on the log's clock [s]; a stiffness ratio that keeps stable."""
    if effect.id == "surface_change":
        run = next(drive for drive in plan if drive.name == effect.run)
        t = run.boot + change_instant(run, effect.detail["fraction"])
        return replace(effect, parameters={**effect.parameters, "t": t})
    if effect.id == "front_rear_stiffness":
        ratio = effect.parameters["ratio"]
        uneven = replace(rover, cf=rover.cr * ratio)
        if uneven.critical_speed() < 1.5 * max(drive.speed for drive in plan):
            return replace(effect, parameters={"ratio": 1 / ratio})
    return effect


def run_bytes(case: Case, drive: Drive) -> bytes:
    """The .BIN of one run."""
    rng = stream(*case.seed, 10 + drive.number)
    steering = steer(drive, rng)
    motion = move(case.rover, case.off, drive, steering, case.hidden, case.rough, rng)
    seen = measure(motion, case.rover, case.off, case.hidden, case.rough, case.filters, rng)
    late, velocity = (
        part(case.hidden, "clock_offset", "T", 0.0),
        part(case.hidden, "clock_offset", "velocity", 0.0),
    )
    stamped = {"steering": late * (1 - velocity), "velocity": late * velocity}
    return log_bytes(messages(drive, steering, seen, case.filters, stamped, rng))


def write_set(case: Case, folder: Path, truth: Path) -> None:
    """Runs, vehicle file and task into `folder`; the truth into `truth`, which must lie elsewhere."""
    if folder in truth.parents:
        raise ValueError(f"the truth may not lie beside the runs: {truth}")
    folder.mkdir(parents=True, exist_ok=True)
    truth.parent.mkdir(parents=True, exist_ok=True)
    for drive in case.plan:
        (folder / f"{drive.name}.BIN").write_bytes(run_bytes(case, drive))
    offset = part(case.hidden, "imu_offset", "x", 0.0), part(case.hidden, "imu_offset", "z", 0.0)
    (folder / "rover.toml").write_text(vehicle_file(case.rover, case.off, offset), encoding="utf-8")
    task = {"runs": list(RUNS[:3]), "hold_out": [RUNS[3]], "baseline": case.baseline}
    (folder / "task.json").write_text(json.dumps(task) + "\n", encoding="utf-8")
    truth.write_text(json.dumps(truth_of(case), indent=1) + "\n", encoding="utf-8")


def truth_of(case: Case) -> dict[str, Any]:
    """What was concealed, and the rover with its mismatches."""
    effects = [
        {"effect": one.id, "parameters": dict(one.parameters), "detail": dict(one.detail), "run": one.run}
        for one in case.hidden
    ]
    return {
        "seed": list(case.seed),
        "kind": case.kind,
        "effects": effects,
        "baseline": case.baseline,
        "rover": vars(case.rover),
        "nuisance": vars(case.off),
        "filters": list(case.filters),
    }


def kinds(count: int, seed: int, kind: Kind | Literal["all"], effect: str | None = None) -> list[Kind]:
    """The kind of each set; "all" hides nothing in about 30 % of them."""
    if kind != "all":
        return [kind] * count
    if effect:
        return ["unknown" if effect in UNKNOWN else "single"] * count
    rng = stream(seed, 0, 99)
    names: list[Kind] = ["none", "single", "double", "unknown"]
    return [names[k] for k in rng.choice(4, count, p=[0.3, 0.45, 0.15, 0.1])]
