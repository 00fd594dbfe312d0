"""A turn-rate profile in ACRO mode: the profile itself, and what the log of a drive says of it.

The drive is in `acro_on_firmware.py`, which needs ArduRover's SITL program.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import BEFORE, Step, limited_target, simulated_step, step_metrics
from rover_sweep.gains.proposal import Proposal, family_of
from rover_sweep.gains.steering_chain import Autopilot, Gains
from rover_sweep.logs.readers.dataflash import index

STEP = math.radians(30)
STEP_S, PAUSE_S, SINE_HZ = 3.0, 2.0, 0.25
EACH = STEP_S + PAUSE_S


@dataclass(frozen=True)
class Profile:
    """Steps of STEP right and left in turn, each followed by a pause, then a sine of sine_s seconds."""

    steps: int = 8
    sine_s: float = 16.0

    @property
    def length(self) -> float:
        return self.steps * EACH + self.sine_s

    def rate(self, t: float) -> float:
        """Turn rate [rad/s] asked for t [s] after the start."""
        if not 0 <= t < self.length:
            return 0.0
        number, within = divmod(t, EACH)
        if number < self.steps:
            return (-1.0) ** number * STEP if within < STEP_S else 0.0
        return STEP * math.sin(2 * math.pi * SINE_HZ * (t - self.steps * EACH))


FULL = Profile()


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


def judge(log: Path, segment: Segment, profile: Profile = FULL) -> Tracking:
    """What the log says of a segment: PIDS.Tar and PIDS.Act [rad/s], once a main loop."""
    flash = index(np.fromfile(log, np.uint8))
    t = flash.seconds("PIDS") - segment.start
    target, rate = flash.column("PIDS", "Tar"), flash.column("PIDS", "Act")
    inside = (t >= 0) & (t < profile.length)
    rms = float(np.sqrt(np.mean((target - rate)[inside] ** 2)))
    clock, traces = _steps(t, target, rate, profile.steps)
    first, second = (_mean_step(clock, half).overshoot for half in (traces[::2], traces[1::2]))
    at = flash.seconds("THR") - segment.start
    speed = flash.column("THR", "Speed")[(at >= 0) & (at < profile.length)]
    return Tracking(rms, _mean_step(clock, traces), (first, second), float(np.mean(speed)))


def predicted(proposal: Proposal, loop: Autopilot, gains: Gains, speed: float | None = None) -> Step:
    """The step of the profile on the identified model at a speed [m/s], that of the proposal if None."""
    family = family_of(replace(proposal.found, intervals={}), loop, speed or proposal.speed)
    driven = simulated_step(loop, family.nominal, family.angle_per_output[0], gains, STEP)
    return step_metrics(driven.t - BEFORE, driven.target, driven.rate[:, 0], STEP)


def limited_targets(loop: Autopilot, speed: float, wanted: Array) -> Array:
    """The firmware's limited target (m,) for a requested turn rate (m,) [rad/s], one value per main loop."""
    out, now = np.empty_like(wanted), 0.0
    for k, want in enumerate(wanted):
        now = out[k] = limited_target(loop, speed, float(want), now)
    return out


def segments(path: Path) -> dict[str, Segment]:
    """Those of the .json beside a log."""
    entries = json.loads(path.read_text(encoding="utf-8"))["segments"]
    return {e["name"]: Segment(e["name"], e["start_s"], e["parameters"]) for e in entries}


def kept(log: bytes, names: tuple[str, ...], *spans: tuple[float, float]) -> bytes:
    """The log with these messages alone, within spans (start, end) [s]; all formats, parameters and texts."""
    with tempfile.NamedTemporaryFile(suffix=".BIN") as file:
        file.write(log)
        file.flush()
        flash = index(np.fromfile(file.name, np.uint8))
        chosen: list[tuple[int, int]] = []
        for name in {*names, "FMT", "PARM", "MSG"} & flash.formats.keys():
            at = flash.positions(name)
            if name in names:
                seconds = flash.seconds(name)
                at = at[np.any([(seconds >= start) & (seconds <= end) for start, end in spans], axis=0)]
            chosen += [(int(p), flash.formats[name].length) for p in at]
    return b"".join(log[p : p + length] for p, length in sorted(chosen))


def _mean_step(t: Array, traces: Array) -> Step:
    target, rate = traces.mean(axis=0)
    return step_metrics(t, target, rate, STEP)


def _steps(t: Array, target: Array, rate: Array, count: int) -> tuple[Array, Array]:
    """(clock (m,) from each asking, (n, 2, m) target and rate), all turned to the right."""
    period = float(np.median(np.diff(t)))
    clock = np.arange(-0.2, STEP_S - 0.1, period)
    out = []
    for k in range(count):
        near = (t > k * EACH - 0.05) & (t < k * EACH + 0.5)
        moving = t[near & (np.abs(target) > 1e-3)]
        sign, asked = (-1.0) ** k, float(moving[0])  # the loop of the asking is the first in which it moves
        out.append([sign * np.interp(clock + asked, t, x) for x in (target, rate)])
    return clock, np.array(out)
