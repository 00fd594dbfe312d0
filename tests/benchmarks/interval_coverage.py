"""`python -m tests.benchmarks.interval_coverage`: are a simulated rover's true numbers inside the intervals?

The rover of `sitl`, whose laws share no code with the identification, drives two recorded sweeps through its
servo, again with other noise in every repeat, and `identify` is asked for its printed 90 % intervals: of the
parameters of the recommended model, from the noise alone and as they are printed, and of the handling. The
rovers: the nominal one, and others with other tyres, inertia, springs and servo. The true stiffness is at
zero slip, the true tau the servo's lag and delay, the true handling that of the true numbers.

--measured: the vehicle file has errors like those of scales, a ruler and a swing, and no friction.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rover_sweep as rs
from rover_sweep.identification.bootstrap import Bootstrap
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.handling import Handling, handling
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.pipeline import Identification
from rover_sweep.study.virtual_study import true_parameters
from sitl.plant.variant import PlantParameters, load_variant
from tests.comparison.pairs import drive, varied, vehicle_file

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"
SWEEPS = (NOMINAL / "run1.BIN", NOMINAL / "run2.BIN")
REPLICATES = 200


@dataclass(frozen=True)
class Checked:
    """A true value and intervals (low, high). noise: of the noise alone, None for handling."""

    name: str
    true: float
    value: float
    printed: tuple[float, float]
    noise: tuple[float, float] | None = None

    @property
    def inside(self) -> bool:
        """True where the printed interval holds the truth."""
        return self.printed[0] <= self.true <= self.printed[1]

    @property
    def inside_noise(self) -> bool:
        """True where the interval of the noise alone holds the truth."""
        return self.noise is not None and self.noise[0] <= self.true <= self.noise[1]


def rover_named(name: str) -> PlantParameters:
    """`nominal`, or the rover that a number draws."""
    if name == "nominal":
        return load_variant("nominal")
    return varied(load_variant("nominal"), np.random.default_rng([int(name), 3]))


def identified(rover: PlantParameters, seed: int, folder: Path, measured: bool = False) -> Identification:
    """The identification of two sweeps of the rover, with the noise of a seed, in an empty folder."""
    runs = drive(rover, SWEEPS, folder / "runs", 10_000 + 100 * seed)
    file = folder / "rover.toml"
    file.write_text(
        vehicle_file(rover, np.random.default_rng(seed)) if measured else exact_file(rover), encoding="utf-8"
    )
    return rs.identify(rs.read(*map(str, runs), vehicle=file), bootstrap=REPLICATES)


def exact_file(rover: PlantParameters) -> str:
    """The vehicle file of an owner who measured without error."""
    keys = [
        "mass",
        "sprung_mass",
        "cg_to_front_axle",
        "cg_to_rear_axle",
        "cg_height_above_roll_centre",
        "roll_inertia",
        "yaw_inertia",
        "friction",
    ]
    body = [f"{key} = {getattr(rover, key)!r}" for key in keys]
    steering = [f"trim_us = {rover.steering_trim_us}", f"rad_per_us = {rover.rad_per_us!r}"]
    imu = f"position = {list(rover.imu_position)}"
    return "\n".join(["[vehicle]", 'name = "exact"', *body, "[steering]", *steering, "[imu]", imu])


def parameters_checked(found: Identification, rover: PlantParameters, model: str = "") -> list[Checked]:
    """The free parameters of a model, default the recommended one, with the truth."""
    true = true_parameters(rover)
    true |= {"C": (true["Cf"] + true["Cr"]) / 2}
    fit = found.models[model or str(found.recommended)].fit
    conditions = [g.condition(tuple(fit.costs)) for g in found.groups]
    noise = {i.name: i for i in Bootstrap(found.groups, conditions).intervals(fit, REPLICATES)}
    return [
        Checked(e.name, true[e.name], e.value, e.interval_90, (noise[e.name].low, noise[e.name].high))
        for e in fit.estimates
        if e.free and e.interval_90 and e.name in true
    ]


def handling_checked(found: Identification, rover: PlantParameters) -> list[Checked]:
    """The printed handling of the recommended model with that of the true numbers at the same speed."""
    printed = found.handling[str(found.recommended)]
    true = true_handling(found, rover, printed.speed)
    return [
        Checked(name, true[name].value, q.value, (q.low, q.high))
        for name, q in printed.told.items()
        if q.low is not None and q.high is not None and name in true.quantities
    ]


def true_handling(found: Identification, rover: PlantParameters, speed: float) -> Handling:
    """Of the roll-yaw model with the rover's own numbers."""
    apart = roll_yaw(found.geometry, tied=False)
    own = {
        "m": rover.mass,
        "ms": rover.sprung_mass,
        "a": rover.cg_to_front_axle,
        "b": rover.cg_to_rear_axle,
        "h": rover.cg_height_above_roll_centre,
        "Ixx": rover.roll_inertia,
    }
    values = {n: v for n, v in (own | true_parameters(rover)).items() if n in apart.values}
    return handling(FitResult(apart.with_values(values), speed, (), {}, 0.0))


def repeats(
    rover: PlantParameters, seeds: Sequence[int], measured: bool = False, model: str = ""
) -> Iterator[tuple[list[Checked], list[Checked]]]:
    """(parameters, handling) of each seed."""
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            found = identified(rover, seed, Path(folder), measured)
        yield parameters_checked(found, rover, model), handling_checked(found, rover)


def by_name(rows: Sequence[Sequence[Checked]]) -> dict[str, list[Checked]]:
    """{name: its checks in all repeats}."""
    out: dict[str, list[Checked]] = {}
    for row in rows:
        for one in row:
            out.setdefault(one.name, []).append(one)
    return out


def show(title: str, found: Mapping[str, Sequence[Checked]]) -> None:
    """A line for each name: how often the truth is inside, mean ends relative to it."""
    print(title)
    print(f"  {'':30}{'true':>9}{'mean':>9}{'noise only':>12}{'printed':>10}   printed interval, mean")
    for name, rows in found.items():
        count, true = len(rows), float(np.mean([r.true for r in rows]))
        noise = f"{sum(r.inside_noise for r in rows)} of {count}" if rows[0].noise else "-"
        low, high = np.mean([r.printed for r in rows], axis=0)
        inside = f"{sum(r.inside for r in rows)} of {count}"
        mean = np.mean([r.value for r in rows])
        print(f"  {name:30}{true:9.4g}{mean:9.4g}{noise:>12}{inside:>10}   {low:.4g} to {high:.4g}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.interval_coverage", description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--rovers", nargs="+", default=["nominal", "1", "2"], help="nominal, or numbers")
    parser.add_argument("--model", default="", help="parameters of this model; default the recommended one")
    parser.add_argument("--measured", action="store_true", help="vehicle file with errors")
    asked = parser.parse_args()
    for k, name in enumerate(asked.rovers):
        first = asked.first + 100 * k  # other noise for every rover
        seeds = range(first, first + asked.seeds)
        parameters, quantities = zip(
            *repeats(rover_named(name), seeds, asked.measured, asked.model), strict=True
        )
        show(f"rover {name}, parameters of the {asked.model or 'recommended'} model:", by_name(parameters))
        show(f"rover {name}, handling:", by_name(quantities))


if __name__ == "__main__":
    main()
