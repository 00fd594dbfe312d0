"""Every speed claim as one table: ratios to a peer by turns in one process, and commands with their memory.

    python tests/benchmarks/all.py [--quick] [--gigabytes 4]

--quick leaves out the commands that take minutes. Times are CPU seconds (user and system, of all threads), as
the median of TURNS turns in which both sides run one after the other, without a first one to warm up. A long
log is the short one repeated; its peer's time is that for the short one, times the repetitions. --gigabytes
adds a .BIN of that size.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.pop(0)  # this folder, whose coverage.py numba would take for another one
sys.path.insert(0, str(Path(__file__).parents[1] / "identification"))
from scipy.optimize import least_squares
from scipy.signal import csd, welch
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.data.recording import Recording
from rover_sweep.identification.fit import Condition, fit, residuals
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.live.verdict import judge
from rover_sweep.logs.readers.dataflash import open_parts
from rover_sweep.logs.readers.tlog import open_tlog
from rover_sweep.logs.readers.tlog_channels import WANTED
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.coherence import responses

ROOT = Path(__file__).resolve().parents[2]
TURNS = 5
WINDOWS = (5.0, 7.5, 11.0, 17.0, 25.0)
DATA = ROOT / "tests" / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
COLUMNS = {"IMU": ("TimeUS", "GyrX", "GyrZ"), "XKF1": ("TimeUS", "VN", "VE")}
REPEATED = 60  # times that a recording is repeated for a long log
RUNS = [str(NOMINAL / f"run{k}.BIN") for k in (1, 2, 3, 4)]


FMT_LENGTH = 89  # bytes; the format of FMT, which starts another log where it is repeated
STARTER = """
import resource, subprocess, sys, time
begin = time.perf_counter()
code = subprocess.call(sys.argv[1:], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss, time.perf_counter() - begin)
sys.exit(code)
"""


@dataclass(frozen=True)
class Row:
    """One line of the table. ours, peer: CPU seconds. size: bytes read, 0 for other work."""

    work: str
    ours: float
    peer: float = float("nan")
    against: str = ""
    size: int = 0
    memory: str = ""

    def line(self) -> str:
        ratio = f"{self.peer / self.ours:.1f} x {self.against}" if self.against else self.against
        speed = f"{self.size / self.ours / 1e6:.0f} MB/s" if self.size else ""
        return f"| {self.work} | {self.ours:.3f} | {speed} | {ratio} | {self.memory} |"


def by_turns(ours: Callable[[], object], peer: Callable[[], object] | None = None) -> tuple[float, float]:
    """Median CPU seconds of both, which run one after the other."""
    taken = np.full((TURNS + 1, 2), np.nan)
    for turn in range(TURNS + 1):
        for side, work in enumerate((ours, peer)):
            if work is not None:
                start = time.process_time()
                work()
                taken[turn, side] = time.process_time() - start
    return float(np.median(taken[1:, 0])), float(np.median(taken[1:, 1]))


def read_columns(path: Path) -> None:
    for part in open_parts(path):
        for name, columns in COLUMNS.items():
            part.rows(name, *columns)


def pymavlink_columns(path: Path) -> None:
    """The same columns with pymavlink's reader, which skips the messages of other types."""
    from pymavlink import DFReader

    log = DFReader.DFReader_binary(str(path))
    found: dict[str, list[list[float]]] = {name: [] for name in COLUMNS}
    while (message := log.recv_match(type=list(COLUMNS))) is not None:
        name = message.get_type()
        found[name].append([getattr(message, column) for column in COLUMNS[name]])


def pymavlink_messages(path: Path) -> None:
    from pymavlink import mavutil

    log = mavutil.mavlink_connection(str(path))
    while log.recv_match(type=list(WANTED)) is not None:
        pass


def readers(folder: Path) -> Iterator[Row]:
    """Short logs against pymavlink, long ones against pymavlink's time for the short one, per byte."""
    for suffix, ours, theirs in (
        (".BIN columns", read_columns, pymavlink_columns),
        (".tlog messages", lambda p: open_tlog(p, WANTED), pymavlink_messages),
    ):
        short = NOMINAL / f"run1{suffix.split()[0]}"
        long = folder / short.name
        start = FMT_LENGTH if short.suffix == ".BIN" else 0
        data = short.read_bytes()
        long.write_bytes(data + data[start:] * (REPEATED - 1))
        peer = lambda p=short, w=theirs: w(p)  # noqa: E731
        for path in (short, long):
            size = path.stat().st_size
            one, other = by_turns(lambda p=path, w=ours: w(p), peer)
            share = size / short.stat().st_size
            yield Row(f"{suffix}, {size / 1e6:.1f} MB", one, other * share, "pymavlink", size)


def welch_responses(run: Recording) -> list[np.ndarray]:
    """Plain Welch estimates of the four responses at the five window lengths, on the even grid."""
    t, x = run.uniform(400.0)
    out = []
    for name in ("r", "ay", "vy", "p"):
        for length in WINDOWS:
            n = int(length * 400)
            spectra = csd(x["delta"], x[name], 400.0, nperseg=n, noverlap=int(0.8 * n))[1]
            out.append(spectra / welch(x["delta"], 400.0, nperseg=n, noverlap=int(0.8 * n))[1])
    return out


