"""`gains --check` on the real firmware: drawn rovers, each well tuned and with each of four faults.

    python tests/benchmarks/gains_check_on_firmware.py --ardurover FILE [--rovers N] [--out DIR] [--keep DIR]

For each drawn rover (linkage, tyres, servo, trim, speed) a first drive in ACRO with the firmware's defaults
gives its response, and the design the gains. Then the same profile is driven with them, with half and with
double FF, with a P above the stability limit, and with a limit of the target that is too low. Each drive is
checked without a model. Prints a line each, and how many were right. --keep writes the part of the first
rover's logs that `tests/gains` replays. Some 5 minutes a rover.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.remove(str(Path(__file__).parent))  # its coverage.py hides the library of that name
sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[1] / "gains"))

from acro_drive import STEP, Profile, Segment, kept
from acro_on_firmware import drive
from test_gains_on_firmware import on_the_plant

from rover_sweep.gains.check import SteeringCheck, check_steering
from rover_sweep.gains.steering_chain import Autopilot, Gains
from rover_sweep.gains.tuning import Family, design_gains, unbounded
from rover_sweep.logs.controllers import read_controllers
from sitl.launcher import find_ardurover
from sitl.plant.variant import VARIANTS

SHORT = Profile(steps=4, sine_s=8.0)
EXPECTED = {
    "tuned": "",
    "half": "FF too low",
    "double": "FF too high",
    "swings": "oscillates",
    "limit": "limit hit",
}
PAST_LIMIT = 1.15  # times the P from which the plant swings
KEPT_FROM = 9.5  # s, of a drive: two steps and the sine
FRAMES = ("HEARTBEAT", "ATTITUDE", "GLOBAL_POSITION_INT", "PID_TUNING")
PARAMETERS = ("ATC_", "MOT_", "CRUISE_", "SERVO1_", "SCHED_LOOP_RATE", "INS_GYRO_FILTER")
LIMITS = {"ATC_STR_RAT_MAX": 20.0, "ATC_TURN_MAX_G": 0.1, "ATC_STR_ACC_MAX": 20.0}  # of steps of 30 deg/s
FREE = {"ATC_STR_RAT_MAX": 120.0, "ATC_TURN_MAX_G": 0.6, "ATC_STR_ACC_MAX": 120.0}


def drawn_rover(rng: np.random.Generator, folder: Path) -> tuple[Path, float]:
    """(variant file, speed [m/s])."""
    text = (VARIANTS / "nominal.toml").read_text(encoding="utf-8")
    soft = rng.uniform(0.7, 1.4)
    changed = {
        "rad_per_us": 0.00095 * rng.uniform(0.7, 1.3),
        "front_cornering_stiffness": 31.0 * soft,
        "rear_cornering_stiffness": 33.5 * soft,
        "servo_lag": rng.uniform(0.015, 0.06),
        "servo_delay": rng.uniform(0.01, 0.04),
        "steering_trim_us": round(1500 + rng.uniform(-20, 20)),
    }
    for name, value in changed.items():
        text = re.sub(rf"(?m)^{name} = \S+", f"{name} = {value:.5g}", text)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "rover.toml"
    path.write_text(text, encoding="utf-8")
    return path, float(rng.uniform(1.8, 3.0))


def cases(first: SteeringCheck, limit: str, variant: Path) -> dict[str, dict[str, float]]:
    """{case: parameters} for a rover, from its drive with the defaults."""
    assert first.response is not None
    loop = first.autopilot
    family = Family((first.response.plant(loop),), (1.0,), loop)
    tuned = design_gains(family, loop.gains, unbounded(loop.gains))
    assert tuned is not None
    too_much = max(tuned.p, 0.1)
    while not _swings(loop, replace(tuned, p=too_much), variant):
        too_much *= 1.1
    sets = {
        "tuned": tuned,
        "half": replace(tuned, ff=tuned.ff / 2),
        "double": replace(tuned, ff=2 * tuned.ff),
        "swings": replace(tuned, p=PAST_LIMIT * too_much),
        "limit": tuned,
    }
    made = {name: {**gains.parameters, **FREE} for name, gains in sets.items()}
    made["limit"][limit] = LIMITS[limit]
    return made


def _swings(loop: Autopilot, gains: Gains, variant: Path) -> bool:
    """Whether the turn rate still swings long after a step, on the plant without the firmware."""
    t, rate, _ = on_the_plant(loop, gains, STEP, variant)
    return bool(np.std(rate[t > t[-1] - 1.0]) > 0.1 * STEP)


def check(log: Path, segment: Segment) -> SteeringCheck:
    """Of the part of the log that a segment drove."""
    parts = read_controllers(log).steering
    return check_steering(next(p for p in parts if p.t[0] <= segment.start + 1.0 <= p.t[-1]))


def rover(binary: Path, folder: Path, number: int, speedup: float) -> tuple[Path, list[Segment], int]:
    """(log of the cases, their segments, how many were right) of one drawn rover."""
    rng = np.random.default_rng(number)
    variant, speed = drawn_rover(rng, folder)
    limit = list(LIMITS)[number % len(LIMITS)]
    for name in ("first", "cases"):
        (folder / name).mkdir(exist_ok=True)
    log, told, _ = drive(binary, folder / "first", {"defaults": {}}, SHORT, speedup, speed, variant)
    sets = cases(check(log, told[0]), limit, variant)
    log, told, _ = drive(binary, folder / "cases", sets, SHORT, speedup, speed, variant)
    right = 0
    for segment in told:
        found = check(log, segment)
        names = [f.name for f in found.findings]
        wanted = EXPECTED[segment.name]
        good = names[:1] == [wanted] if wanted else not names
        right += good
        advice = "; ".join(f"{f.name}, {f.parameter} {f.now:.3g} -> {f.value:.3g}" for f in found.findings)
        share = found.achieved.rms / found.achieved.target_rms
        swings = f"{found.oscillation.hz:.1f} Hz" if found.oscillation else "-"
        print(
            f"{number} {found.speed:.2f} m/s {segment.name:7s} {'right' if good else 'WRONG'} "
            f"error {100 * share:3.0f} % lag {found.achieved.lag:.2f} s overshoot "
            f"{found.achieved.overshoot:3.0f} % {swings:6s} {advice or 'nothing'}",
            flush=True,
        )
    return log, told, right


def keep(log: Path, told: list[Segment], folder: Path) -> None:
    """What the tests replay: the last part of each drive from the log, and that of "half" from the tlog."""
    folder.mkdir(parents=True, exist_ok=True)
    spans = [(s.start + KEPT_FROM, s.start + SHORT.length) for s in told]
    (folder / "check.BIN").write_bytes(kept(log.read_bytes(), ("PIDS", "THR"), *spans))
    entries = [{"name": s.name, "start_s": s.start, "parameters": dict(s.parameters)} for s in told]
    (folder / "check.json").write_text(json.dumps({"segments": entries}, indent=1) + "\n", encoding="utf-8")
    half = next(s for s in told if s.name == "half")
    tlog = (log.parents[2] / "drive.tlog").read_bytes()
    (folder / "half.tlog").write_bytes(_kept_frames(tlog, half.start, half.start + SHORT.length))


def _kept_frames(tlog: bytes, start: float, end: float) -> bytes:
    """The telemetry of the drive from start to end [s since boot], and all parameters of the loop before."""
    from pymavlink.dialects.v20 import ardupilotmega

    parser, out, now, at = ardupilotmega.MAVLink(None), [], 0.0, 0
    while at < len(tlog):
        magic, size, flags = tlog[at + 8 : at + 11]
        size += 8 if magic == 0xFE else 25 if flags & 1 else 12
        frame = tlog[at : at + 8 + size]
        message = parser.decode(bytearray(frame[8:]))
        name = message.get_type()
        now = getattr(message, "time_boot_ms", 1000 * now) / 1000
        if (name == "PARAM_VALUE" and message.param_id.startswith(PARAMETERS) and now < end) or (
            name in FRAMES and start <= now <= end
        ):
            out.append(frame)
        at += len(frame)
    return b"".join(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ardurover", help="the SITL program (else $ROVER_SWEEP_ARDUROVER or the PATH)")
    parser.add_argument("--rovers", type=int, default=5)
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--out", type=Path, help="keep everything of the drives in this folder")
    parser.add_argument("--keep", type=Path, help="write what the tests replay into this folder")
    options = parser.parse_args()
    binary, right = find_ardurover(options.ardurover), 0
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(options.rovers):
            folder = (options.out or Path(scratch)) / str(number)
            log, told, good = rover(binary, folder, number, options.speedup)
            right += good
            if options.keep and number == 0:
                keep(log, told, options.keep)
    print(f"{right} of {options.rovers * len(EXPECTED)} drives judged right")


if __name__ == "__main__":
    main()
