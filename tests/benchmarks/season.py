"""`python -m tests.benchmarks.season`: the drifts hidden in a season of a fleet: found or not, and how fast.

Twenty simulated vehicles, ten sessions each. Six have a drift, three logs are broken, two are of no rover.
The season is measured by plain processes and on Dask with one and two workers; the reports must be equal byte
by byte. One run has a worker killed in the middle. `--vehicles 8 --sessions 8` is a smaller one.
"""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.season.drawn_fleet import KINDS, DrawnVehicle, drawn_fleet, spoil, write_season

ROOT = Path(__file__).parents[2]
ONE_THREAD = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
NEAR = 1  # sessions by which the date of a gradual drift may be off


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.season", description=__doc__)
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--sessions", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, required=True, help="for logs and reports; kept")
    parser.add_argument("--only", choices=("drifts", "workers", "killed"), help="a part of it")
    args = parser.parse_args()
    fleet = drawn_fleet(args.vehicles, args.sessions, list(KINDS), args.seed)
    logs, files = args.folder / "logs", args.folder / "vehicles"
    fresh = not logs.exists()
    paths = write_season(fleet, logs, files, args.seed)
    if fresh:
        print(f"spoiled: {sorted(spoil(_to_spoil(fleet, logs, args.sessions), args.seed).values())}")
    print(f"{len(paths)} logs of {len(fleet)} vehicles")
    call = [str(logs), "--vehicles", str(files)]
    seconds = timed(call, args.folder / "processes-2", "--workers", "2")
    print(f"2 processes: {seconds:.0f} s")
    grade(fleet, args.folder / "processes-2" / "season.json")
    if args.only != "drifts":
        on_dask(call, args.folder, args.only)


def _to_spoil(fleet: Sequence[DrawnVehicle], logs: Path, sessions: int) -> list[Path]:
    """One log of each of five vehicles without a drift."""
    sound = [v for v in fleet if v.hidden is None][:5]
    return [logs / v.name / f"{(3 * k + 2) % sessions + 1:08d}.BIN" for k, v in enumerate(sound)]


def timed(call: Sequence[str], out: Path, *options: str) -> float:
    """Wall-clock seconds of the whole command, from the start of Python to its end."""
    started = time.monotonic()
    command = [sys.executable, "-m", "rover_sweep", "batch", *call, "--out", str(out), *options]
    done = subprocess.run(command, env=ONE_THREAD, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed:\n{done.stderr}")
    return time.monotonic() - started


def grade(fleet: Sequence[DrawnVehicle], path: Path) -> None:
    """Print for each hidden drift whether it was found with its date, and all that was invented."""
    season = json.loads(path.read_text())
    said = [
        d
        for v in season["vehicles"]
        for d in v["drifts"]
        if d["matters"] and not d["cause"] and d["kind"] != "day"
    ]
    right = 0
    for vehicle in (v for v in fleet if v.hidden):
        hidden = vehicle.hidden
        assert hidden is not None
        days = [d.isoformat() for d in vehicle.days]
        own = [d for d in said if d["vehicle"] == vehicle.name and d["quantity"] == hidden.quantity]
        off = [abs(days.index(d["day"]) - hidden.session) for d in own]
        kind = bool(own) and own[0]["kind"] == "gradual" if hidden.gradual else bool(own)
        good = kind and off[0] <= (NEAR if hidden.gradual else 0)
        right += good
        print(
            f"{'found' if good else 'NOT FOUND'}: {hidden.kind} on {vehicle.name} from {days[hidden.session]}"
        )
        for d in own:
            said.remove(d)
            print(f"    {d['sentence']}")
    print(f"{right} found with their dates, {len(said)} invented; {len(season['refused'])} logs refused")
    for d in said:
        print(f"    INVENTED {d['sentence']}")
    for source, why in season["refused"]:
        print(f"    refused {Path(source).parent.name}/{Path(source).name}: {why}")


def on_dask(call: Sequence[str], folder: Path, only: str | None) -> None:
    """The same on Dask: times, equality, a killed worker."""
    if only != "killed":
        spent = {}
        for count in (1, 2):
            with cluster(count) as (address, _):
                spent[count] = timed(call, folder / f"dask-{count}", "--scheduler", address)
            same = equal(folder / "processes-2", folder / f"dask-{count}")
            print(f"{count} Dask worker(s): {spent[count]:.0f} s, {'equal' if same else 'NOT EQUAL'}")
        print(f"time at 2 workers over that at 1: {spent[2] / spent[1]:.2f}")
    if only == "workers":
        return
    with cluster(2) as (address, pids):
        victim = subprocess.Popen(["sh", "-c", f"sleep 25; kill -9 {pids[0]}"])
        seconds = timed(call, folder / "dask-killed", "--scheduler", address)
        victim.wait()
    same = equal(folder / "processes-2", folder / "dask-killed")
    print(f"2 Dask workers, one killed after 25 s: {seconds:.0f} s, {'equal' if same else 'NOT EQUAL'}")


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[int]]]:
    """(address, process ids of the workers) of a scheduler and workers of one thread on this machine."""
    port = 18786
    address = f"tcp://127.0.0.1:{port}"
    quiet = {"env": ONE_THREAD, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    python = [sys.executable, "-m"]
    started = [
        subprocess.Popen(
            [
                *python,
                "distributed.cli.dask_scheduler",
                "--host",
                "127.0.0.1",
                "--port",
                str(port),
                "--no-dashboard",
            ],
            **quiet,
        )
    ]
    worker = [
        *python,
        "distributed.cli.dask_worker",
        address,
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
    ]
    try:
        started += [subprocess.Popen(worker, **quiet) for _ in range(workers)]
        from distributed import Client

        with Client(address, timeout="60s") as client:
            client.wait_for_workers(workers, timeout=60)
        yield address, [p.pid for p in started[1:]]
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGTERM)
        for process in reversed(started):
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:  # a worker may wait for its scheduler
                process.kill()


def equal(one: Path, two: Path) -> bool:
    """True where all reports, tables and measured values of two seasons have the same bytes."""
    names = sorted(str(p.relative_to(one)) for p in one.rglob("*") if p.is_file())
    others = sorted(str(p.relative_to(two)) for p in two.rglob("*") if p.is_file())
    if names != others:
        return False
    _, different, errors = filecmp.cmpfiles(one, two, names, shallow=False)
    return not different and not errors


if __name__ == "__main__":
    main()
