"""Each recording that cannot be used is refused in one sentence that names the reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flash_writer import FlashWriter
from recordings import DEFAULTS, NOMINAL, foreign

from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.read import read_runs


def refusal(source: str, **options: object) -> str:
    with pytest.raises(DataRefused) as caught:
        read_runs(source, **options)  # type: ignore[arg-type]
    text = str(caught.value)
    assert "\n" not in text and len(text) < 300
    return text


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("static_v3.1.2.BIN", "the rover never drove (speed up to 0.0"),
        ("moved_by_hand_v2.51.BIN", "the rover never drove (speed up to 0.1"),
        ("still_v4.5.5.tlog", "the rover never drove (speed up to 0.00 m/s)"),
        ("corrupt_v3.1.2.BIN", "is damaged in 64 places among 6845 messages (6724 of 266240 bytes)"),
    ],
)
def test_logs_of_hardware_that_did_not_drive(name: str, reason: str) -> None:
    assert reason in refusal(foreign(f"rover_logs/{name}"))


def test_a_tlog_without_outputs_asks_for_the_other_log() -> None:
    half = Path(__file__).parents[1] / "data/gains/ardurover-4.6.3/half.tlog"
    assert "give also the .BIN of the same drive" in refusal(str(half))


def test_a_boat_with_two_thrusters() -> None:
    columns = {"time": "t", "delta": "steer", "r": "yaw_rate", "ay": "ay", "speed": "vx", "trial": "trial"}
    text = refusal(foreign("cars/blueboat_usv_diffthrust_2024.csv"), column_map=columns)
    assert "without steered wheels" in text and "thr_left_pwm and thr_right_pwm" in text and "lumped" in text


def vehicle_log(
    tmp_path: Path,
    banner: str = "ArduRover V4.6.3 (abc)",
    speed: float = 2.0,
    steer: float = 0.0,
    parameters: dict[str, float] | None = None,
) -> str:
    """A .BIN of 30 s at a speed [m/s], steered by a sine of `steer` us."""
    writer = FlashWriter()
    writer.messages([banner])
    writer.parameters(parameters or {"SERVO1_FUNCTION": 26})
    writer.define("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    writer.define("XKF1", "QBccff", "TimeUS,C,Roll,Yaw,VN,VE")
    writer.define("RCOU", "QHHH", "TimeUS,C1,C2,C3")
    for t in np.arange(0.0, 30.0, 0.05):
        us, wave = round(t * 1e6), float(np.sin(2 * t))
        writer.write("IMU", us, 0, 0.0, 0.0, 0.3 * wave, 0.0, 0.1 * wave, -9.8)
        writer.write("XKF1", us, 0, 0.0, 90.0, 0.0, speed)
        writer.write("RCOU", us, 1500 + steer * wave, 1500, 1600)
    path = tmp_path / "log.BIN"
    path.write_bytes(writer.data)
    return str(path)


def test_the_made_log_is_good_if_nothing_is_wrong_with_it(tmp_path: Path) -> None:
    (run,) = read_runs(vehicle_log(tmp_path, steer=80))
    assert run.mean_speed == pytest.approx(2.0)
    assert run["r"].x.max() == pytest.approx(0.3, abs=0.01)
    assert "vy" not in run  # it is zero throughout
    assert any("vy does not change" in n.text for n in run.notes)
    parameters = {"SERVO1_FUNCTION": 26.0, "SERVO2_FUNCTION": 73, "SERVO3_FUNCTION": 74}
    assert len(read_runs(vehicle_log(tmp_path, steer=80, parameters=parameters))) == 1
    assert "no steering excitation while driving (steering 1500 to 1500 us" in refusal(vehicle_log(tmp_path))
    assert "never drove (speed up to 0.05 m/s)" in refusal(vehicle_log(tmp_path, speed=0.05, steer=80))


@pytest.mark.parametrize(
    ("banner", "kind"),
    [("ArduCopter V4.5.1 (1)", "copter"), ("ArduPlane V4.5.1 (1)", "plane"), ("APM:Copter V3.4", "copter")],
)
def test_other_vehicles(tmp_path: Path, banner: str, kind: str) -> None:
    text = refusal(vehicle_log(tmp_path, banner=banner, steer=80))
    assert f"the log of a {kind} ({banner})" in text


@pytest.mark.parametrize(
    ("parameters", "seen"),
    [
        ({"SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 74}, "SERVO3_FUNCTION is 74: skid steering"),
        ({"SERVO1_FUNCTION": 26, "FRAME_CLASS": 2}, "FRAME_CLASS is 2, a boat"),
        ({"RCMAP_ROLL": 1, "SKID_STEER_OUT": 1}, "SKID_STEER_OUT is 1: skid steering"),
    ],
)
def test_no_steered_wheels(tmp_path: Path, parameters: dict[str, float], seen: str) -> None:
    text = refusal(vehicle_log(tmp_path, steer=80, parameters=parameters))
    assert "without steered wheels" in text and seen in text
    assert ("the lumped model does, from a .csv" in text) == ("skid steering" in text)


def test_a_second_steering_output_is_named(tmp_path: Path) -> None:
    two = {"SERVO1_FUNCTION": 26.0, "SERVO4_FUNCTION": 26.0}
    (run,) = read_runs(vehicle_log(tmp_path, steer=80, parameters=two))
    (note,) = (n for n in run.notes if "four-wheel steering" in n.text)
    assert note.level == "warning" and "SERVO1_FUNCTION and SERVO4_FUNCTION are 26" in note.text
    (run,) = read_runs(vehicle_log(tmp_path, steer=80))
    assert not [n for n in run.notes if "four-wheel" in n.text]


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.BIN", b"", "is empty (0 bytes)"),
        ("a.tlog", b"", "is empty (0 bytes)"),
        ("a.csv", b"", "is empty"),
        ("a.BIN", b"GIF89a" * 500, "is not a DataFlash log: its 3000 bytes"),
        ("a.tlog", b"GIF89a" * 500, "is not a telemetry log: its 3000 bytes"),
        ("a.csv", b"\xff\xfe\x00binary", "is not a text file"),
        ("a.csv", b"t,pwm,r,speed\n", "has a header but no rows"),
        ("a.csv", b"t,pwm,r,speed\n0,1500,0.1\n", "line 2 has 3 of 4 columns"),
        ("a.csv", b"t,pwm,r,speed\n0,1500,x,2\n", "column r is not numeric"),
    ],
)
def test_empty_and_foreign_files(tmp_path: Path, name: str, content: bytes, reason: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert reason in refusal(str(path))


def test_a_pair_must_be_of_one_drive(tmp_path: Path) -> None:
    assert "are not of one drive" in refusal(f"{NOMINAL / 'run1.BIN'}+{DEFAULTS / 'run1.tlog'}")
    assert "no vehicle time in common" in refusal(f"{NOMINAL / 'run4.BIN'}+{DEFAULTS / 'run1.tlog'}")


@pytest.mark.parametrize(
    "source",
    ["nowhere.BIN", "a.BIN+b.tlog", str(Path(__file__)), f"{NOMINAL / 'run1.BIN'}+{NOMINAL / 'run2.BIN'}"],
)
def test_wrong_sources_are_the_users_mistake(source: str) -> None:
    with pytest.raises(UsageError):
        read_runs(source)
