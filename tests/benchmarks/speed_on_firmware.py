"""The proposed speed loop on the real firmware: a speed profile in GUIDED mode, defaults against the
proposal.

    python tests/benchmarks/speed_on_firmware.py --ardurover FILE [--sweep LOG.BIN] [--variant FILE] [--out
    DIR]

Takes a throttle sweep that was driven on the firmware (default tests/data/ardurover-4.6.3/throttle/sweep.BIN,
by `rover-sweep run --simulator ardurover --throttle-sweep 60`), identifies the speed and proposes the speed
loop. Then drives the same profile (4 steps up and 4 down, a slow sine; by SET_POSITION_TARGET_LOCAL_NED)
three times with the same plant: the firmware's defaults, the proposal, and the proposal with the default
ATC_ACCEL_MAX. Prints the error of the speed to the firmware's limited target (PIDA.Tar - PIDA.Act) and to
the commanded speed, and overshoot and rise of the mean step up, measured and predicted. Some 6 minutes.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.remove(str(Path(__file__).parent))  # its coverage.py hides the library of that name

from firmware_params.param_files import shipped
from rover_sweep.api.speed import speed_findings, speed_gains, throttle_sweeps, write_speed_report
from rover_sweep.gains.speed_chain import (
    BEFORE,
    SPEED_DEFAULTS,
    SpeedSettings,
    SpeedStep,
    speed_step_metrics,
    step_ends,
    step_of_speed,
)
from rover_sweep.gains.speed_proposal import SpeedProposal
from rover_sweep.identification.identify_speed import identify_speed
from rover_sweep.logs.readers.dataflash import index
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import read_all, write_parameter
from rover_sweep.vehicle.run.controls import pump
from sitl.launcher import find_ardurover, start_ardurover
from tests.ardurover.arming import arm_in_mode

SWEEP = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "throttle" / "sweep.BIN"
GUIDED = 15  # custom_mode of Rover
BODY = 8  # MAV_FRAME_BODY_NED
SPEED_ONLY = 0b0000_0101_1100_0111  # type_mask: velocity and yaw rate count
STEPS, STEP_S, SINE_S, SINE_HZ = 4, 8.0, 20.0, 0.1
SETTLE_S = 8.0


@dataclass(frozen=True)
class Profile:
    """Steps from `start` by `size` [m/s] up and down in turn, then a sine between the two."""

    start: float
    size: float

    @property
    def length(self) -> float:
        return 2 * STEPS * STEP_S + SINE_S

    def speed(self, t: float) -> float:
        """Commanded speed [m/s] at t [s] after the begin."""
        if t < 0 or t >= self.length:
            return self.start
        if t < 2 * STEPS * STEP_S:
            return self.start + (self.size if int(t // STEP_S) % 2 == 0 else 0.0)
        return self.start + self.size * 0.5 * (1 - math.cos(2 * math.pi * SINE_HZ * t))


@dataclass(frozen=True)
class Segment:
    """One profile: where it starts on the log's clock [s]; the settings driven."""

    name: str
    start: float
    settings: SpeedSettings


