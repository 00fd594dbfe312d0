"""A turn-rate profile in ACRO mode: the profile itself, the drive on the firmware, and what its log says.

`drive` needs ArduRover's SITL program; `judge` reads any log that it has left.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rover_sweep.gains.firmware import Autopilot, Gains
from rover_sweep.gains.proposal import Proposal, family_of
from rover_sweep.gains.step import BEFORE, Step, driven_step, measured_step
from rover_sweep.identify.recording import Array
from rover_sweep.logs.dataflash import open_dataflash

ACRO = 1  # custom_mode of Rover
SPEED = 2.5  # m/s
STEP = math.radians(30)
STEP_S, PAUSE_S, SINE_S, SINE_HZ = 3.0, 2.0, 16.0, 0.25
STEPS = 8
LENGTH = STEPS * (STEP_S + PAUSE_S) + SINE_S
ACRO_RATE = 90.0  # deg/s at full stick
CRUISE_THROTTLE = 52.0  # percent that give SPEED on the nominal plant


def profile(t: float) -> float:
    """Turn rate [rad/s] asked for t [s] after the start: steps left and right, then a slow sine."""
    if not 0 <= t < LENGTH:
        return 0.0
    number, within = divmod(t, STEP_S + PAUSE_S)
    if number < STEPS:
        return (-1.0) ** number * STEP if within < STEP_S else 0.0
    return STEP * math.sin(2 * math.pi * SINE_HZ * (t - STEPS * (STEP_S + PAUSE_S)))


@dataclass(frozen=True)
class Segment:
    """One profile: where it starts on the log's clock [s], and the gains flown."""

    name: str
    start: float
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Tracking:
    """rms: of target - turn rate over the profile [rad/s]; step: mean of its steps; overshoots [%] of each
    half of them, which tells how sure the mean is; speed [m/s]."""

    rms: float
    step: Step
    overshoots: tuple[float, float]
    speed: float


def judge(log: Path, segment: Segment) -> Tracking:
    """What the log says of a segment: PIDS.Tar and PIDS.Act [rad/s], once a main loop."""
    flash = open_dataflash(log)
    t = flash.seconds("PIDS") - segment.start
    target, rate = flash.column("PIDS", "Tar"), flash.column("PIDS", "Act")
    inside = (t >= 0) & (t < LENGTH)
    rms = float(np.sqrt(np.mean((target - rate)[inside] ** 2)))
    clock, traces = _steps(t, target, rate)
    halves = (traces[::2], traces[1::2])
    first, second = (_mean_step(clock, half).overshoot for half in halves)
    return Tracking(rms, _mean_step(clock, traces), (first, second), _speed(log, segment))


def predicted(proposal: Proposal, loop: Autopilot, gains: Gains) -> Step:
    """The step of the profile on the identified model."""
    family = family_of(replace(proposal.found, intervals={}), loop, proposal.speed)
    driven = driven_step(loop, family.nominal, family.angle_per_output[0], gains, STEP)
    return measured_step(driven.t - BEFORE, driven.target, driven.rate[:, 0], STEP)


def segments(path: Path) -> dict[str, Segment]:
    """Those of the .json beside a log."""
    entries = json.loads(path.read_text(encoding="utf-8"))["segments"]
    return {e["name"]: Segment(e["name"], e["start_s"], e["parameters"]) for e in entries}


def _mean_step(t: Array, traces: Array) -> Step:
    target, rate = traces.mean(axis=0)
    return measured_step(t, target, rate, STEP)


def _steps(t: Array, target: Array, rate: Array) -> tuple[Array, Array]:
    """(clock (m,) from each asking, (n, 2, m) target and rate), all turned to the right."""
    period = float(np.median(np.diff(t)))
    clock = np.arange(-0.2, STEP_S - 0.05, period)
    out = []
    for k in range(STEPS):
        around = np.abs(t - k * (STEP_S + PAUSE_S)) < 0.5
        moving = t[around & (np.abs(target) > 1e-3)]
        sign, asked = (-1.0) ** k, float(moving[0]) - period  # the target moves in the loop after the asking
        out.append([sign * np.interp(clock + asked, t, x) for x in (target, rate)])
    return clock, np.array(out)


def _speed(log: Path, segment: Segment) -> float:
    flash = open_dataflash(log)
    t = flash.seconds("THR") - segment.start
    return float(np.mean(flash.column("THR", "Speed")[(t >= 0) & (t < LENGTH)]))


def kept(log: bytes, names: tuple[str, ...], start: float, end: float) -> bytes:
    """The log with these messages alone, between two times [s]; formats and parameters are all kept."""
    import tempfile

    with tempfile.NamedTemporaryFile(suffix=".BIN") as file:
        file.write(log)
        file.flush()
        flash = open_dataflash(file.name)
        chosen: list[tuple[int, int]] = []
        for name, layout in flash.formats.items():
            if name not in (*names, "FMT", "PARM", "MSG"):
                continue
            at = flash.positions.get(name, np.empty(0, np.int64))
            if name in names:
                seconds = flash.seconds(name)
                at = at[(seconds >= start) & (seconds <= end)]
            chosen += [(int(p), layout.length) for p in at]
    return b"".join(log[p : p + length] for p, length in sorted(chosen))
