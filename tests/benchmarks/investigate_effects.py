"""How many runs an investigation needs: twelve effects, each concealed in a simulated rover.

    python -m tests.benchmarks.investigate_effects [--effect ID]... [--embedded] [--smaller K] [--out FILE]

Conceals each effect at three times its visible size, investigates without asking, and
prints the answer, the number of runs, and whether it is settled: the verdict is explained, it names exactly
this effect, and no look-alike is left. At the end: what the chosen runs were expected to tell and what they
told, in bits, with the correlation. The runs are those of the plant with the applet's wave, in this process;
--embedded drives the embedded rover over its link. A diagnosis takes 5 to 20 s.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from rover_sweep.api.investigation import Bounds, RunDriver, investigation
from rover_sweep.cli.driving.investigating import simulated_driver
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle, load
from rover_sweep.diagnosis.plans.planner import PlannedRun, manoeuvre_for
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.session.simulated_rover import SimulatedRover
from rover_sweep.study.published import Firmware, virtual_drive
from sitl.plant.variant import PlantParameters, load_variant
from sitl.plant.variant_text import variant_text
from sitl.rover_file import rover_file

EFFECTS: Mapping[str, Mapping[str, float | str]] = {
    "servo_lag": {"T": 0.195},
    "servo_rate_limit": {"R": 0.87},
    "steering_deadband": {"w": 0.009, "of": "command"},
    "steering_backlash": {"b": 0.009},
    "steering_nonlinearity": {"c3": 1.8},
    "steering_asymmetry": {"e": 0.06},
    "steering_trim": {"u0": 0.03},
    "transport_delay": {"T": 0.165},
    "tyre_relaxation": {"sigma": 0.12},
    "tyre_saturation": {"mu": 0.4},
    "front_rear_stiffness": {"ratio": 1.82},
    "imu_offset": {"x": 0.096, "z": 0.096},
}
"""Three times the visible sizes."""
LINEAR = {"friction": 4.0, "servo_rate_limit": 40.0}  # of the plant, so that only one effect is concealed
FIRMWARE = Firmware(100, 20.0, 20.0)


@dataclass
class PlantDriver:
    """Drives the plant with the applet's wave in this process; nobody is asked, since nothing moves."""

    rover: PlantParameters
    seed: int = 1
    driven: list[Recording] = field(default_factory=list)

    def recordings(self) -> tuple[Recording, ...]:
        return tuple(self.driven)

    def drive(self, run: PlannedRun) -> bool:
        name = f"{run.kind}{1 + sum(r.kind == run.kind for r in self.driven)}"
        seed = 1000 * self.seed + len(self.driven)
        self.driven.append(virtual_drive(name, self.rover, manoeuvre_for(run), run.speed, seed, FIRMWARE))
        return True

    def spent(self) -> str:
        return ""


@dataclass(frozen=True)
class Row:
    """A line of the table. bits: (expected, told) of each run that the plan chose."""

    effect: str
    answer: str
    settled: bool
    ended: str
    runs: tuple[str, ...]
    seconds: float
    steps: tuple[str, ...]
    bits: tuple[tuple[float, float], ...] = ()


def concealing(effect: str, smaller: float) -> PlantParameters:
    """The nominal plant, linear, with one effect, so many times smaller; without any for ""."""
    effects = {effect: {p: _smaller(p, v, smaller) for p, v in EFFECTS[effect].items()}} if effect else {}
    return replace(load_variant("nominal"), **LINEAR, effects=effects)  # type: ignore[arg-type]


def _smaller(parameter: str, value: float | str, times: float) -> float | str:
    if isinstance(value, str):
        return value
    if parameter in ("R", "mu"):
        return value * times
    return float(value ** (1 / times)) if parameter == "ratio" else value / times


def named(found: Diagnosis | None, effect: str) -> bool:
    """The diagnosis names exactly this effect, and no look-alike is left."""
    if found is None:
        return False
    if not effect:
        return found.verdict == "none"
    exact = [f.effect for f in found.findings] == [effect]
    return found.verdict == "explained" and exact and not found.findings[0].look_alikes


