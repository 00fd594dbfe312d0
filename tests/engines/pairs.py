"""`python -m tests.engines.pairs`: a rover of an engine against a simulation in the same engine, compared.

The recordings are a drawn rover of the bench, its vehicle file with its owner's errors. The simulation is the
same rover in the same engine, driven with the same steering: with another number, without the rover's effect,
both, or as it is with other noise. No corrected drive follows.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

import rover_sweep as rs
from rover_sweep.api.diagnose import compare
from tests.engines.draw import driven_runs, hidden_in
from tests.engines.engine import MODULES, EngineRover, drawn_rover, engine
from tests.foreign.recorded import drives

KINDS = ("number", "effect", "both", "agree")
# {number of the rover: (relative change, how the tool names it)}
CHANGED = {
    "Izz": (0.20, ("Izz",)),
    "rad_per_us": (0.10, ("rad_per_us",)),
    "Cf": (0.25, ("Cf",)),
    "Cr": (0.25, ("Cr",)),
    "kphi": (0.25, ("k_phi",)),
    "bphi": (0.40, ("b_phi",)),
}
ALWAYS = {"tyre_saturation"}  # every simulated rover has it, in another size
SHIFTED = {"delay": (0.025, ("servo_delay",)), "imu_x": (0.05, ("imu_x",))}  # s, m


def compared_pair(name: str, kind: str, seed: int) -> dict[str, Any]:
    """Draw a pair of an engine, compare it, and return answer and truth."""
    used = engine(name)
    rng = np.random.default_rng([list(MODULES).index(name), KINDS.index(kind), seed, 77])
    plain = drawn_rover(rng, used.sizes[int(rng.integers(len(used.sizes)))])
    plan = drives(rng, plain)
    real, hidden = hidden_in(used, "single" if kind in ("effect", "both") else "none", plain, plan, rng)
    effects = {one["effect"] for one in hidden}
    wanted: list[tuple[str, ...]] = [(effect,) for effect in effects]
    simulated, words = plain, {}
    if kind in ("number", "both"):
        simulated, words, names = _changed(plain, rng)
        wanted.append(names)
    (runs, held), (sims, held_sims) = (
        driven_runs(used, rover, plan, rng, side)
        for side, rover in (("recorded ", real), ("simulated ", simulated))
    )
    started = time.monotonic()
    found = rs.diagnose(runs, held_out=held)
    simulation = rs.Runs((*sims, *held_sims), runs.vehicle)
    answer = compare(runs, simulation, held_out=held, diagnosis=found)
    said = [(d.name, d.kind) for d in answer.differences]
    return {
        "engine": name,
        "kind": kind,
        "seed": seed,
        "truth": wanted,
        "sizes": {**words, **{one["effect"]: one["value"] for one in hidden}},
        "verdict": answer.verdict,
        "said": [[d.kind, d.name, *d.look_alikes] for d in answer.differences],
        "minor": [d.name for d in answer.minor],
        "agreement": [round(a.overall, 3) for a in answer.agreement],
        "right": _right(wanted, effects, answer.verdict, said),
        "seconds": round(time.monotonic() - started, 1),
    }


def _changed(rover: EngineRover, rng: Generator) -> tuple[EngineRover, dict[str, float], tuple[str, ...]]:
    """(the rover with another number, {number: factor or shift}, its names in the answer)."""
    name = str(rng.choice([*CHANGED, *SHIFTED]))
    sign, size = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.9, 1.2))
    if name in SHIFTED:
        shift, names = SHIFTED[name]
        if name == "delay":
            return replace(rover, delay=rover.delay + shift * size), {name: shift * size}, names
        moved = rover.sensing(imu_x=rover.instruments.imu_x + sign * shift * size)
        return moved, {name: sign * shift * size}, names  # type: ignore[return-value]
    relative, names = CHANGED[name]
    factor = 1.0 + sign * relative * size
    if name == "rad_per_us":
        return replace(rover, rad_per_us=rover.rad_per_us * factor), {name: factor}, names
    return rover.of(**{name: getattr(rover.numbers, name) * factor}), {name: factor}, names  # type: ignore


def _right(
    wanted: list[tuple[str, ...]], effects: set[str], verdict: str, said: list[tuple[str, str]]
) -> bool:
    """Every difference was named, of the right kind, and nothing else."""
    names = {name for name, _ in said}
    every = all(names & set(alternatives) for alternatives in wanted)
    nothing_else = names <= {name for alternatives in wanted for name in alternatives}
    kinds = all(
        kind in ("left out", "instrument") or name in ALWAYS for name, kind in said if name in effects
    )
    return every and nothing_else and kinds and (verdict == "agree") == (not wanted)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.engines.pairs", description=__doc__)
    parser.add_argument("--engine", choices=[*MODULES, "all"], default="all")
    parser.add_argument("--kind", choices=[*KINDS, "all"], default="all")
    parser.add_argument("--sets", type=int, default=3, help="pairs of each engine and kind (default 3)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file to append one JSON line per pair to")
    args = parser.parse_args()
    results = []
    for result in _results(args):
        results.append(result)
        if args.json:
            with args.json.open("a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
        print(json.dumps(result), flush=True)
    for kind in KINDS:
        some = [r for r in results if r["kind"] == kind]
        if some:
            print(f"{kind}: {sum(r['right'] for r in some)} of {len(some)} right")


def _results(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    names = MODULES if args.engine == "all" else (args.engine,)
    kinds = KINDS if args.kind == "all" else (args.kind,)
    wanted = [(n, k, s) for s in range(args.seed, args.seed + args.sets) for n in names for k in kinds]
    with ProcessPoolExecutor(args.jobs) as pool:
        yield from pool.map(compared_pair, *zip(*wanted, strict=True))


if __name__ == "__main__":
    main()
