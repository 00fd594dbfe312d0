"""Draws a log: rover, driving, logging profile, a fault or none. The same seed and number: the same log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from tests.engines.engine import EngineRover
from tests.recordings.autopilot_logs import applet_bin, factory_bin, telemetry
from tests.recordings.faults import BY_NAME, FAULTS, Fault
from tests.recordings.foreign_logs import FOREIGN
from tests.recordings.pilots import LIMIT_US, NEUTRAL, PILOTS, Piloted, piloted, road
from tests.recordings.rovers import SHARES, Truth, drawn_engine, physics, true_numbers
from tests.recordings.signals import Recorded, instrumented

Writer = Callable[[Recorded, Path, Generator], str]
PROFILES: dict[str, float] = {
    "factory .BIN": 0.28, "applet .BIN": 0.08, "tlog 4 Hz": 0.05, "tlog 10 Hz": 0.08, "tlog 25 Hz": 0.04,
    "tlog 50 Hz": 0.03, **dict.fromkeys(FOREIGN, 0.05), "csv rostopic": 0.06, "ulog": 0.07, "ros": 0.06,
}  # fmt: skip
"""How often each profile is drawn, as shares of their sum."""
CLEAN = 0.45  # of the logs have no fault
TEN_MINUTES, LONG = 600.0, 0.6  # s, and the share of logs that are so long; others have 1.5 to 5 minutes
WITH_PARAMETERS, WHEELBASE_KNOWN, MIRRORED = 0.75, 0.4, 0.3
SWEEP = "sweep"


@dataclass(frozen=True)
class DrawnLog:
    """A log in a folder. sources: as `identify` takes them. wheelbase: if its owner gives it [m].

    steering: "us", "command" or "angle"; per: rad of one unit of a recorded angle.
    """

    seed: int
    number: int
    engine: str
    driving: str
    profile: str
    seconds: float
    fault: str
    left_out: bool
    sources: tuple[str, ...]
    wheelbase: float | None
    steering: str
    per: float
    truth: Truth

    def document(self) -> dict[str, Any]:
        """As plain data, without the place of the files."""
        return {name: value for name, value in asdict(self).items() if name != "sources"}


@dataclass(frozen=True)
class Wanted:
    """What is fixed of a log that is drawn: "" for anything, fault "none" for a log without one, seconds 0
    for any length."""

    fault: str = ""
    profile: str = ""
    driving: str = ""
    engine: str = ""
    seconds: float = 0.0


ANYTHING = Wanted()


def drawn_log(seed: int, number: int, folder: Path, wanted: Wanted = ANYTHING) -> DrawnLog:
    """Draws, drives and writes it into a folder of its own."""
    rng = np.random.default_rng([seed, number, 53])
    fault = _fault(rng, wanted)
    profile = _profile(rng, fault, wanted)
    kinds = fault.driving if fault and fault.driving else tuple(PILOTS)
    driving = wanted.driving or (
        SWEEP if profile == "applet .BIN" and SWEEP in kinds else str(rng.choice(kinds))
    )
    engines = fault.engines if fault and fault.engines else tuple(SHARES)
    name, rover = drawn_engine(rng, (wanted.engine,) if wanted.engine else engines)
    if profile in FOREIGN:  # no 4 Hz low-pass outside ArduPilot; what an IMU has inside
        filters = {"gyro_hz": float(rng.uniform(40, 90)), "accel_hz": float(rng.uniform(20, 60))}
        rover = rover.sensing(**filters)  # type: ignore[assignment]
    seconds = TEN_MINUTES if rng.uniform() < LONG else round(float(rng.uniform(90, 300)))
    seconds = wanted.seconds or seconds
    mirrored = bool(rng.uniform() < MIRRORED)
    drive = _driven(name, rover, driving, seconds, mirrored, fault, rng)
    if fault:
        drive = fault.of_drive(drive, rng)
    folder.mkdir(parents=True, exist_ok=True)
    sources = _written(drive, profile, folder, fault, rng)
    truth = true_numbers(name, rover, mirrored)
    steering, per = (
        ("us", 1.0) if profile not in FOREIGN else (FOREIGN[profile].steering, FOREIGN[profile].per)
    )
    known = truth.wheelbase if rng.uniform() < WHEELBASE_KNOWN else None
    return DrawnLog(
        seed, number, name, driving, profile, seconds, fault.name if fault else "",
        bool(fault and fault.left_out), sources, known, steering, per, truth,
    )  # fmt: skip


def _fault(rng: Generator, wanted: Wanted) -> Fault | None:
    clean, one = rng.uniform() < CLEAN, FAULTS[int(rng.integers(len(FAULTS)))]
    if wanted.fault:
        return BY_NAME.get(wanted.fault)
    return None if clean else one


def _profile(rng: Generator, fault: Fault | None, wanted: Wanted) -> str:
    allowed = [name for name in PROFILES if fault is None or name in fault.profiles]
    if fault and fault.driving and SWEEP not in fault.driving:  # the applet sweeps
        allowed = [name for name in allowed if name != "applet .BIN"]
    shares = np.array([PROFILES[name] for name in allowed])
    drawn = str(rng.choice(allowed, p=shares / shares.sum()))
    return wanted.profile or drawn


# ---- The drive, with what a fault makes of how it is driven.


def _driven(
    name: str,
    rover: EngineRover,
    driving: str,
    seconds: float,
    mirrored: bool,
    fault: Fault | None,
    rng: Generator,
) -> Recorded:
    how = fault.of_rover if fault else ""
    ground = road(rover, round(seconds * 1000), rng)
    drive = piloted(driving, rover, seconds, ground, rng)
    drive = WAYS[how](drive, rover, rng) if how in WAYS else drive
    command = drive.command(rover)
    if how == "saturated":  # the wheels' stops lie within the servo's way
        stop = 0.35 * rover.amplitude
        command = np.clip(command, -stop, stop)
    motion = physics(name).signals(rover, command, drive.wanted, ground, float(rng.uniform(-3, 3)))
    for channel, x in motion.items():
        if not np.all(np.isfinite(x)):
            raise ValueError(f"the drawn rover of {name} left the road: {channel} is not finite")
    found = instrumented(rover, drive, motion, mirrored, rng)
    if (
        how == "reversed"
    ):  # its owner turned the wrong parameter: the stick goes one way, the wheels the other
        parameters = {**found.parameters, "SERVO1_REVERSED": float(not mirrored)}
        found = replace(found.having(stick=2 * NEUTRAL - found.x["stick"]), parameters=parameters)
    return found


def _constant(drive: Piloted, rover: EngineRover, rng: Generator) -> Piloted:
    us = NEUTRAL + float(rng.choice([-1, 1]) * rng.uniform(0.3, 0.7)) * rover.amplitude / rover.rad_per_us
    held = np.full(drive.us.size, round(us), dtype=float)
    return replace(drive, us=held, stick=held)


def _saturated(drive: Piloted, rover: EngineRover, rng: Generator) -> Piloted:
    """Bang-bang: three quarters of the time at one end or the other."""
    us = NEUTRAL + np.clip(3.0 * (drive.us - NEUTRAL), -LIMIT_US, LIMIT_US)
    return replace(drive, us=np.round(us), stick=np.round(us))


def _backwards(drive: Piloted, rover: EngineRover, rng: Generator) -> Piloted:
    """A third of the time in reverse, slowly."""
    back = np.abs((np.arange(drive.wanted.size) * 0.001) % 45 - 20) < 7
    return replace(drive, wanted=np.where(back, -0.4 * drive.wanted, drive.wanted))


WAYS = {"constant": _constant, "saturated": _saturated, "reverse": _backwards}


# ---- The files.


def _writer(profile: str, rng: Generator) -> Writer:
    if profile in FOREIGN:
        return FOREIGN[profile].write
    if profile.startswith("tlog"):
        hz = float(profile.split()[1])
        return partial(telemetry, hz, bool(rng.uniform() < WITH_PARAMETERS))
    return applet_bin if profile == "applet .BIN" else factory_bin


def _written(
    drive: Recorded, profile: str, folder: Path, fault: Fault | None, rng: Generator
) -> tuple[str, ...]:
    write = _writer(profile, rng)
    if fault and fault.halves:
        parts = [(folder / name, second) for name, second in (("first", False), ("second", True))]
        for place, _ in parts:
            place.mkdir(exist_ok=True)
        return tuple(write(drive.half(second), place, rng) for place, second in parts)
    source = write(drive, folder, rng)
    if fault and fault.of_file:
        path = Path(source)
        path.write_bytes(fault.of_file(path.read_bytes(), rng))
    return (source,)
