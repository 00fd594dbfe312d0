"""`rover-sweep gains` from files to the terminal, JSON and a parameter file."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from firmware_params.param_files import read
from rover_sweep.cli.main import run

DATA = Path(__file__).parents[1] / "data"
sys.path.insert(0, str(Path(__file__).parents[1] / "diagnosis"))
LOG = DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"


@pytest.fixture
def folder(tmp_path: Path, nominal_text: str) -> Path:
    """The --out folder of identify, as far as gains read it."""
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "identification.json").write_text(nominal_text)
    return tmp_path


def test_a_folder_and_a_log_give_a_table_and_a_file(folder: Path, capsys: pytest.CaptureFixture[str]):
    out = folder / "gains.param"
    assert run(["gains", str(folder), "--now", str(LOG), "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "Gains for 2.45 m/s, valid from 1.64 to 3.68 m/s (roll-yaw model, good)" in said.out
    assert "ATC_STR_RAT_FF" in said.out
    assert f"parameters written to {out}" in said.err
    written = {p.name: p for p in read(out)}
    gains = {f"ATC_STR_RAT_{k}" for k in ("FF", "P", "I", "D", "IMAX")}
    assert set(written) == gains | {"ATC_STR_RAT_MAX"}
    assert 60 < written["ATC_STR_RAT_MAX"].value < 200
    assert "# ATC_TURN_MAX_G 0.3" in out.read_text(), "240 us confirm half of the 0.6 g that are set"
    assert "(was 0.75)" in written["ATC_STR_RAT_FF"].reason  # the recordings flew sim_vehicle's 0.75


def test_a_large_change_is_tried_off_the_ground(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["gains", str(folder)]) == 0
    large = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Large changes: ")]
    assert "ATC_STR_RAT_FF 0.2 to " in large[0] and "wheels off the ground" in large[0]


def test_json_stands_alone_on_stdout(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["gains", str(folder / "report" / "identification.json"), "--speed", "2.5", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["support"]["level"] == "gains"
    assert told["proposed"]["worst"]["gain_margin_db"] >= 6
    assert told["autopilot"]["gyro_filter_hz"] == 20.0  # that of the runs, where nothing else is known
    assert "INS_GYRO_FILTER" in told["autopilot"]["assumed"]


def test_a_saved_result_is_read_like_the_report(
    nominal_result: Any, folder: Path, capsys: pytest.CaptureFixture[str]
):
    nominal_result.save(folder / "result.json")
    found = []
    for place in (folder / "result.json", folder):
        assert run(["gains", str(place), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1]


def test_the_vehicles_own_parameters_are_compared(folder: Path, capsys: pytest.CaptureFixture[str]):
    now = folder / "now.param"
    now.write_text(
        "ATC_STR_RAT_FF 2.5\nATC_STR_RAT_P 1.5\nSCHED_LOOP_RATE 50\nSERVO1_MAX 1700\nSERVO1_MIN 1300\n"
    )
    assert run(["gains", str(folder), "--now", str(now), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["now"]["parameters"]["ATC_STR_RAT_FF"] == 2.5
    assert told["autopilot"]["travel_us"] == {"right": 200.0, "left": 200.0}
    assert told["autopilot"]["loop_rate_hz"] == 50


def test_what_is_not_supported_writes_no_file(
    folder: Path, nominal_text: str, capsys: pytest.CaptureFixture[str]
):
    out = folder / "gains.param"
    assert run(["gains", str(folder), "--speed", "9", "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "No gains can be computed from this identification for 9.00 m/s" in said.out
    assert "too far from the runs" in said.out
    assert "was not written" in said.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "contains no identification"),
        (["{folder}", "--model", "lumped"], "--model lumped"),
        (["{folder}", "--speed", "nan"], "'--speed': 'nan' is not a finite number"),
        (["{folder}", "--speed", "inf"], "'--speed': inf is not in the range 0.1<=x<=50"),
        (["{folder}", "--speed", "0"], "'--speed': 0.0 is not in the range 0.1<=x<=50"),
        (["{folder}", "--speed", "-2.5"], "'--speed': -2.5 is not in the range 0.1<=x<=50"),
        (["{folder}", "--now", "missing.param"], "missing.param cannot be read"),
        (["{folder}", "--now", "a.param", "--connect", "udp:x"], "give only one of them"),
        ([str(DATA / "rover.toml")], "cannot be read as an identification"),
        (["{folder}", "--out", "no/such/gains.param"], "there is no folder"),
    ],
)
def test_mistakes_are_one_sentence(
    arguments: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
):
    assert run(["gains", *(a.format(folder=folder) for a in arguments)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("value", 0.0, "Cf is 0 N/rad, outside"),
        ("value", "x", "could not convert"),
        ("interval_90", [30.0, 20.0], "the 90 % interval of Cf is 30 to 20"),
        ("interval_90", 3, "a part of it has another form"),
    ],
)
def test_an_impossible_number_in_an_edited_result_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], key: str, value: Any, sentence: str
):
    path = folder / "report" / "identification.json"
    document = json.loads(path.read_text())
    document["models"][document["recommended"]]["parameters"]["Cf"][key] = value
    path.write_text(json.dumps(document))
    assert run(["gains", str(folder)]) == 2
    said = capsys.readouterr().err
    assert sentence in said and "run identify again" in said and "Traceback" not in said


def test_a_diagnosis_carries_gains_too(tmp_path: Path):
    """Its linear part, with the lag of the servo as a lag; what is not linear is said."""
    from augmented_models import model

    from rover_sweep.gains.identified import from_diagnosis
    from rover_sweep.gains.proposal import propose_gains
    from rover_sweep.gains.steering_chain import autopilot

    found = from_diagnosis(model("servo_lag", "steering_backlash"), "explained")
    made = propose_gains(found, autopilot({"INS_GYRO_FILTER": 20.0, "SCHED_LOOP_RATE": 100.0}), 2.5)
    assert made.support.level == "gains"
    assert made.proposed.worst_gain[0] >= 6
    assert made.delay == pytest.approx(0.02 - 0.005)  # the wait for the main loop is not the loop's
    assert any("steering_backlash" in remark for remark in made.support.remarks)
    slow = propose_gains(from_diagnosis(model("servo_lag"), "unexplained"), made.autopilot, 2.5)
    assert "the verdict of the diagnosis is: unexplained" in slow.support.reasons[0]


def test_what_a_vehicle_flies_is_read_over_the_link(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """From the embedded rover; nothing but reading, and its own defaults are those of the firmware."""
    from sitl.launcher import start_embedded

    options = ("--parameter", "ATC_STR_RAT_P=0.4")
    with start_embedded(tmp_path / "rover", options=options, speedup=8) as rover:
        assert run(["gains", str(folder), "--connect", rover.connection, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["now"]["parameters"]["ATC_STR_RAT_P"] == 0.4
    assert "ATC_STR_RAT_FF" not in told["autopilot"]["assumed"]


def test_the_core_knows_no_files_links_or_terminals():
    import ast

    forbidden = (
        "sitl",
        "rover_sweep.logs",
        "rover_sweep.vehicle",
        "rover_sweep.cli",
        "rover_sweep.report",
        "click",
    )
    for path in (Path(__file__).parents[2] / "rover_sweep" / "gains").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert not str(node.module).startswith(forbidden), f"{path.name} imports {node.module}"
