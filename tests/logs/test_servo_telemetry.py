"""CSRV, the servo's telemetry: its position in us of the output, its lag, and a rover without its servo."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import rover_sweep as rs
from rover_sweep.gains.identified import from_identification
from rover_sweep.logs.readers.dataflash_channels import read_dataflash
from rover_sweep.report.identification.identification_json import identification_document

DATA = Path(__file__).parents[1] / "data"
RUN = DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"
LAG, DELAY = 0.022, 0.015  # s, of the servo of the plant behind the recording
DEGREES, OFFSET = 0.09, 3.0  # of the made telemetry, per us and at 1500 us
KIND, FORMAT = 251, b"QBfffBfffffB"
COLUMNS = b"TimeUS,Id,Pos,Force,Speed,Pow,PosCmd,V,A,MotT,PCBT,Err"


def with_telemetry(path: Path, servo: int, follows: bool = True, hole: float = 0.0) -> Path:
    """The recording with CSRV of a servo (DroneCAN's number, or 4.7's) at 50 Hz, and of another one.

    hole: s without CSRV in every 12 s.
    """
    (log,) = read_dataflash(RUN)
    command = log.steering[0]
    grid = np.arange(command.t[0], command.t[-1], 0.001)
    decay = math.exp(-0.001 / LAG)
    held = command.x[np.searchsorted(command.t, grid, "right") - 1]
    turned = lfilter([1 - decay], [1.0, -decay], held, zi=[decay * held[0]])[0]
    t = np.arange(grid[0] + 0.3, grid[-1], 0.02)
    position = OFFSET + DEGREES * (np.interp(t - DELAY, grid, turned) - 1500)
    if not follows:
        position = OFFSET + np.sin(t)
    cells = "<QBfffBfffffB"
    length = 3 + struct.calcsize(cells)
    rows = [struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, KIND, length, b"CSRV", FORMAT, COLUMNS)]
    noise = 0.05 * np.random.default_rng(1).standard_normal(t.size)
    for at, x in ((at, x) for at, x in zip(t, position + noise, strict=True) if at % 12 >= hole):
        for number, value in ((servo, x), (7, -x)):
            row = (round(at * 1e6), number, value, 0.1, 0.0, 3, 0.0, 6.0, 0.4, 30.0, 30.0, 0)
            rows.append(bytes([0xA3, 0x95, KIND]) + struct.pack(cells, *row))
    path.write_bytes(RUN.read_bytes() + b"".join(rows))
    return path


@pytest.mark.parametrize("servo", [0, 1])
def test_the_position_is_in_us_of_the_output(tmp_path: Path, servo: int):
    run = rs.read(with_telemetry(tmp_path / "run.BIN", servo), vehicle=DATA / "rover.toml")[0]
    assert run["servo"].unit == "us" and run["servo"].source == "CSRV.Pos"
    assert run["delta"].source.startswith("SWEP"), "the command, unless the servo is asked for"
    assert (run["delta"].origin, run["servo"].origin) == ("commanded", "measured")
    inside = run.manoeuvre("servo")
    late = run["pwm"].on(np.arange(*run.span, 0.01))
    assert np.ptp(inside.x) == pytest.approx(np.ptp(late), rel=0.1)
    (note,) = (n.text for n in run.notes if "CSRV" in n.text)
    delay, lag = (int(note.split(f" {word} of ")[1].split()[0]) for word in ("delay", "lag"))
    assert lag == pytest.approx(1e3 * LAG, abs=8) and delay == pytest.approx(1e3 * DELAY, abs=8)
    assert lag + delay == pytest.approx(1e3 * (LAG + DELAY), abs=6)


def test_the_rover_without_its_servo_has_no_delay_and_no_gains(tmp_path: Path):
    """The plant has 37 ms of servo between command and wheels."""
    path, found = with_telemetry(tmp_path / "run.BIN", 0), {}
    for servo in (False, True):
        runs = rs.read(path, vehicle=DATA / "rover.toml", servo=servo)
        result = rs.identify(runs, models=["bicycle"], bootstrap=0)
        document = identification_document(result, result.origin)
        found[servo] = document["models"]["bicycle"]["parameters"]["tau"]["value"]
        doubts = from_identification(document, "bicycle").doubts
        assert servo == any(
            "the steering was measured (CSRV.Pos), so the model begins" in doubt for doubt in doubts
        )
    assert found[False] - found[True] == pytest.approx(LAG + DELAY, abs=0.012)
    assert found[True] < 0.015


def test_holes_in_the_telemetry_are_a_warning_and_the_command_has_none(tmp_path: Path):
    path, words = with_telemetry(tmp_path / "run.BIN", 0, hole=1.0), "telemetry (CSRV) has holes of up to 1.0"
    for servo, origin in ((True, "measured"), (False, "commanded")):
        run = rs.read(path, vehicle=DATA / "rover.toml", servo=servo)[0]
        assert run["delta"].origin == origin
        assert any(words in n.text for n in run.notes if n.level == "warning") == servo
    whole = rs.read(with_telemetry(path, 0), vehicle=DATA / "rover.toml", servo=True)[0]
    assert not any("has holes" in n.text for n in whole.notes)


def test_telemetry_of_another_servo_is_not_used(tmp_path: Path):
    path = with_telemetry(tmp_path / "run.BIN", 0, follows=False)
    assert "servo" not in rs.read(path, vehicle=DATA / "rover.toml")[0]
    with pytest.raises(rs.DataRefused, match="no servo telemetry .* omit --servo-telemetry"):
        rs.read(path, vehicle=DATA / "rover.toml", servo=True)
