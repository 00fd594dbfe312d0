"""Proposed gains on the real firmware: a turn-rate profile in ACRO mode, defaults against the proposal.

    python tests/benchmarks/gains_on_firmware.py --ardurover FILE [--speed M/S] [--out DIR] [--keep DIR]

Identifies the rover from tests/data/ardurover-4.6.3/nominal, proposes gains for it, and drives the same
profile (steps of 30 deg/s, a slow sine, 2.5 m/s, by RC override) twice on the firmware with the same plant
behind it: with the firmware's own default gains, and with the proposed ones, which are set over MAVLink
between the two. Prints the tracking error (RMS of PIDS.Tar - PIDS.Act), the mean step seen, and the
predicted ones. --speed drives at another speed with the gains for 2.5 m/s: the firmware's speed scale and the
range in which the gains are said to hold. --keep writes the part of the log that `tests/gains` replays. Some
3 minutes.
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
from pathlib import Path

sys.path.remove(str(Path(__file__).parent))  # its coverage.py hides the library of that name
sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[1] / "gains"))

from acro_drive import FULL, Segment, judge, kept, predicted
from acro_on_firmware import SPEED, drive

import rover_sweep as rs
from firmware_params.param_files import read, shipped
from rover_sweep.gains.identified import from_identification
from rover_sweep.gains.proposal import AssessedGains, Proposal, propose_gains
from rover_sweep.gains.steering_chain import Autopilot, autopilot
from rover_sweep.report.identification.identification_json import identification_document
from sitl.launcher import find_ardurover

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"


def proposed() -> Proposal:
    """For the nominal recordings, as `rover-sweep gains` makes it after as many steps as it takes."""
    names = ("run1", "run2", "run4")
    runs = rs.read(*(NOMINAL / f"{name}.BIN" for name in names), vehicle=DATA / "rover.toml")
    result = rs.identify(runs)
    found = from_identification(identification_document(result, result.origin))
    return propose_gains(found, autopilot({p.name: p.value for p in read(shipped())}), SPEED, at_once=True)


def report(log: Path, told: list[Segment], proposal: Proposal, loop: Autopilot) -> None:
    """The figures."""
    assert proposal.now is not None and proposal.proposed is not None
    rms = []
    for segment, model in zip(told, (proposal.now, proposal.proposed), strict=True):
        rms.append(_reported(log, segment, model, proposal, loop))
    print(f"the tracking error is {rms[0] / rms[1]:.1f} times smaller with the proposed gains")


def _reported(
    log: Path, segment: Segment, model: AssessedGains, proposal: Proposal, loop: Autopilot
) -> float:
    seen = judge(log, segment)
    expected = predicted(proposal, loop, model.gains, seen.speed)
    g, margins, (first, second) = model.gains, model.margins, seen.overshoots
    print(f"{segment.name}: FF {g.ff:g} P {g.p:g} I {g.i:g} D {g.d:g} IMAX {g.imax:g}")
    print(
        f"  by the model {margins.gain_db:.1f} dB, {margins.phase_deg:.0f} deg; worst "
        f"{model.worst_gain[0]:.1f} dB, {model.worst_phase[0]:.0f} deg"
    )
    print(f"  at {seen.speed:.2f} m/s a tracking error of {math.degrees(seen.rms):.2f} deg/s rms")
    print(
        f"  overshoot {seen.step.overshoot:.1f} % (to either side {first:.1f}, {second:.1f}), predicted "
        f"{expected.overshoot:.1f} %; rise {seen.step.rise:.3f} s, predicted {expected.rise:.3f} s; "
        f"settling {seen.step.settling:.2f} s, predicted {expected.settling:.2f} s"
    )
    return seen.rms


def keep(log: Path, told: list[Segment], folder: Path) -> None:
    """The part of the log that the tests replay, and its segments."""
    folder.mkdir(parents=True, exist_ok=True)
    first, last = told[0].start - 1.0, told[-1].start + FULL.length + 1.0
    wanted = ("PIDS", "STER", "THR", "RCOU")
    (folder / "acro.BIN").write_bytes(kept(log.read_bytes(), wanted, (first, last)))
    entries = [{"name": s.name, "start_s": s.start, "parameters": dict(s.parameters)} for s in told]
    (folder / "acro.json").write_text(json.dumps({"segments": entries}, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ardurover", help="the SITL program (else $ROVER_SWEEP_ARDUROVER or the PATH)")
    parser.add_argument("--speed", type=float, default=SPEED, help="to drive at, m/s")
    parser.add_argument("--out", type=Path, help="keep everything of the drive in this folder")
    parser.add_argument("--keep", type=Path, help="write what the tests replay into this folder")
    options = parser.parse_args()
    binary, begun, proposal = find_ardurover(options.ardurover), time.monotonic(), proposed()
    assert proposal.proposed is not None, proposal.support
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        sets = {"defaults": {}, "proposed": proposal.proposed.gains.parameters}
        log, told, loop = drive(binary, folder, sets, speed=options.speed)
        report(log, told, proposal, loop)
        if options.keep:
            keep(log, told, options.keep)
    print(f"{time.monotonic() - begun:.0f} s in all")


if __name__ == "__main__":
    main()
