"""`python -m tests.benchmarks.any_driving`: a simulated rover's true numbers against those of any driving.

Ten minutes of drawn hand driving and of a drawn AUTO mission for each seed, with the noise of the seed,
through `rs.identify_driving` with the rover's vehicle file: errors of the curvature, the response time and
the tyres, and whether the interval of K_us holds the truth. The rovers: the nominal one, and drawn ones with
other tyres, inertia, springs and servo, of which every second one has 0.7 of the front or of the rear
cornering stiffness.

--keep: folder for the logs; those that are there are read again.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import rover_sweep as rs
from sitl.plant.variant import PlantParameters, load_variant
from tests.benchmarks.interval_coverage import exact_file
from tests.comparison.pairs import varied
from tests.driving.any_drives import hand_driving, mission, recorded, true_steering

KINDS = {"by hand": hand_driving, "mission": mission}
WEAKER = 0.7


@dataclass(frozen=True)
class Checked:
    """One drive: error of the curvature [share] and of the response time [s], both None where unknown.

    The curvature is that at low speed, or that at the speed of the drive where K_us is unknown.

    understeer: K_us (true, low, high) [deg/g]. tyres: larger error of Cf and Cr [share]. None where unknown.
    seconds: that were used.
    """

    title: str
    level: str
    curvature: float | None
    late: float | None
    understeer: tuple[float, float, float] | None
    tyres: float | None
    seconds: float

    def __str__(self) -> str:
        words = [f"{self.title:24} {self.level:5} {self.seconds:4.0f} s"]
        if self.curvature is not None:
            words.append(f"curvature {100 * self.curvature:+.2f} %")
        if self.late is not None:
            words.append(f"response time {1000 * self.late:+.1f} ms")
        if self.understeer:
            true, low, high = self.understeer
            inside = "inside" if low <= true <= high else "OUTSIDE"
            words.append(f"K_us {true:.2f} {inside} {low:.2f} to {high:.2f} deg/g")
        if self.tyres is not None:
            words.append(f"tyres within {100 * self.tyres:.0f} %")
        return ", ".join(words)


def rover_named(name: str) -> PlantParameters:
    """`nominal`, or the rover that a number draws."""
    if name == "nominal":
        return load_variant("nominal")
    rover = varied(load_variant("nominal"), np.random.default_rng([int(name), 7]))
    if int(name) % 2:
        return rover
    axle = ("front_cornering_stiffness", "rear_cornering_stiffness")[int(name) // 2 % 2]
    return replace(rover, **{axle: WEAKER * getattr(rover, axle)})


def drives(names: list[str], seeds: range, seconds: float, folder: Path) -> Iterator[Checked]:
    """Each rover, kind and seed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        rover = rover_named(name)
        for kind, drawn in KINDS.items():
            for seed in seeds:
                path = folder / f"{name}-{kind.replace(' ', '-')}-{seed}-{seconds:.0f}.BIN"
                if not path.exists():
                    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
                    recorded(*drawn(seconds, rng), rover, path, seed)
                yield checked(f"{name} {kind} {seed}", rover, path)


def checked(title: str, rover: PlantParameters, path: Path) -> Checked:
    """What the log of the drive says, against the rover."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rover.toml"
        file.write_text(exact_file(rover), encoding="utf-8")
        answer = rs.identify_driving(path, vehicle=file)
    found, true = dict(answer.numbers.items()), true_steering(rover, answer.speeds[1] or 1.0)
    gain, late, k = (found.get(name) for name in ("curvature", "response_time", "understeer_gradient"))
    curvature = true.curvature if k else true.at_speed
    axles = [
        abs(found[f"{axle}_stiffness"].value / getattr(rover, f"{axle}_cornering_stiffness") - 1)
        for axle in ("front", "rear")
        if f"{axle}_stiffness" in found
    ]
    return Checked(
        title,
        answer.level,
        gain.value / curvature - 1 if gain else None,
        late.value - true.response_time if late else None,
        (true.understeer_gradient, *k.interval_90) if k and k.interval_90 else None,
        max(axles, default=None),
        answer.driving.seconds,
    )


def main() -> None:
    """Prints a line for each drive, and the largest errors of all."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.any_driving", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rovers", nargs="+", default=["nominal"], help="nominal, or numbers")
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        rows = []
        for row in drives(asked.rovers, range(asked.seeds), asked.seconds, asked.keep or Path(scratch)):
            rows.append(row)
            print(row, flush=True)
    gains = [abs(r.curvature) for r in rows if r.curvature is not None]
    late = [abs(r.late) for r in rows if r.late is not None]
    k = [low <= true <= high for true, low, high in (r.understeer for r in rows if r.understeer)]
    print(f"curvature: {len(gains)} of {len(rows)}, within {100 * max(gains, default=0):.1f} %")
    print(f"response time: {len(late)} of {len(rows)}, within {1000 * max(late, default=0):.0f} ms")
    tyres = [r.tyres for r in rows if r.tyres is not None]
    print(f"tyres: {len(tyres)} of {len(rows)}, within {100 * max(tyres, default=0):.0f} %")
    print(f"K_us: the interval holds the truth in {sum(k)} of {len(k)}")


if __name__ == "__main__":
    main()
