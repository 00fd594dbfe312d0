"""`rover-sweep gains` from files to the terminal, JSON and a parameter file."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from math import log
from pathlib import Path
from typing import Any

import pytest

from firmware_params.param_files import read
from rover_sweep.cli.main import run
from rover_sweep.diagnosis.result import Diagnosis, Fit, HeldOut, Verdict
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.gains.identified import from_diagnosis
from rover_sweep.gains.proposal import Proposal, propose_gains
from rover_sweep.gains.steering_chain import autopilot

DATA = Path(__file__).parents[1] / "data"
sys.path.insert(0, str(Path(__file__).parents[1] / "diagnosis"))
LOG = DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"
pytestmark = pytest.mark.usefixtures("few_corners")


@pytest.fixture
def folder(tmp_path: Path, nominal_text: str) -> Path:
    """The --out folder of identify, as far as gains read it."""
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "identification.json").write_text(nominal_text)
    return tmp_path


def test_a_folder_and_a_log_give_a_table_a_file_and_another_that_undoes_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    out = folder / "gains.param"
    assert run(["gains", str(folder), "--now", str(LOG), "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "Gains for 2.45 m/s, valid from 1.64 to 3.68 m/s (roll-yaw model, good)" in said.out
    assert f"parameters written to {out}" in said.err
    written = {p.name: p for p in read(out)}
    gains = {f"ATC_STR_RAT_{k}" for k in ("FF", "P", "I", "D", "IMAX")}
    assert set(written) == gains | {"ATC_STR_RAT_MAX"}
    assert 60 < written["ATC_STR_RAT_MAX"].value < 200
    assert "# ATC_TURN_MAX_G,0.3" in out.read_text(), "240 us confirm half of the 0.6 g that are set"
    assert "(was 0.75)" in written["ATC_STR_RAT_FF"].reason  # the recordings flew sim_vehicle's 0.75
    assert f"{folder / 'undo-gains.param'} undoes them" in said.err
    undone = {p.name: p.value for p in read(folder / "undo-gains.param")}
    assert set(undone) == set(written) and undone["ATC_STR_RAT_FF"] == 0.75
    assert (undone["ATC_STR_RAT_P"], undone["ATC_STR_RAT_MAX"]) == (0.2, 120)


def test_one_step_is_bounded_and_says_by_what(folder: Path, capsys: pytest.CaptureFixture[str]):
    """From gains far below the design, one proposal raises none beyond twice its value, or the default."""
    now = {"FF": 0.15, "P": 0.2, "I": 0.0}
    asked = folder / "now.param"
    asked.write_text("".join(f"ATC_STR_RAT_{name} {value}\n" for name, value in now.items()))
    assert run(["gains", str(folder), "--now", str(asked), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    proposed = told["proposed"]["parameters"]
    most = {"FF": 0.3, "P": 0.4, "I": 0.2}
    assert all(proposed[f"ATC_STR_RAT_{name}"] <= value for name, value in most.items())
    assert proposed["ATC_STR_RAT_FF"] == 0.3, "the design is at more than three times of it"
    words = next(r for r in told["support"]["remarks"] if "raises no gain by more than a factor of 2" in r)
    assert "ATC_STR_RAT_FF from 0.15 to 0.3 now (the design is 0.9" in words
    assert "ATC_STR_RAT_I from 0 to 0.2 now (the design is " in words and "wheels off the ground" in words
    assert told["proposed"]["step"]["rise_s"] is None
    assert any("are an intermediate step" in r for r in told["support"]["remarks"])
    assert told["proposed"]["worst"]["gain_margin_db"] >= 6 <= told["proposed"]["worst"]["phase_margin_deg"]


@pytest.mark.parametrize("value", ["nan", "-0.3"])
def test_an_impossible_present_gain_is_refused(folder: Path, value: str, capsys: pytest.CaptureFixture[str]):
    asked = folder / "now.param"
    asked.write_text(f"ATC_STR_RAT_FF 0.3\nATC_STR_RAT_P {value}\n")
    assert run(["gains", str(folder), "--now", str(asked)]) == 2
    said = capsys.readouterr()
    assert not said.out and f"{asked}" in said.err and "ATC_STR_RAT_P" in said.err


def test_what_could_not_be_undone_is_not_written(folder: Path, capsys: pytest.CaptureFixture[str]):
    out, now = folder / "gains.param", folder / "now.param"
    now.write_text("ATC_STR_RAT_FF 0.75\nATC_STR_RAT_P 0.2\n")
    unknown, lacking = "ATC_STR_RAT_IMAX, ATC_STR_RAT_MAX are unknown", f"{now} lacks ATC_STR_RAT_"
    for given, words in (([], unknown), (["--now", str(now)], lacking)):
        assert run(["gains", str(folder), *given, "--out", str(out)]) == 2
        said = capsys.readouterr()
        assert "Gains for 2.45 m/s" in said.out
        assert words in " ".join(said.err.split()) and "so the change could not be undone" in said.err
        assert ("ATC_STR_RAT_P" in said.err) == (not given)
        assert not out.exists() and not (folder / "undo-gains.param").exists()


def test_a_saved_result_is_read_like_the_report_and_what_is_not_supported_writes_no_file(
    nominal_result: Any, folder: Path, capsys: pytest.CaptureFixture[str]
):
    nominal_result.save(folder / "result.json")
    out, found = folder / "gains.param", []
    for place in (folder / "result.json", folder):
        assert run(["gains", str(place), "--speed", "9", "--json", "--out", str(out)]) == 0
        said = capsys.readouterr()
        found.append(json.loads(said.out))
        assert "was not written" in said.err and not out.exists()
    assert found[0] == found[1] and found[0]["support"]["level"] == "none"
    assert "too far from the runs" in found[0]["support"]["reasons"][0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "contains no identification"),
        (["{folder}", "--model", "lumped"], "--model lumped"),
        (["{folder}", "--speed", "nan"], "'--speed': 'nan' is not a finite number"),
        (["{folder}", "--speed", "-2.5"], "'--speed': -2.5 is not in the range 0.1<=x<=50"),
        (["{folder}", "--now", "missing.param"], "missing.param cannot be read"),
        (["{folder}", "--now", "a.param", "--connect", "udp:x"], "give only one of them"),
        ([str(DATA / "rover.toml")], "cannot be read as results of rover-sweep"),
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

    made = of_diagnosis(diagnosis(model("servo_lag", "steering_backlash")))
    assert made.support.level == "gains"
    assert made.proposed.worst_gain[0] >= 6
    assert made.delay == pytest.approx(0.02 - 0.005)  # the wait for the main loop is not the loop's
    assert any("steering_backlash" in remark for remark in made.support.remarks)


def diagnosis(model: AugmentedModel, verdict: Verdict = "explained", j_rms: float = 0.9) -> Diagnosis:
    kept = HeldOut("run4", Fit(3.0, 0.2), Fit(j_rms, 0.05), 0.9)
    return Diagnosis(verdict, "the servo lags", model.baseline, held_out=(kept,), model=model)


def of_diagnosis(found: Diagnosis) -> Proposal:
    loop = autopilot({"INS_GYRO_FILTER": 20.0, "SCHED_LOOP_RATE": 100.0})
    return propose_gains(from_diagnosis(found), loop, 2.5)


def test_a_diagnosis_without_a_sound_model_gives_no_gains():
    """The last: half the height and three times the roll inertia, as of a kinematic rover."""
    from augmented_models import model

    lag = model("servo_lag")
    failed, odd = diagnosis(lag, j_rms=2.1), model("servo_lag", ln_h=log(0.47), ln_Ixx=log(3.08))
    for found, words in (
        (diagnosis(lag, "unexplained"), "the diagnosis says UNEXPLAINED, so its model lacks a part"),
        (
            diagnosis(lag, "partly explained"),
            "the diagnosis says PARTLY EXPLAINED, so its model lacks a part",
        ),
        (failed, "does not predict run4, which was held out: J_rms 2.1 (at most 2), TIC 0.05"),
        (replace(failed, held_out=()), "no run was held out"),
        (diagnosis(odd), "of the vehicle file"),
    ):
        made = of_diagnosis(found)
        assert made.proposed is None and made.support.level == "none"
        assert words in made.support.reasons[0]
    assert [r.partition(" = ")[0] for r in made.support.reasons] == ["Ixx", "h"]


def test_what_a_vehicle_flies_is_read_over_the_link(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """From the embedded rover; nothing but reading, and its own defaults are those of the firmware."""
    from sitl.launcher import start_embedded

    options = ("--parameter", "ATC_STR_RAT_P=0.4", "--parameter", "SERVO1_MAX=1700")
    with start_embedded(tmp_path / "rover", options=options, speedup=8) as rover:
        assert run(["gains", str(folder), "--connect", rover.connection, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["now"]["parameters"]["ATC_STR_RAT_P"] == 0.4
    assert told["autopilot"]["travel_us"] == {"right": 200.0, "left": 400.0}
    assert told["autopilot"]["gyro_filter_hz"] == 4.0
    assert "ATC_STR_RAT_FF" not in told["autopilot"]["assumed"]
