"""`python -m tests.diagnosis.flips SETS`: whether the diagnosis is a function of the data.

Each set is diagnosed as it is and with changes that mean nothing: a number of the vehicle file changed by one
part in a million, noise of a thousandth of the noise in the recordings, the runs in another order, one thread
instead of two, the command line instead of Python, and another start of the first fit. Verdict and names must
be the same, and each number within `MOVES` of the width of its 90 % interval; after another start also the
cost of the best explanation. SETS: folders with rover.toml
and run1.BIN to run4.BIN, folders of such folders, folders of cNN.json with cNN.tar.xz, or drawn:N, the first
N seeds of each kind of set of each engine of `tests.engines`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, replace
from math import exp, log
from pathlib import Path

import numpy as np

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import diagnosed, material
from rover_sweep.api.read import Runs
from rover_sweep.data.recording import Recording, Signal
from rover_sweep.data.vehicle_file import Measured, Vehicle
from rover_sweep.diagnosis.posterior import infer
from rover_sweep.diagnosis.result import START, Diagnosis, DiagnosisSettings
from rover_sweep.spectra.side_by_side import one_thread
from tests.engines.draw import KINDS, drawn_set
from tests.engines.engine import MODULES
from tests.foreign.grade import cases, unpacked

PART = 1e-6  # by which a number of the vehicle file changes
NOISE = 1e-3  # of the noise that the recordings have
MOVES = 0.02  # of the interval's width
SAME_COST = 1e-6  # relative
FROM = 0.3  # standard deviation of ln of a parameter from which the first fit starts


@dataclass(frozen=True)
class Told:
    """What a diagnosis says. numbers: {name: (value, low, high)}; cost: of the best explanation, NaN where it
    is not known; seconds: it took."""

    verdict: str
    names: tuple[str, ...]
    numbers: Mapping[str, tuple[float, float | None, float | None]]
    cost: float
    seconds: float


@dataclass(frozen=True)
class Case:
    """A set: sweeps with their vehicle, and a held-out run. folder: of its files, "" if drawn.

    only: the effects that are tried, () for all.
    """

    name: str
    runs: Runs
    held_out: tuple[Recording, ...]
    folder: str = ""
    only: tuple[str, ...] = ()


def told(case: Case, parameters: Mapping[str, float] | None = None) -> Told:
    """The diagnosis of a set by Python. parameters: {name: SI value} at which the first fit begins."""
    found: list[float] = []
    explore = infer.explore

    def watched(*args, **options):  # type: ignore[no-untyped-def]
        explored = explore(*args, **options)
        found.append(min(e.cost for e in explored.pool))
        return explored

    infer.explore = watched
    try:
        assert case.runs.vehicle is not None
        settings = DiagnosisSettings(with_effects=case.only, parameters=parameters or {})
        started = time.monotonic()
        answer = diagnosed(material(case.runs, case.held_out), case.runs.vehicle, settings)
    finally:
        infer.explore = explore
    return _of(answer, found[-1] if found else float("nan"), time.monotonic() - started)


def _of(answer: Diagnosis, cost: float, seconds: float) -> Told:
    numbers = {f"{f.effect}.{v.name}": v for f in answer.findings for v in f.parameters}
    numbers |= {v.name: v for v in answer.parameters}
    values = {name: (v.value, v.low, v.high) for name, v in numbers.items()}
    return Told(answer.verdict, tuple(f.effect for f in answer.findings), values, cost, seconds)


def told_by_the_command(case: Case) -> Told:
    """The diagnosis of a set by the command line, from its diagnosis.json."""
    logs = [str(Path(case.folder) / f"run{k}.BIN") for k in (1, 2, 3, 4)]
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "rover_sweep", "diagnose", *logs[:3], "--hold-out", logs[3]]
        command += ["--vehicle", str(Path(case.folder) / "rover.toml"), "--out", out]
        started = time.monotonic()
        subprocess.run(command, check=False, capture_output=True)
        document = json.loads((Path(out) / "diagnosis.json").read_text())
    numbers = {
        f"{f['effect']}.{name}": v for f in document["findings"] for name, v in f["parameters"].items()
    }
    numbers |= document["parameters"]
    values = {
        n: (v["value"], *(v.get("interval_90") or (v.get("low"), v.get("high")))) for n, v in numbers.items()
    }
    names = tuple(f["effect"] for f in document["findings"])
    return Told(document["verdict"], names, values, float("nan"), time.monotonic() - started)


def differences(one: Told, other: Told) -> list[str]:
    """How two answers differ, in words; [] if they are the same."""
    out = [] if one.verdict == other.verdict else [f"{one.verdict} -> {other.verdict}"]
    if one.names != other.names:
        out.append(f"{', '.join(one.names) or 'nothing'} -> {', '.join(other.names) or 'nothing'}")
    out += [
        f"{name} {one.numbers[name][0]:.5g} -> {other.numbers[name][0]:.5g}: {moved:.3f} widths"
        for name, moved in moves(one, other).items()
        if not moved <= MOVES
    ]
    return out


def moves(one: Told, other: Told) -> dict[str, float]:
    """{number: the largest move of its value or ends over the interval's width}, of numbers in both."""
    out = {}
    for name in one.numbers.keys() & other.numbers.keys():
        first, second = one.numbers[name], other.numbers[name]
        _, low, high = first
        width = high - low if low is not None and high is not None else abs(first[0])
        pairs = [(a, b) for a, b in zip(first, second, strict=True) if a is not None and b is not None]
        ends_alike = all((a is None) == (b is None) for a, b in zip(first, second, strict=True))
        far = max(abs(b - a) for a, b in pairs)
        out[name] = (
            far / width if width > 0.0 and ends_alike else float("inf") if far or not ends_alike else 0.0
        )
    return out


# ---- The changes.


Change = Callable[[Case], Told]


def changes(case: Case, starts: int, every_number: bool) -> Iterator[tuple[str, Change]]:
    """(name, how the changed set is diagnosed) of each change."""
    assert case.runs.vehicle is not None
    numbers = stated(case.runs.vehicle)
    for name in numbers if every_number else ("mass",):
        yield f"{name} x {1 + PART:.6f}", lambda c, name=name: told(_with_number(c, name))
    yield "noise", lambda c: told(_noisy(c))
    yield "order", lambda c: told(replace(c, runs=replace(c.runs, recordings=c.runs.recordings[::-1])))
    yield "one thread", _on_one_thread
    if case.folder:
        yield "command line", told_by_the_command
    for seed in range(starts):
        yield f"start {seed + 1}", lambda c, seed=seed: told(c, _drawn_start(c, seed))


def stated(vehicle: Vehicle) -> list[str]:
    """The numbers that a vehicle file states, without the neutral PWM, which is an instruction."""
    own = [f.name for f in fields(vehicle) if isinstance(getattr(vehicle, f.name), Measured)]
    return [name for name in own if name != "trim_us"]


def _with_number(case: Case, name: str) -> Case:
    vehicle = case.runs.vehicle
    assert vehicle is not None
    old = getattr(vehicle, name)
    new = replace(vehicle, **{name: replace(old, value=old.value * (1 + PART))})
    runs, held = case.runs.recordings, case.held_out
    if name == "rad_per_us":  # the angles were made with it
        runs, held = (tuple(_scaled(run, "delta", 1 + PART) for run in some) for some in (runs, held))
    return replace(case, runs=replace(case.runs, recordings=runs, vehicle=new), held_out=held)


def _scaled(run: Recording, channel: str, factor: float) -> Recording:
    signal = run[channel]
    return replace(run, channels={**run.channels, channel: replace(signal, x=signal.x * factor)})


def _noisy(case: Case) -> Case:
    random = np.random.default_rng(1)

    def noisy(signal: Signal) -> Signal:
        white = np.std(np.diff(signal.x, 2)) / np.sqrt(6.0)  # of white noise; more where the motion is quick
        return replace(signal, x=signal.x + NOISE * white * random.standard_normal(signal.x.size))

    def with_noise(run: Recording) -> Recording:
        own = {c: noisy(run[c]) for c in ("r", "p", "ay", "vy") if c in run}
        return replace(run, channels={**run.channels, **own})

    return replace(case, runs=replace(case.runs, recordings=tuple(map(with_noise, case.runs.recordings))))


def _on_one_thread(case: Case) -> Told:
    with one_thread():
        return told(case)


def _drawn_start(case: Case, seed: int) -> dict[str, float]:
    """Parameters of the baseline, drawn about usual ones of the rover."""
    vehicle, random = case.runs.vehicle, np.random.default_rng(seed)
    assert vehicle is not None
    a, b, mass = vehicle.cg_to_front_axle.value, vehicle.cg_to_rear_axle.value, vehicle.mass.value
    usual = {"Cf": 15.0 * mass, "Cr": 15.0 * mass, "Izz": mass * a * b}
    return {n: exp(log(v) + FROM * random.standard_normal()) for n, v in usual.items() if n in START}


# ---- The sets, and the command.


def sets(wanted: Sequence[str]) -> Iterator[str]:
    """The name of each set: a folder with runs, a file cNN.json, or drawn:engine:kind:seed."""
    for one in wanted:
        if one.startswith("drawn:"):
            seeds = range(1, int(one.removeprefix("drawn:")) + 1)
            yield from (f"drawn:{e}:{k}:{s}" for e in MODULES for k in KINDS for s in seeds)
            continue
        folder = Path(one)
        if folder.is_file() or (folder / "run1.BIN").exists():
            yield one
        else:
            yield from (str(p) for p in cases(folder))
            yield from (
                str(p.parent) for p in sorted(folder.rglob("run3.BIN")) if (p.parent / "run4.BIN").exists()
            )


def case_of(name: str, out: Path) -> Case:
    """The set of this name; a packed one is unpacked into the folder `out`."""
    if name.startswith("drawn:"):
        _, engine, kind, seed = name.split(":")
        drawn = drawn_set(engine, kind, int(seed))
        return Case(name, drawn.runs, drawn.held_out)
    folder = Path(name)
    if folder.suffix == ".json":
        with unpacked(folder) as (_, vehicle, logs):
            for file in (vehicle, *logs):
                (out / file.name).write_bytes(file.read_bytes())
        name, folder = folder.stem, out
    runs = rs.read(*(folder / f"run{k}.BIN" for k in (1, 2, 3)), vehicle=folder / "rover.toml")
    held = rs.read(folder / "run4.BIN", vehicle=folder / "rover.toml")
    return Case(name, runs, tuple(held), str(folder))


def judged(wanted: tuple[str, int, bool]) -> tuple[str, list[str]]:
    """(lines about a set, its flips)."""
    name, starts, every_number = wanted
    with tempfile.TemporaryDirectory() as out:
        case = case_of(name, Path(out))
        plain = told(case)
        lines = [
            f"{case.name}: {plain.verdict} {', '.join(plain.names)} {plain.cost:.3f} {plain.seconds:.0f} s"
        ]
        flips = []
        for change, run in changes(case, starts, every_number):
            other = run(case)
            found = differences(plain, other)
            if change.startswith("start") and abs(other.cost - plain.cost) > SAME_COST * plain.cost:
                found.append(f"cost of the best explanation {plain.cost:.4f} -> {other.cost:.4f}")
            largest = max(moves(plain, other).items(), key=lambda pair: pair[1], default=("-", 0.0))
            most = f"largest move {largest[1]:.4f} widths ({largest[0]})"
            lines.append(f"  {change}: " + ("; ".join(found) if found else f"the same, {most}"))
            flips += [f"{case.name}, {change}: {'; '.join(found)}"] if found else []
    return "\n".join(lines), flips


def main() -> None:
    """Prints each set with its changes, then the flips; exit code 1 if there is one."""
    parser = argparse.ArgumentParser(prog="python -m tests.diagnosis.flips", description=__doc__)
    parser.add_argument("sets", nargs="+", metavar="SETS")
    parser.add_argument("--starts", type=int, default=1, help="other starts of the first fit (default 1)")
    parser.add_argument("--every-number", action="store_true", help="of the vehicle file, not the mass alone")
    parser.add_argument("--jobs", type=int, default=1, help="sets at a time")
    args = parser.parse_args()
    wanted = [(name, args.starts, args.every_number) for name in sets(args.sets)]
    flips = list[str]()
    with ProcessPoolExecutor(args.jobs) as pool:
        for lines, found in pool.map(judged, wanted):
            print(lines, flush=True)
            flips += found
    print(f"\n{len(wanted)} sets, {len(flips)} flips")
    print("\n".join(flips))
    sys.exit(1 if flips else 0)


if __name__ == "__main__":
    main()
