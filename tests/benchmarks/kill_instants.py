"""kill -9 at random instants of a run that the laptop drives, with real processes and in real time.

    python -m tests.benchmarks.kill_instants --kills 100

After each kill: 4 s later nothing moves and the rover is disarmed or in HOLD, RC_OVERRIDE_TIME is as before,
and no .tlog of the session is shorter than it was. A quarter of an hour for 50 kills, on the embedded rover.
"""

from __future__ import annotations

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import read_present
from rover_sweep.vehicle.run.controls import ARM, FORCE, pump
from sitl.launcher import start_embedded

HOLD = 4
LATEST, AFTER = 45.0, 4.0  # s from the program's start; s after the kill
STANDS = 0.3  # m/s
BEFORE = {"RC_OVERRIDE_TIME": 3.0, "SWP_LAPSE": 0.0, "SWP_THR": 0.0}
SWEEP = "100,3,20,8"
RUN = [
    "run",
    "--arm",
    "--throttle",
    "1710",
    "--throw-switch",
    "--sweep",
    SWEEP,
    "--sweep",
    SWEEP,
    "--vehicle",
]


@dataclass(frozen=True)
class Kill:
    """at: s after the start. state: of the applet then; wrong: a sentence for each promise not kept."""

    at: float
    armed: bool
    speed: float
    wrong: tuple[str, ...]


def killed(url: str, vehicle: Path, folder: Path, at: float, sizes: dict[Path, int]) -> Kill:
    """One program, killed; `sizes` has the .tlog files and is brought up to date."""
    command = [
        sys.executable,
        "-m",
        "rover_sweep",
        *RUN,
        str(vehicle),
        "--connect",
        url,
        "--out",
        str(folder),
    ]
    program = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL
    )
    time.sleep(at)
    program.send_signal(signal.SIGKILL)
    program.wait()
    time.sleep(AFTER)
    with Link.open(url, vehicle.parent / "look.tlog") as link:
        moved = link.request_message("LOCAL_POSITION_NED")
        have = read_present(link, BEFORE)
        armed, mode = link.armed, link.mode
        speed = 0.0 if moved is None else (moved.vx**2 + moved.vy**2) ** 0.5
        wrong = list(_wrong(speed, armed, mode, have))
        if armed:
            link.command(ARM, 0.0, FORCE)
            link.wait_for("HEARTBEAT", 3.0, lambda _: not link.armed)
        pump(link, 1.0)
    wrong += [f"{path.name} shrank" for path, size in sizes.items() if path.stat().st_size < size]
    sizes.update((path, path.stat().st_size) for path in folder.glob("*.tlog"))
    return Kill(at, armed, speed, tuple(wrong))


def _wrong(speed: float, armed: bool, mode: int, have: dict[str, float]) -> Iterator[str]:
    if speed > STANDS:
        yield f"it moves at {speed:.2f} m/s"
    if armed and mode != HOLD:
        yield f"it is armed in mode {mode}"
    for name, value in BEFORE.items():
        if have.get(name) != value:
            yield f"{name} is {have.get(name)}"


def main(arguments: Sequence[str] | None = None) -> int:
    """0 where every promise was kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    draw, sizes, bad, armed = random.Random(options.seed), dict[Path, int](), 0, 0
    with tempfile.TemporaryDirectory() as home:
        vehicle = Path(home) / "rover.toml"
        example = [sys.executable, "-m", "rover_sweep", "vehicle", "--example"]
        vehicle.write_bytes(subprocess.run(example, check=True, capture_output=True).stdout)
        settings = [
            "--applet",
            *(
                o
                for p in ("SCR_ENABLE=1", "SCHED_LOOP_RATE=100", "RC6_OPTION=300")
                for o in ("--parameter", p)
            ),
        ]
        with start_embedded(Path(home) / "rover", speedup=1.0, options=settings) as rover:
            for number in range(options.kills):
                folder = Path(home) / f"session{number // 10}"
                kill = killed(rover.connection, vehicle, folder, draw.uniform(0.5, LATEST), sizes)
                bad, armed = bad + bool(kill.wrong), armed + kill.armed
                words = "; ".join(kill.wrong) or "kept"
                print(
                    f"{number + 1:3d}  {kill.at:5.2f} s  {'armed' if kill.armed else '     '}  "
                    f"{kill.speed:.2f} m/s  {words}",
                    flush=True,
                )
    print(f"{options.kills - bad} of {options.kills} kept all promises; {armed} were killed while armed")
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