class Commander:
    """Sends the commanded speed, 20 times a second."""

    def __init__(self, link: Link, profile: Profile) -> None:
        self.link, self.profile, self.begun = link, profile, math.inf
        self.standing = True
        link.every(0.05, self.send)

    def send(self) -> None:
        """The speed as it is now."""
        speed = 0.0 if self.standing else self.profile.speed(self.link.clock.now - self.begun)
        numbers = dict.fromkeys(("x", "y", "z", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
        self.link.to_vehicle(
            "SET_POSITION_TARGET_LOCAL_NED",
            time_boot_ms=0,
            coordinate_frame=BODY,
            type_mask=SPEED_ONLY,
            vx=speed,
            **numbers,
        )


def drive(binary: Path, folder: Path, proposal: SpeedProposal, variant: str) -> tuple[Path, list[Segment]]:
    """(log, segments) of the profile with the defaults, the proposal, and it with the default
    acceleration.
    """
    assert proposal.proposed is not None
    best = proposal.proposed.settings
    profile = Profile(*step_ends(proposal.found))
    settings = folder / "settings.param"
    settings.write_text("SCR_ENABLE 0\nWP_SPEED 5\n", encoding="ascii")  # else CRUISE_SPEED limits GUIDED
    with (
        start_ardurover(
            binary, folder / "vehicle", variant=variant, defaults=[shipped("identification"), settings]
        ) as rover,
        Link.open(rover.connection, folder / "drive.tlog") as link,
    ):
        pump(link, 10.0, 60.0)
        first = _flown(read_all(link))
        link.require("send attitude", "MAV_CMD_SET_MESSAGE_INTERVAL", float(30), 20_000.0)
        commander = Commander(link, profile)
        arm_in_mode(link, GUIDED, "GUIDED")
        told = []
        slower = replace(best, accel_max=first.accel_max)
        for name, wanted in (("defaults", first), ("proposed", best), ("proposed, default accel", slower)):
            for parameter, value in wanted.parameters.items():
                write_parameter(link, parameter, value)
            if proposal.throttle_min is not None and name != "defaults":
                write_parameter(link, "MOT_THR_MIN", proposal.throttle_min)
            commander.standing = False
            pump(link, SETTLE_S, 60.0)
            commander.begun = link.clock.now
            pump(link, profile.length + 0.5, 300.0)
            told.append(Segment(name, commander.begun, wanted))
            commander.begun, commander.standing = math.inf, True
            pump(link, 6.0, 30.0)
        link.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
        pump(link, 1.0)
    return max((folder / "vehicle" / "logs").glob("*.BIN")), told


def _flown(have: Mapping[str, float]) -> SpeedSettings:
    names = ("CRUISE_SPEED", "CRUISE_THROTTLE", "ATC_SPEED_P", "ATC_SPEED_I", "ATC_SPEED_D", "ATC_ACCEL_MAX")
    for name in names:
        assert math.isclose(have[name], SPEED_DEFAULTS[name], rel_tol=1e-6), (name, have[name])
    return SpeedSettings(*(have[name] for name in names))


@dataclass(frozen=True)
class Tracking:
    """error, behind: rms of limited target - speed and commanded - speed over the profile [m/s]; step: the
    mean of the steps up; overshoots: of each [%]."""

    error: float
    behind: float
    step: SpeedStep
    overshoots: tuple[float, ...]


def judge(log: Path, segment: Segment, profile: Profile) -> Tracking:
    """What the log says of a segment: PIDA.Tar and PIDA.Act [m/s], once a main loop."""
    flash = index(np.fromfile(log, np.uint8))
    stamps = flash.seconds("PIDA")
    kept = (stamps >= segment.start - 1) & (stamps < segment.start + profile.length)
    t = stamps[kept] - segment.start
    target, speed = flash.column("PIDA", "Tar")[kept], flash.column("PIDA", "Act")[kept]
    wanted = np.array([profile.speed(x) for x in t])
    inside = t >= 0
    error, behind = (float(np.sqrt(np.mean((x - speed)[inside] ** 2))) for x in (target, wanted))
    clock = np.arange(-BEFORE, STEP_S - BEFORE - 0.1, float(np.median(np.diff(t))))
    traces = []
    for k in range(0, 2 * STEPS, 2):
        near = (t > k * STEP_S - 0.1) & (t < k * STEP_S + 0.5)
        at = float(t[near & (target > profile.start + 1e-3)][0])  # the command arrives in one main loop
        traces.append([np.interp(clock + at, t, x) for x in (target, speed)])
    mean = np.mean(traces, axis=0)
    command = np.where(clock >= 0, profile.start + profile.size, profile.start)
    overshoots = (100 * (np.max(s) - profile.start - profile.size) / profile.size for _, s in traces)
    return Tracking(error, behind, speed_step_metrics(clock, *mean, command), tuple(overshoots))


def report(log: Path, told: list[Segment], proposal: SpeedProposal) -> None:
    """The figures."""
    assert proposal.found.plant is not None
    profile = Profile(*step_ends(proposal.found))
    seen = [judge(log, segment, profile) for segment in told]
    for segment, found in zip(told, seen, strict=True):
        s = segment.settings
        loop = proposal.loop if segment is told[0] or proposal.tuned is None else proposal.tuned
        expected = step_of_speed(loop, proposal.found.plant, s, profile.start, profile.size)
        print(f"{segment.name}: {' '.join(f'{n} {v:g}' for n, v in s.parameters.items())}")
        print(
            f"  error to the limited target {found.error:.3f} m/s rms, to the commanded speed "
            f"{found.behind:.3f} m/s rms"
        )
        print(
            f"  step of {profile.size:.2f} m/s: overshoot {found.step.overshoot:.1f} % (each "
            f"{', '.join(f'{x:.1f}' for x in found.overshoots)}), predicted {expected.overshoot:.1f} %; rise "
            f"{found.step.rise:.2f} s, predicted {expected.rise:.2f} s; error {found.step.error:.3f} m/s, "
            f"predicted {expected.error:.3f}"
        )
    for other, name in ((seen[1], "the proposal"), (seen[2], "the proposal with the default ATC_ACCEL_MAX")):
        print(
            f"{name}: error to the limited target {seen[0].error / other.error:.2f} times smaller, to the "
            f"commanded speed {seen[0].behind / other.behind:.2f} times smaller"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ardurover", help="the SITL program (else $ROVER_SWEEP_ARDUROVER or the PATH)")
    parser.add_argument("--sweep", type=Path, default=SWEEP, help="a log with a throttle sweep")
    parser.add_argument("--variant", default="nominal", help="the plant, that of the sweep")
    parser.add_argument("--out", type=Path, help="keep everything of the drive in this folder")
    options = parser.parse_args()
    binary, begun = find_ardurover(options.ardurover), time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        result = identify_speed(throttle_sweeps([str(options.sweep)]))
        written = write_speed_report(speed_findings(result, folder), folder)
        proposal = speed_gains(written.document, {}, "the sweep's log")
        assert proposal.proposed is not None, proposal.reasons
        log, told = drive(binary, folder, proposal, options.variant)
        kept = [{"name": s.name, "start_s": s.start, "settings": s.settings.parameters} for s in told]
        (folder / "segments.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        report(log, told, proposal)
    print(f"{time.monotonic() - begun:.0f} s in all")


if __name__ == "__main__":
    main()
