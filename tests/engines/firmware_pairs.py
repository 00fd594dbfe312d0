"""`python -m tests.engines.firmware_pairs`: recordings of the firmware against a simulation by somebody else.

The recordings are committed sets of the official firmware with the embedded rover behind it. The simulation
is the same rover in another engine: it has the true numbers but one, and not the effect. It repeats the
recorded steering and speed, and is read as a .csv, without noise, filter or clock of its own.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

import rover_sweep as rs
from rover_sweep.api.diagnose import compare
from rover_sweep.data.recording import Recording
from tests.engines.engine import MODULES, Engine, EngineRover, engine
from tests.foreign.plant import DT, SURFACE, Numbers
from tests.foreign.rover import Instruments, Surroundings

DATA = Path(__file__).parents[1] / "data"
RUNS, HELD_OUT = ("run1", "run2"), "run4"
EVERY = 5  # ms between two rows of the .csv
COLUMNS = {"time": "t", "delta": "delta", "r": "r", "p": "p", "ay": "ay", "vy": "vy", "speed": "speed"}
TRIMMED = 1.0  # s at rest before the first row of the recording
# number of the engine's rover, of the truth, and its names in the answer
NAMES = {"Izz": ("Izz",), "kphi": ("k_phi",), "Cf": ("Cf",), "Cr": ("Cr",)}


def rover_of(truth: dict[str, Any]) -> EngineRover:
    """The rover behind the recordings, without its effects and with an IMU that has no error."""
    a, b = truth["cg_to_front_axle"], truth["cg_to_rear_axle"]
    h = truth["cg_height_above_roll_centre"]
    numbers = Numbers(
        m=truth["mass"],
        ms=truth["sprung_mass"],
        a=a,
        b=b,
        track=0.75 * (a + b),
        Izz=truth["yaw_inertia"],
        Ixx=truth["roll_inertia"],
        h=h,
        kphi=truth["roll_stiffness"],
        bphi=truth["roll_damping"],
        roll_axis=0.05,
        Cf=truth["front_cornering_stiffness"],
        Cr=truth["rear_cornering_stiffness"],
        ackermann=0.0,
        gain=1 / truth["servo_lag"],
        motor_lag=0.001,
        rate=truth["servo_rate_limit"],
        rate_form=0.0,
        tau_drive=0.1,
        most_drive=8.0,
        rolling=0.02,
        mu=truth["friction"],
    )
    imu = Instruments(
        loop_hz=200.0,
        ekf_hz=200.0,
        gyro_hz=0.0,
        accel_hz=0.0,
        imu_x=0.0,
        imu_z=h - truth["imu_position"][2],  # above the roll axis
        tilt=(0.0, 0.0, 0.0),
        gyro_bias=(0.0, 0.0),
        accel_bias=0.0,
        speed_scale=1.0,
        ekf_lag=0.0,
        ekf_gain=1.0,
        ekf_yaw=0.0,
        gyro_noise=0.0,
        accel_noise=0.0,
    )
    around = Surroundings((0.0, 0.0, 0.0))
    delay, rad_per_us = truth["servo_delay"], truth["rad_per_us"]
    return EngineRover("2-4 kg", numbers, imu, around, rad_per_us, 1500.0, delay, 2.3, 0.2)


def simulated(used: Engine, rover: EngineRover, run: Recording, path: Path) -> Path:
    """The engine's rover with the steering and speed of a recording, as a .csv."""
    pwm, speed = run["pwm"], run["speed"]
    t = np.arange(pwm.t[0] - TRIMMED, pwm.t[-1], DT)
    at = np.maximum(np.searchsorted(pwm.t, t - rover.delay, "right") - 1, 0)
    command = -(pwm.x[at] - rover.trim_us) * rover.rad_per_us
    wanted = np.interp(t, speed.t, speed.x)
    around = np.zeros((t.size, 7))
    around[:, SURFACE] = 1.0
    motion = used.signals(rover, command, wanted, around, 0.0)
    sent = np.maximum(np.searchsorted(pwm.t, t, "right") - 1, 0)
    rows = {"t": t, "delta": -(pwm.x[sent] - rover.trim_us) * rover.rad_per_us, **motion}
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS.values())
        writer.writerows(np.column_stack([rows[name][::EVERY] for name in COLUMNS.values()]).tolist())
    return path


def compared_set(name: str, letter: str, number: str, factor: float) -> str:
    """One line: what the simulation lacks and has wrong, and what the comparison said."""
    folder = DATA / "concealed-ardurover" / letter
    text = (DATA / "concealed-ardurover-truth" / f"{letter}.toml").read_text()
    truth = tomllib.loads(text)
    rover = rover_of(truth["variant"])
    rover = rover.of(**{number: getattr(rover.numbers, number) * factor})  # type: ignore[assignment]
    vehicle = folder / "rover.toml"
    runs = rs.read(*(folder / f"{run}.BIN" for run in RUNS), vehicle=vehicle)
    held_out = rs.read(folder / f"{HELD_OUT}.BIN", vehicle=vehicle)
    used = engine(name)
    with tempfile.TemporaryDirectory() as scratch:
        files = [
            simulated(used, rover, run, Path(scratch) / f"sim-{run.name}.csv") for run in (*runs, *held_out)
        ]
        sims = rs.read(*files, vehicle=vehicle, columns=COLUMNS)
    started = time.monotonic()
    found = rs.diagnose(runs, held_out=held_out)
    answer = compare(runs, sims, held_out=held_out, diagnosis=found)
    said = {d.name: d.relative for d in answer.differences}
    wanted = {*NAMES[number], *truth["concealed"]} if factor != 1 else set(truth["concealed"])
    mark = "right" if set(said) == wanted else "part" if set(said) & wanted else "wrong"
    agreement = " ".join(f"{a.overall:.2f}" for a in answer.agreement)
    words = "; ".join(d.sentence for d in answer.differences)
    return (
        f"{name} {letter} {number} x {factor:g}, lacks {truth['concealed']}: {mark}: {answer.verdict}; "
        f"agreement {agreement}; {time.monotonic() - started:.0f} s; {words}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.engines.firmware_pairs", description=__doc__)
    parser.add_argument("--engine", choices=[*MODULES, "all"], default="all")
    parser.add_argument("--sets", default="acf", help="letters of the committed sets (default acf)")
    args = parser.parse_args()
    for name in MODULES if args.engine == "all" else (args.engine,):
        for k, letter in enumerate(args.sets):
            number = list(NAMES)[k % len(NAMES)]
            print(compared_set(name, letter, number, 1.2), flush=True)


if __name__ == "__main__":
    main()
