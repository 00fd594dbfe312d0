"""Real hardware that nobody drove for this tool: what `diagnose` locates and names, and what it is worth.

    python tests/benchmarks/diagnosed_hardware.py [FOLDER] [CAR...]

FOLDER holds the recordings (default: $ROVER_SWEEP_RECORDINGS); CAR: p1, or the beginning of a file's name.
Every fourth run of a car is held out (of fewer the last), and of P1 the second file. About two minutes a car.
What a finding does not remove from the held-out error is not to be believed, whatever its gain. P1 on the
command line:

    python tests/acceptance/p1_tables.py FOLDER/p1 .
    rover-sweep diagnose p1_sweep.csv --hold-out p1_verify.csv --out p1 \\
        --vehicle tests/data/cars/stanford_p1.vehicle.toml --columns tests/data/cars/stanford_p1.columns.toml
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import rover_sweep as rs
from rover_sweep.data.results import ShortTable, plain_number

TESTS = Path(__file__).parents[1]
MAPS = TESTS / "data" / "cars"
DEFAULT = TESTS.parents[1] / "shared" / "recordings"
TIME_LIMIT = 150.0  # s
P1 = "stanford_p1"
CIRCLES = "umich_ardupilot_rover_circles_2017"
# what no recording can say of itself; the baseline is the fullest that the vehicle is known for
WRONG = {
    P1: "CG, height and roll inertia are assumed, and nobody says where beta holds: x and z count from the "
    "assumed roll axis; of one speed and one amplitude a second lag may pass for the relaxation length; "
    "in the second file a_y/r says 13 to 20 ft/s and r/delta twice that, which no model of this car joins.",
    "dart_free_driving_2024": "The steering curve bends and one scale is assumed, so a gain that falls with "
    "the angle may pass for load transfer; r and a_y are smoothed derivatives of a position.",
    CIRCLES: "All dimensions are assumed, roll inertia and height too, so k_phi and b_phi have no more than "
    "their scale; of steps at full lock a servo's lag, its rate limit and an unrecorded filter look alike.",
    "umich_nvidia_rover_joystick_2017": "The steering's scale is that of one circle, its curve is not known: "
    "what bends there goes into the ratio of the axles; short runs by joystick, slow against the car.",
}


def p1(folder: Path) -> tuple[rs.Runs, rs.Runs]:
    """The sweep, and the second file of the P1 car to hold out."""
    sys.path.insert(0, str(TESTS / "acceptance"))
    from p1_tables import tables

    with tempfile.TemporaryDirectory() as target:
        files = tables(folder / "p1", Path(target))
        sweep, fresh = (_read(file, P1) for file in files)
    return sweep, fresh


def car(path: Path) -> tuple[rs.Runs, rs.Runs]:
    """Runs of a .csv in which the yaw rate follows the steering, and every fourth of them (or the last)."""
    runs = _read(path, path.stem)
    groups = rs.identify(runs, bootstrap=0).groups
    usable = [run for g in groups if g.responses["r"].band for run in g.runs]
    fresh = usable[3::4] or usable[-1:]
    kept = [run for run in usable if run not in fresh]
    return replace(runs, recordings=tuple(kept)), replace(runs, recordings=tuple(fresh))


def _read(path: Path, name: str) -> rs.Runs:
    vehicle, columns = (MAPS / f"{name}.{ending}.toml" for ending in ("vehicle", "columns"))
    return rs.read(path, vehicle=vehicle if vehicle.is_file() else None, columns=columns)


def row(name: str, found: rs.FullDiagnosis) -> tuple[str, ...]:
    """One line of the table; held out: medians over the runs."""
    named = "; ".join(
        f"{f.effect} "
        + ", ".join(f"{v.name} {plain_number(v.value, 3)}" for v in f.parameters)
        + (f" (or {', '.join(f.look_alikes)})" if f.look_alikes else "")
        for f in found.findings
    )
    shown = found.held_out

    def middle(values: list[float]) -> str:
        return plain_number(float(np.median(values)), 3) if values else "-"

    rms = " -> ".join(middle([getattr(h, side).j_rms for h in shown]) for side in ("before", "after"))
    tic = " -> ".join(middle([getattr(h, side).tic for h in shown]) for side in ("before", "after"))
    share = middle([100 * h.share_removed for h in shown if h.share_removed is not None])
    unknown = f"{found.unknown.channel}: {found.unknown.depends_on}" if found.unknown else "-"
    return name, found.baseline, found.verdict, named or "-", rms, tic, share, unknown


def a_y_of(found: rs.FullDiagnosis, sweep: rs.Runs, fresh: rs.Runs) -> str:
    """What the accelerometer's place is worth in J of a_y, all else kept, and in the fresh file."""
    from rover_sweep.diagnosis.held_out import frequency_responses_of, response_costs
    from rover_sweep.diagnosis.problem.residuals import centred
    from rover_sweep.diagnosis.simulation.experiment import experiment

    assert found.model is not None
    plain = replace(found.model, x={**found.model.x, "imu_x": 0.0, "imu_z": 0.0})
    run = experiment(sweep[0])
    measured = frequency_responses_of(run, centred(run))
    j = [response_costs(run, measured, rs.simulate(m, sweep[0]).signals)["ay"] for m in (plain, found.model)]
    both = [rs.simulate(m, fresh[0]).signals["ay"] for m in (plain, found.model)]
    moved = float(np.sqrt(np.mean((both[1] - both[0]) ** 2))) / 0.3048
    return (
        f"{P1}: J of a_y on the sweep {j[0]:.1f} by the plain equation, {j[1]:.1f} with x r' - z p'; in the "
        f"second file the term is {moved:.2f} ft/s^2 rms, which hardly excites it"
    )


