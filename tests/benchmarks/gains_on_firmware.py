"""Proposed gains on the real firmware: a turn-rate profile in ACRO mode, defaults against the proposal.

    python tests/benchmarks/gains_on_firmware.py --ardurover FILE [--out DIR] [--keep DIR]

Identifies the rover from tests/data/ardurover-4.6.3/nominal, proposes gains for it, and drives the same
profile (steps of 30 deg/s, a slow sine, 2.5 m/s, by RC override) twice on the firmware with the same plant
behind it: with the firmware's own default gains, and with the proposed ones, which are set over MAVLink
between the two. Prints the tracking error (RMS of PIDS.Tar - PIDS.Act), the mean step seen, and the
predicted ones. --keep writes the part of the log that `tests/gains` replays.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import math
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[1] / "gains"))

from acro_drive import (
    ACRO,
    ACRO_RATE,
    CRUISE_THROTTLE,
    LENGTH,
    SPEED,
    Segment,
    judge,
    kept,
    predicted,
    profile,
)

import rover_sweep as rs
from firmware_params.check import read, shipped
from rover_sweep.gains.firmware import DEFAULTS, Autopilot, Gains, autopilot
from rover_sweep.gains.identified import from_identification
from rover_sweep.gains.proposal import Proposal, propose
from rover_sweep.report.document import identification_document
from rover_sweep.vehicle.controls import pump
from rover_sweep.vehicle.link import Link, Refused
from rover_sweep.vehicle.mavlink import constant
from rover_sweep.vehicle.parameters import read_all, write_all
from sitl.launcher import find_ardurover, start_ardurover

ROOT = Path(__file__).parents[2]
SETTINGS = {
    "ACRO_TURN_RATE": ACRO_RATE, "CRUISE_SPEED": SPEED, "CRUISE_THROTTLE": CRUISE_THROTTLE,
    "SCR_ENABLE": 0,
}  # fmt: skip
STRAIGHT = 6.0  # s, to reach the speed before a profile
READY_S = 120.0


def identified():  # type: ignore[no-untyped-def]
    """The identification of the nominal recordings, as `rover-sweep identify` makes it."""
    data = ROOT / "tests" / "data"
    nominal = data / "ardurover-4.6.3" / "nominal"
    runs = rs.read(*(nominal / f"run{n}.BIN" for n in (1, 2)), vehicle=data / "rover.toml")
    result = rs.identify(runs)
    return from_identification(identification_document(result, result.origin))


class Stick:
    """The pilot's sticks over RC override, in turn rate [rad/s] and share of full throttle."""

    def __init__(self, link: Link, parameters: Mapping[str, float]) -> None:
        self.link, self.parameters = link, parameters
        self.rate, self.throttle = 0.0, 0.0
        self.start: float | None = None
        link.every(0.02, self.send)

    def send(self) -> None:
        if self.start is not None:
            self.rate = profile(self.link.clock.now - self.start)
        channels = {1: self._pwm(1, math.degrees(self.rate) / ACRO_RATE), 3: self._pwm(3, self.throttle)}
        fields = {f"chan{n}_raw": channels.get(n, 0xFFFF) for n in range(1, 17)}
        self.link.to_vehicle("RC_CHANNELS_OVERRIDE", **fields, chan17_raw=0, chan18_raw=0)

    def _pwm(self, channel: int, share: float) -> int:
        """Out of RC_Channel::pwm_to_angle_dz: the dead zone lies between trim and the first movement."""
        trim, end, dead = (self.parameters[f"RC{channel}_{k}"] for k in ("TRIM", "MAX", "DZ"))
        return (
            round(trim + math.copysign(dead, share) + share * (end - trim - dead)) if share else round(trim)
        )


def drive(binary: Path, folder: Path, proposed: Gains) -> tuple[Path, list[Segment], Autopilot]:
    """(log, segments, the loop it flew) of both profiles on the firmware."""
    settings = folder / "settings.param"
    settings.write_text("".join(f"{n} {v:g}\n" for n, v in SETTINGS.items()), encoding="ascii")
    with (
        start_ardurover(binary, folder / "vehicle", defaults=[shipped("identification"), settings]) as rover,
        Link.open(rover.connection, folder / "drive.tlog") as link,
    ):
        pump(link, 10.0, 60.0)
        have = read_all(link)
        loop = autopilot(have)
        flown = loop.gains.parameters
        assert all(math.isclose(v, DEFAULTS[n], rel_tol=1e-6) for n, v in flown.items()), flown
        link.require("send attitude", "MAV_CMD_SET_MESSAGE_INTERVAL", float(30), 20_000.0)
        stick = Stick(link, have)
        _arm(link)
        stick.throttle = CRUISE_THROTTLE / 100
        told = [_profile(link, stick, "defaults", loop.gains.parameters)]
        write_all(link, proposed.parameters)
        told.append(_profile(link, stick, "proposed", proposed.parameters))
        stick.throttle = 0.0
        pump(link, 3.0, 20.0)
        link.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
        pump(link, 1.0)
    return max((folder / "vehicle" / "logs").glob("*.BIN")), told, loop