def answer_of(found: Diagnosis | None) -> str:
    if found is None:
        return "-"
    names = [" or ".join((f.effect, *f.look_alikes)) for f in found.findings]
    return f"{found.verdict}: {', '.join(names)}" if names else found.verdict


def investigated(effect: str, driver: RunDriver, vehicle: Vehicle, bounds: Bounds) -> Row:
    began, steps, bits, last, expected = time.monotonic(), [], [], None, None
    for decision in investigation(driver, vehicle, bounds):
        steps.append(f"{decision.step.action}: {decision.step.reason}")
        print(f"    {steps[-1]}", flush=True)
        last = decision.diagnosis or last
        if expected is not None and decision.told is not None:
            bits.append((expected, decision.told))
            print(f"    expected {expected:.2f} bit, told {decision.told:.2f}", flush=True)
        expected = decision.step.bits
    settled = decision.step.action == "settled" and named(last, effect)
    runs = tuple(f"{r.name} {r.mean_speed:.1f} m/s" for r in driver.recordings())
    return Row(
        effect or "none",
        answer_of(last),
        settled,
        decision.step.action,
        runs,
        time.monotonic() - began,
        tuple(steps),
        tuple(bits),
    )


@contextmanager
def driver_for(rover: PlantParameters, embedded: bool, seed: int, folder: Path) -> Iterator[RunDriver]:
    """A driver of the plant, or of the embedded rover."""
    if not embedded:
        yield PlantDriver(rover, seed)
        return
    variant, vehicle = folder / "variant.toml", folder / "rover.toml"
    folder.mkdir(parents=True)
    variant.write_text(variant_text(rover))
    vehicle.write_text(rover_file(load_variant("nominal"), "nominal"))
    simulation = SimulatedRover("embedded", variant=variant, seed=seed, prepared=False)
    with simulated_driver(simulation, folder / "run", (load(vehicle), vehicle), {}, True) as driver:
        yield driver


def table(rows: list[Row]) -> str:
    lines = [f"{'effect':<22} {'settled':<8} {'runs':>4}  answer"]
    for row in rows:
        settled = "yes" if row.settled else f"no, {row.ended}"
        lines.append(f"{row.effect:<22} {settled:<8} {len(row.runs):>4}  {row.answer}")
    count = sum(row.settled for row in rows)
    return "\n".join([*lines, f"{count} of {len(rows)} settled, {sum(len(r.runs) for r in rows)} runs"])


def information(rows: list[Row]) -> str:
    """Expected against told bits of all runs that the plan chose."""
    bits = np.array([pair for row in rows for pair in row.bits])
    if len(bits) < 3:
        return f"{len(bits)} runs were chosen by what they tell"
    expected, told = bits.mean(axis=0)
    like = np.corrcoef(*bits.T)[0, 1]
    return f"{len(bits)} runs: expected {expected:.2f} bit, told {told:.2f}, correlation {like:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.investigate_effects")
    parser.add_argument("--effect", action="append", choices=[*EFFECTS, "none"])
    parser.add_argument("--embedded", action="store_true")
    parser.add_argument("--runs", type=int, default=Bounds().runs)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--smaller", type=float, default=1.0, help="times that each effect is smaller")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rover.toml"
        path.write_text(rover_file(load_variant("nominal"), "nominal"))
        vehicle = load(path)
        for name in given.effect or EFFECTS:
            effect = "" if name == "none" else name
            print(name, flush=True)
            rover = concealing(effect, given.smaller)
            with driver_for(rover, given.embedded, given.seed, Path(folder) / name) as driver:
                row = investigated(effect, driver, vehicle, Bounds(given.runs, headings=False))
            rows.append(row)
            print(table(rows[-1:]), flush=True)
            if given.out:
                given.out.write_text(json.dumps([asdict(r) for r in rows], indent=1))
    print(table(rows))
    print(information(rows))


if __name__ == "__main__":
    main()