def diagnosed(name: str, parts: tuple[rs.Runs, rs.Runs]) -> tuple[tuple[str, ...], list[str]]:
    """A line of the table and the sentences below it."""
    used, fresh = parts
    baseline = "roll-yaw" if name == P1 else "bicycle"
    found = rs.diagnose(used, fresh, baseline=baseline, time_limit=TIME_LIMIT)
    words = [f"{name}: {m.sentence}" for m in found.mismatch] + [f"{name}: {found.sentence}"]
    words += [
        f"{name}: {f.effect}: share of the held-out error "
        + ", ".join(
            plain_number(100 * h.share_removed, 2) + " %" for h in f.held_out if h.share_removed is not None
        )
        for f in found.findings
    ]
    if name == P1:
        words.append(a_y_of(found, used, fresh))
    return row(name, found), [*words, f"{name}: what could be wrong: {WRONG[name]}"]


def main(folder: Path, wanted: list[str]) -> None:
    lines, words = [], []
    cars = {path.stem: path for path in sorted((folder / "cars").glob("*.csv"))}
    logs = [*sorted((folder / "rover_logs").glob("*.BIN")), *sorted((folder / "rover_logs").glob("*.tlog"))]
    for name in [P1, *cars, *(log.name for log in logs)]:
        if wanted and not any(name.startswith(w) for w in wanted):
            continue
        try:
            if name in (P1, *cars):
                line, told = diagnosed(name, p1(folder) if name == P1 else car(cars[name]))
                lines.append(line)
                words += told
            else:
                rs.read(next(log for log in logs if log.name == name))
                words.append(f"{name}: holds a run, but no vehicle is known")
        except rs.RoverSweepError as refusal:
            words.append(f"{name}: refused (exit code {refusal.exit_code}): {refusal}")
    headings = ("car", "baseline", "verdict", "named", "J_rms", "TIC", "removed, %", "unknown")
    print(ShortTable("left out, and held out", headings, tuple(lines)))
    print(*words, sep="\n")


if __name__ == "__main__":
    # coverage.py beside this file would be taken for the package of that name
    sys.path = [p for p in sys.path if Path(p).resolve() != Path(__file__).resolve().parent]
    root = Path(os.environ.get("ROVER_SWEEP_RECORDINGS", DEFAULT))
    given = sys.argv[1:]
    if given and Path(given[0]).is_dir():
        root = Path(given.pop(0))
    main(root, ["stanford_p1" if name == "p1" else name for name in given])