def _arm(link: Link) -> None:
    """ACRO and armed, once the estimator is ready."""
    started = link.clock.now
    wanted = constant("EKF_VELOCITY_HORIZ") | constant("EKF_POS_HORIZ_ABS")
    while link.clock.now - started < READY_S:
        report = link.request_message("EKF_STATUS_REPORT")
        if report is not None and int(report.flags) & wanted == wanted:
            try:
                link.require("go into ACRO", "MAV_CMD_DO_SET_MODE", 1.0, float(ACRO))
                link.require("arm", "MAV_CMD_COMPONENT_ARM_DISARM", 1.0)
                return
            except Refused as refused:
                print(f"  {refused}", file=sys.stderr)
        pump(link, 2.0, 10.0)
    raise SystemExit("the rover did not arm")


def _profile(link: Link, stick: Stick, name: str, parameters: Mapping[str, float]) -> Segment:
    pump(link, STRAIGHT, 60.0)
    stick.start = start = link.clock.now
    pump(link, LENGTH + 0.5, 300.0)
    stick.start, stick.rate = None, 0.0
    return Segment(name, start, parameters)


def report(log: Path, told: list[Segment], proposal: Proposal, loop: Autopilot) -> None:
    """The figures."""
    assert proposal.now is not None and proposal.proposed is not None
    judged = {s.name: judge(log, s) for s in told}
    for segment, model in zip(told, (proposal.now, proposal.proposed), strict=True):
        seen, expected = judged[segment.name], predicted(proposal, loop, model.gains)
        g, margins = model.gains, model.margins
        first, second = seen.overshoots
        print(f"{segment.name}: FF {g.ff:g} P {g.p:g} I {g.i:g} D {g.d:g} IMAX {g.imax:g}")
        print(
            f"  by the model {margins.gain_db:.1f} dB, {margins.phase_deg:.0f} deg; worst "
            f"{model.worst_gain[0]:.1f} dB, {model.worst_phase[0]:.0f} deg"
        )
        print(f"  at {seen.speed:.2f} m/s a tracking error of {math.degrees(seen.rms):.2f} deg/s rms")
        print(
            f"  overshoot {seen.step.overshoot:.1f} % (each half {first:.1f}, {second:.1f}), predicted "
            f"{expected.overshoot:.1f} %; rise {seen.step.rise:.3f} s, predicted {expected.rise:.3f} s; "
            f"settling {seen.step.settling:.2f} s, predicted {expected.settling:.2f} s"
        )
    ratio = judged["defaults"].rms / judged["proposed"].rms
    print(f"tracking error {ratio:.1f} times smaller with the proposed gains")


def keep(log: Path, told: list[Segment], folder: Path) -> None:
    """The part of the log that the tests replay, and its segments."""
    folder.mkdir(parents=True, exist_ok=True)
    first, last = told[0].start - 1.0, told[-1].start + LENGTH + 1.0
    wanted = ("PIDS", "STER", "THR", "RCOU")
    (folder / "acro.BIN").write_bytes(kept(log.read_bytes(), wanted, first, last))
    entries = [{"name": s.name, "start_s": s.start, "parameters": dict(s.parameters)} for s in told]
    (folder / "acro.json").write_text(json.dumps({"segments": entries}, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ardurover", help="the SITL program (else $ROVER_SWEEP_ARDUROVER or the PATH)")
    parser.add_argument("--out", type=Path, help="keep everything of the drive in this folder")
    parser.add_argument("--keep", type=Path, help="write what the tests replay into this folder")
    options = parser.parse_args()
    binary, begun = find_ardurover(options.ardurover), time.monotonic()
    folder = options.out or Path(tempfile.mkdtemp(prefix="gains-"))
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {p.name: p.value for p in read(shipped())}
    proposal = propose(identified(), autopilot(wanted), SPEED)
    assert proposal.proposed is not None, proposal.support
    log, told, loop = drive(binary, folder, proposal.proposed.gains)
    report(log, told, proposal, loop)
    print(f"{time.monotonic() - begun:.0f} s in all")
    if options.keep:
        keep(log, told, options.keep)
    if not options.out:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