def by_differences(structure: ModelStructure, condition: Condition) -> None:
    """The roll-yaw fit with scipy's finite differences in place of the analytic Jacobian."""
    names = [p.name for p in structure.free]
    start = np.array([p.value for p in structure.free])

    def error(x: np.ndarray) -> np.ndarray:
        moved = structure.with_values(dict(zip(names, x * start, strict=True)))
        return np.concatenate(list(residuals(moved, condition).values()))

    least_squares(error, np.ones(start.size), x_scale="jac", xtol=1e-9, ftol=1e-9)


def estimates() -> Iterator[Row]:
    """The core of the identification, against plain estimates."""
    truth = roll_yaw(GEOMETRY).with_values(TRUE)
    run = driven(truth, Sweep(t_rec=55.0, straight=0.0, fade=0.0, dwell=0.0), noise=0.002, log_rate=500.0)
    found = responses([run], windows=WINDOWS)
    times = by_turns(lambda: responses([run], windows=WINDOWS), lambda: welch_responses(run))
    yield Row("four composite responses, 55 s", *times, "plain Welch")
    condition: Condition = Group(run.mean_speed, (run,), found).condition(("r", "ay", "p"))
    times = by_turns(
        lambda: fit(roll_yaw(GEOMETRY), [condition]), lambda: by_differences(roll_yaw(GEOMETRY), condition)
    )
    yield Row("roll-yaw fit", *times, "finite differences")


def verdicts() -> Iterator[Row]:
    """The verdict after a run, in a session that has loaded its modules."""
    for path in (NOMINAL / "run1.tlog", NOMINAL / "run1.BIN"):
        ours, _ = by_turns(lambda p=path: judge(p, (0.0, 1e9), "run1"))
        yield Row(f"verdict after a run, {path.suffix}", ours)


def measured(work: str, *arguments: str, size: int = 0) -> Row:
    """Python with `arguments` in a process of its own: CPU seconds, peak memory, wall time.

    A small process starts it, because the peak of a process counts that of the one that it was forked from.
    """
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-S", "-c", STARTER, sys.executable, *arguments],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )
    if done.returncode:
        sys.exit(f"{work} failed: python {' '.join(arguments)}\n{done.stderr[-1000:]}")
    cpu, peak, wall = (float(value) for value in done.stdout.split())
    return Row(work, cpu, size=size, memory=f"{peak / 1024:.0f} MB, wall {wall:.1f} s")


def commands(quick: bool) -> Iterator[Row]:
    vehicle = ("--vehicle", str(DATA / "rover.toml"))
    start = ("-m", "rover_sweep")
    yield measured("`rover-sweep --help`", *start, "--help")
    yield measured("`coherence` of a run", *start, "coherence", RUNS[0])
    yield measured("`identify` of four runs", *start, "identify", *vehicle, "--out", "out", *RUNS)
    if quick:
        return
    yield measured("`dry-run`", *start, "dry-run")
    concealed = DATA / "concealed-ardurover" / "a"
    runs = [str(path) for path in sorted(concealed.glob("run*.BIN"))]
    rover = ("--vehicle", str(concealed / "rover.toml"))
    yield measured("`diagnose` of four runs", *start, "diagnose", *rover, "--out", "out", *runs)


def large(folder: Path, gigabytes: float) -> Iterator[Row]:
    """Columns of a log that does not fit into the memory that is used to read it."""
    if not gigabytes:
        return
    path, data = folder / "large.BIN", (NOMINAL / "run1.BIN").read_bytes()
    with path.open("wb") as file:
        file.write(data)
        while file.tell() < gigabytes * 1e9:
            file.write(data[FMT_LENGTH:])
    code = (
        "import sys; from pathlib import Path; from rover_sweep.logs.readers.dataflash import open_parts\n"
        "for part in open_parts(Path(sys.argv[1])):\n"
        f"    kept = [part.rows(name, *columns) for name, columns in {COLUMNS!r}.items()]"
    )
    size = path.stat().st_size
    (part,) = open_parts(path)
    kept = sum(
        part.count(name) * sum(part.formats[name].dtype[c].itemsize for c in columns)
        for name, columns in COLUMNS.items()
    )
    row = measured(f".BIN columns, {size / 1e9:.1f} GB", "-c", code, str(path), size=size)
    yield replace(row, memory=f"{row.memory}; the columns {kept / 2**20:.0f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="without the commands that take minutes")
    parser.add_argument("--gigabytes", type=float, default=0.0, help="size of an additional large .BIN")
    asked = parser.parse_args()
    print("| work | CPU, s | speed | faster than the peer by | peak memory |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        read = (readers(Path(folder)), large(Path(folder), asked.gigabytes))
        for rows in (*read, estimates(), verdicts(), commands(asked.quick)):
            for row in rows:
                print(row.line(), flush=True)


if __name__ == "__main__":
    main()
