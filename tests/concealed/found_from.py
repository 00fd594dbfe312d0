"""Whether `plan` is true: how often an effect is found at its detectable size, and at 1.5 times that size.

`python -m tests.concealed.found_from --rovers 6 --seed 4401`.

For each drawn rover the plan is asked with what its owner knows: the vehicle file, the amplitudes and speeds
of run1 to run3. The effect is then concealed at that size, the runs are driven, and the first round of the
diagnosis is asked whether the effect is a finding. About 40 to 60 % should be found at the size itself and at
least 80 % at 1.5 times the size. Sizes that the normal tolerance determines are found less often.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from pathlib import Path

from rover_sweep.api.read import Runs, read
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.plans.plan_result import PlannedRun
from rover_sweep.diagnosis.plans.sets import Planner
from rover_sweep.diagnosis.search.rounds import Options, Round, round_of
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment
from tests.concealed.effects import part
from tests.concealed.rover import vehicle_file
from tests.concealed.sets import Case, draw_case, run_bytes

EFFECTS = {
    "front_rear_stiffness": "ratio",
    "steering_nonlinearity": "c3",
    "roll_steer": "e",
    "suspension_friction": "T",
    "cross_slope": "b",
    "imu_offset": "x",
}
FACTORS = (1.0, 1.5)


def driven(case: Case, folder: Path) -> Runs:
    """run1 to run3 of a case, read with the owner's vehicle file."""
    folder.mkdir()
    for drive in case.plan[:3]:
        (folder / f"{drive.name}.BIN").write_bytes(run_bytes(case, drive))
    offset = part(case.hidden, "imu_offset", "x", 0.0), part(case.hidden, "imu_offset", "z", 0.0)
    (folder / "rover.toml").write_text(vehicle_file(case.rover, case.off, offset), encoding="utf-8")
    return read(*(folder / f"run{k}.BIN" for k in (1, 2, 3)), vehicle=folder / "rover.toml")


def planned_sizes(case: Case, runs: Runs, effects: tuple[str, ...]) -> dict[str, float]:
    """{effect: detectable size} by the plan of the runs as they were intended, not as they were recorded."""
    intended = [PlannedRun("sweep", d.amplitude_us, round(d.speed, 2)) for d in case.plan[:3]]
    _, rad_per_us = runs.vehicle.steering()
    rover = geometry_of(runs.vehicle)
    planner = Planner(rover, abs(rad_per_us), effects, Tolerances(), {}, lambda what, share: None)
    return {e: found.size for e, found in planner.sizes(intended).items() if found.size is not None}


def first_round(runs: Runs) -> Round:
    """The first round of a diagnosis, with all effects as candidates."""
    options = Options((), (), 1, lambda what, share: None, lambda: False)
    model = Model("roll-yaw", geometry_of(runs.vehicle), Tolerances())
    return round_of([experiment(run) for run in runs], model, {}, options)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed.found_from")
    parser.add_argument("--rovers", type=int, default=6)
    parser.add_argument("--seed", type=int, default=4401)
    parser.add_argument("--effects", nargs="+", default=list(EFFECTS), choices=list(EFFECTS))
    args = parser.parse_args()
    count: dict[tuple[str, float], list[bool]] = defaultdict(list)
    for number in range(1, args.rovers + 1):
        with tempfile.TemporaryDirectory() as place:
            folder, none = Path(place), draw_case(args.seed, number, "none")
            sizes = planned_sizes(none, driven(none, folder / "none"), tuple(args.effects))
            for effect, size in sizes.items():
                for factor in FACTORS:
                    case = draw_case(
                        args.seed, number, "single", factor, effect, {effect: {EFFECTS[effect]: size}}
                    )
                    found = first_round(driven(case, folder / f"{effect} {factor}")).significant()
                    count[effect, factor].append(effect in {t.effect for t in found})
                    print(
                        f"{number} {effect} {case.hidden[0].parameters} {count[effect, factor][-1]}",
                        flush=True,
                    )
    for factor in FACTORS:
        for effect in args.effects:
            print(f"{factor} {effect:<24}{sum(count[effect, factor])} of {len(count[effect, factor])}")


if __name__ == "__main__":
    main()
