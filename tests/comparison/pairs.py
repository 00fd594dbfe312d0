"""`python -m tests.comparison.pairs`: draws pairs of recordings and simulation, and grades the comparison.

Both sides are the simulated rover of `sitl` (its laws share no code with the identification), driven with the
steering and speed of committed recordings. The recordings' rover is another one in every pair; its vehicle
file has errors like those of scales, a ruler and a swing. The simulation has other numbers, lacks an effect,
both, or is the same rover with other noise.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.api.diagnose import FullDiagnosis, compare, compared
from rover_sweep.api.read import Runs
from rover_sweep.comparison.answer import Agreement, Comparison
from rover_sweep.redrive.recorded_course import course_of
from rover_sweep.twin.correct import corrected
from rover_sweep.twin.loop import laws_of
from sitl.plant.variant import PlantParameters, load_variant
from sitl.redrive.open_loop import redrive

RECORDED = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c"
RUNS = ("run1", "run2", "run4")
VARIED = (
    "front_cornering_stiffness",
    "rear_cornering_stiffness",
    "yaw_inertia",
    "roll_stiffness",
    "roll_damping",
    "servo_lag",
    "friction",
)
KINDS = ("number", "effect", "both", "agree")

# what a number of the simulation is multiplied by, or what is added, and how the tool names it
FACTORS: Mapping[str, tuple[float, tuple[str, ...]]] = {
    "yaw_inertia": (0.20, ("Izz",)),
    "rad_per_us": (0.10, ("rad_per_us",)),
    "front_cornering_stiffness": (0.25, ("Cf",)),
    "rear_cornering_stiffness": (0.25, ("Cr",)),
    "roll_stiffness": (0.25, ("k_phi",)),
    "roll_damping": (0.40, ("b_phi",)),
}
SHIFTS: Mapping[str, tuple[float, tuple[str, ...]]] = {
    "servo_lag": (0.03, ("servo_lag",)),
    "servo_delay": (0.025, ("servo_delay",)),
    "velocity_lag": (0.05, ("velocity_lag",)),
    "imu_forward": (0.05, ("imu_x",)),
    "cg_forward": (0.02, ("cg_to_front_axle",)),
}
EFFECTS: Mapping[str, Mapping[str, float]] = {
    "servo_rate_limit": {"R": 1.3},
    "steering_backlash": {"b": 0.012},
    "steering_nonlinearity": {"c3": -1.8},
    "steering_asymmetry": {"e": 0.06},
    "tyre_relaxation": {"sigma": 0.2},
    "tyre_saturation": {"mu": 0.5},
    "suspension_friction": {"T": 0.12},
    "sensor_filter": {"gyro_hz": 6.0},
    "steering_stiction": {"s": 0.012},
    "yaw_damping": {"c": 0.5},
}
ALWAYS = {"tyre_saturation"}  # every simulated rover has it, in another size


@dataclass(frozen=True)
class Drawn:
    """A pair: the recordings' rover, the simulation's, and the names that the tool should say."""

    kind: str
    recorded: PlantParameters
    simulated: PlantParameters
    truth: tuple[tuple[str, ...], ...]
    words: Mapping[str, Any] = field(default_factory=dict)


def drawn(kind: str, seed: int) -> Drawn:
    """One pair of a kind. The same seed gives the same pair."""
    random = np.random.default_rng([seed, KINDS.index(kind)])
    recorded = varied(load_variant("nominal"), random)
    simulated = recorded
    truth: list[tuple[str, ...]] = []
    words: dict[str, Any] = {}
    if kind in ("effect", "both"):
        name = str(random.choice(list(EFFECTS)))
        size = {p: v * random.uniform(0.85, 1.2) for p, v in EFFECTS[name].items()}
        recorded = replace(recorded, effects={name: size})
        truth.append((name,))
        words[name] = size
    if kind in ("number", "both"):
        for name in random.choice(
            [*FACTORS, *SHIFTS], 2 if kind == "number" and seed % 2 else 1, replace=False
        ):
            simulated, change = _changed(simulated, str(name), random)
            truth.append((FACTORS.get(str(name)) or SHIFTS[str(name)])[1])
            words[str(name)] = change
    return Drawn(kind, recorded, simulated, tuple(truth), words)


def varied(rover: PlantParameters, random: np.random.Generator) -> PlantParameters:
    """The rover with other tyres, springs, inertia and servo, each by a factor of .9 to 1.15."""
    return replace(rover, **{name: getattr(rover, name) * random.uniform(0.9, 1.15) for name in VARIED})


def _changed(rover: PlantParameters, name: str, random: np.random.Generator) -> tuple[PlantParameters, float]:
    sign = float(random.choice([-1.0, 1.0]))
    if name in FACTORS:
        factor = 1.0 + sign * FACTORS[name][0] * random.uniform(0.9, 1.2)
        return replace(rover, **{name: getattr(rover, name) * factor}), factor
    shift = SHIFTS[name][0] * random.uniform(0.9, 1.2)
    if name == "imu_forward":
        x, y, z = rover.imu_position
        return replace(rover, imu_position=(x + sign * shift, y, z)), sign * shift
    if name == "cg_forward":
        front, rear = rover.cg_to_front_axle - sign * shift, rover.cg_to_rear_axle + sign * shift
        return replace(rover, cg_to_front_axle=front, cg_to_rear_axle=rear), sign * shift
    return replace(rover, **{name: getattr(rover, name) + shift}), shift


def drive(rover: PlantParameters, course_from: Sequence[Path], folder: Path, seed: int) -> list[Path]:
    """Recordings of the rover with the steering and speed of others."""
    from rover_sweep.logs.read import read_logs
    from rover_sweep.logs.readers.csv_table import screened

    folder.mkdir(parents=True)
    out = []
    for k, source in enumerate(course_from):
        course = course_of(screened(read_logs(str(source))[0]))
        target = folder / f"{folder.name}-{source.stem}.BIN"
        redrive(course, rover, target, seed + k)
        out.append(target)
    return out


def vehicle_file(rover: PlantParameters, random: np.random.Generator) -> str:
    """The rover as its owner measured it."""

    def measured(name: str, value: float, error: float) -> str:
        return f"{name} = {{ value = {value + error * random.standard_normal():.5g}, sd = {error:.3g} }}"

    lines = ["[vehicle]", 'name = "drawn"']
    lines.append(measured("mass", rover.mass, 0.01))
    lines.append(measured("sprung_mass", rover.sprung_mass, 0.02))
    lines.append(measured("cg_to_front_axle", rover.cg_to_front_axle, 0.002))
    lines.append(measured("cg_to_rear_axle", rover.cg_to_rear_axle, 0.002))
    lines.append(measured("cg_height_above_roll_centre", rover.cg_height_above_roll_centre, 0.002))
    lines.append(measured("roll_inertia", rover.roll_inertia, 0.0008))
    lines.append(measured("yaw_inertia", rover.yaw_inertia, 0.003))
    lines += ["[steering]", f"trim_us = {rover.steering_trim_us}"]
    lines.append(measured("rad_per_us", rover.rad_per_us, 0.01 * rover.rad_per_us))
    lines += ["[imu]", f"position = {list(rover.imu_position)}"]
    return "\n".join(lines)


def answered(pair: Drawn, folder: Path, seed: int) -> dict[str, Any]:
    """Drive the pair, compare it, and return answer and truth."""
    import rover_sweep as rs

    originals = [RECORDED / f"{run}.BIN" for run in RUNS]
    recorded = drive(pair.recorded, originals, folder / "recorded", 100 + seed)
    simulated = drive(pair.simulated, recorded, folder / "simulated", 700 + seed)
    vehicle = folder / "rover.toml"
    vehicle.write_text(vehicle_file(pair.recorded, np.random.default_rng(seed)), encoding="utf-8")
    started = time.monotonic()
    runs = rs.read(*map(str, recorded[:2]), vehicle=vehicle)
    held, sims = rs.read(str(recorded[2]), vehicle=vehicle), rs.read(*map(str, simulated), vehicle=vehicle)
    found = rs.diagnose(runs, held_out=held)
    answer = compare(runs, sims, held_out=held, diagnosis=found)
    again = _driven_again(pair.simulated, answer, found, (runs, held), recorded, folder, seed)
    return {
        "kind": pair.kind,
        "seed": seed,
        "truth": pair.truth,
        "sizes": pair.words,
        "verdict": answer.verdict,
        "diagnosis": found.sentence,
        "said": [[d.kind, d.name, *d.look_alikes] for d in answer.differences],
        "minor": [d.name for d in answer.minor],
        "gains": [round(d.gain, 1) for d in (*answer.differences, *answer.minor)],
        "sentences": [d.sentence for d in answer.differences],
        "agreement": [round(a.overall, 3) for a in answer.agreement],
        "corrected": [round(a.overall, 3) for a in again],
        "right": right(pair, answer.verdict, [(d.name, d.kind) for d in answer.differences]),
        "seconds": round(time.monotonic() - started, 1),
    }


def _driven_again(
    rover: PlantParameters,
    answer: Comparison,
    found: FullDiagnosis,
    runs: tuple[Runs, Runs],
    recorded: Sequence[Path],
    folder: Path,
    seed: int,
) -> tuple[Agreement, ...]:
    """The runs after one correction, driven again; the held-out run last."""
    import rover_sweep as rs

    assert found.model is not None
    by = corrected(rover, answer, found.model)
    simulated = drive(by.parameters, recorded, folder / "corrected", 1300 + seed)
    sims = rs.read(*map(str, simulated), vehicle=folder / "rover.toml")
    laws = laws_of(by.parameters, found.model)
    return compared(runs[0], runs[1], sims, found, laws, fitted={}).answer.agreement


def right(pair: Drawn, verdict: str, said: Sequence[tuple[str, str]]) -> bool:
    """Every difference that there is was named with the right kind, and nothing else."""
    names = {name for name, _ in said}
    wanted = [set(alternatives) for alternatives in pair.truth]
    every = all(names & alternatives for alternatives in wanted)
    nothing_else = names <= set().union(*wanted) if wanted else not names
    kinds = all(
        kind in ("left out", "instrument") or name in ALWAYS for name, kind in said if name in EFFECTS
    )
    return every and nothing_else and kinds and (verdict == "agree") == (not wanted)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.comparison.pairs", description=__doc__)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--sets", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="file to append one JSON line per pair to")
    args = parser.parse_args()
    results = []
    for kind in [args.kind] if args.kind else KINDS:
        for seed in range(args.seed, args.seed + args.sets):
            with tempfile.TemporaryDirectory() as folder:
                result = answered(drawn(kind, seed), Path(folder), seed)
            results.append(result)
            if args.out:
                with args.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(result) + "\n")
            print(json.dumps(result, indent=None)[:400], flush=True)
    for kind in KINDS:
        some = [r for r in results if r["kind"] == kind]
        if some:
            print(f"{kind}: {sum(r['right'] for r in some)} of {len(some)} right")


if __name__ == "__main__":
    main()
