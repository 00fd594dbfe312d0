"""A channel that is reversed or in another unit alone is named, with the number that mends it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from damage import NOMINAL, damaged, rewritten

import rover_sweep as rs
from rover_sweep.cli.main import run as program
from rover_sweep.data.recording import Note, Recording
from rover_sweep.quality.faults import faults_of, with_faults
from rover_sweep.quality.relations import REVERSED, SCALE, UNIT

VEHICLE = NOMINAL.parents[1] / "rover.toml"
DEGREES, G = 180 / np.pi, 9.80665


def scaled(run: Recording, channel: str, factor: float) -> Recording:
    return damaged(run, **{channel: lambda x: factor * x})


def fault_of(run: Recording) -> Note:
    (fault,) = faults_of(run)
    return fault


@pytest.mark.parametrize(
    ("channel", "factor", "name", "words"),
    [
        ("r", -1.0, REVERSED, "r is reversed: the rate of the heading is -0.99"),
        ("p", -1.0, REVERSED, "p is reversed: the rate of the roll angle is -0.98"),
        ("ay", -1.0, REVERSED, "ay is reversed: a_y is -1.0"),
        ("r", DEGREES, UNIT, "r is in deg/s: the rate of the heading is 0.0174 times r; divide r by 57.3"),
        ("r", -DEGREES, UNIT, "r is reversed and in deg/s"),
        ("p", DEGREES, UNIT, "p is in deg/s: the rate of the roll angle is 0.017"),
        ("p", 1 / DEGREES, UNIT, "p is converted from deg/s twice"),
        ("ay", 1 / G, UNIT, "ay is in g: a_y is 0.108 times V r; divide ay by 0.102"),
        ("ay", 1e3 / G, UNIT, "ay is in mg"),
        ("ay", -1 / G, UNIT, "ay is reversed and in g"),
        ("speed", 3.6, UNIT, "speed is in km/h"),
    ],
)
def test_the_channel_is_named(sweep: Recording, channel: str, factor: float, name: str, words: str) -> None:
    fault = fault_of(scaled(sweep, channel, factor))
    assert (fault.fault, fault.spoils) == (name, (channel,))
    assert fault.text.startswith(words), fault.text


@pytest.mark.parametrize(("factor", "ratio"), [(1.95, "0.5"), (0.45, "2.")])
def test_a_speed_in_no_unit_is_not_given_one(sweep: Recording, factor: float, ratio: str) -> None:
    """Wheels that spin read nearly twice the speed: that was "in mph", which is 2.237 times."""
    fault = fault_of(scaled(sweep, "speed", factor))
    assert (fault.fault, set(fault.spoils)) == (SCALE, {"speed", "ay"})
    assert fault.text.startswith(f"speed and ay contradict each other: a_y is {ratio}"), fault.text
    assert "wheels" in fault.text and "mph" not in fault.text
    assert fault_of(scaled(sweep, "speed", 2.237)).text.startswith("speed is in mph")


def test_one_run_that_contradicts_itself_is_left_out_and_named() -> None:
    runs = rs.read(NOMINAL / "run1.BIN", NOMINAL / "run2.BIN", NOMINAL / "run4.BIN", vehicle=VEHICLE)
    bad = rs.Runs((runs[0], scaled(runs[1], "speed", 1.95), runs[2]), runs.vehicle)
    result = rs.identify(bad, models=("bicycle",), bootstrap=0)
    assert [r.name for g in result.groups for r in g.runs] == ["run1"]
    assert result.models["bicycle"].verdict.level == "good" and result.recommended == "bicycle"
    assert any(s.startswith("left out run2: speed and ay contradict") for s in result.summary)
    found = rs.diagnose(bad, only=("transport_delay",), time_limit=0.1)
    assert found.verdict != "refused"
    assert any(s.startswith("left out run2: speed and ay contradict") for s in found.remarks)


def test_a_fault_of_most_runs_is_one_of_the_file() -> None:
    runs = rs.read(NOMINAL / "run1.BIN", NOMINAL / "run2.BIN", NOMINAL / "run3.BIN", vehicle=VEHICLE)
    bad = (scaled(runs[0], "speed", 2.237), scaled(runs[1], "speed", 2.237), runs[2])
    result = rs.identify(rs.Runs(bad, runs.vehicle), models=("bicycle",), bootstrap=0)
    assert result.recommended is None
    assert "speed is in mph" in result.models["bicycle"].verdict.sentences[0]


def test_all_three_at_once(sweep: Recording) -> None:
    changed = scaled(scaled(scaled(sweep, "r", -1.0), "p", DEGREES), "ay", 1 / G)
    assert [fault.spoils for fault in faults_of(changed)] == [("r",), ("ay",), ("p",)]


def test_a_wrong_heading_accuses_no_sensor(sweep: Recording) -> None:
    assert faults_of(scaled(sweep, "psi", -1.0)) == ()


@pytest.mark.parametrize(("channel", "spoilt"), [("r", ("r",)), ("ay", ("ay",)), ("p", ("p", "ay"))])
def test_without_angles_the_outward_lean_tells(
    sweep: Recording, channel: str, spoilt: tuple[str, ...]
) -> None:
    bare = replace(sweep.without({"phi", "psi"}), notes=())
    assert faults_of(bare) == ()
    fault = fault_of(scaled(bare, channel, -1.0))
    assert (fault.fault, fault.spoils) == (REVERSED, spoilt)


def test_what_two_channels_cannot_settle_is_said(sweep: Recording) -> None:
    fault = fault_of(scaled(sweep.without({"phi", "psi", "p"}), "ay", -1.0))
    assert fault.text.startswith("ay is reversed (or r is wrong)") and fault.spoils == ("ay", "r")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("reversed") / "run1.BIN"
    return rewritten(NOMINAL / "run1.BIN", out, {("IMU", "GyrX"): lambda x: -x})


def test_the_commands_say_which_channel_to_leave_out(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert program(["coherence", "--json", str(log)]) == 0
    (verdict,) = json.loads(capsys.readouterr().out)
    assert verdict["sentence"].startswith("discard: p is reversed") and not verdict["keep"]
    assert verdict["sentence"].endswith("without p: --fit r,ay")
    options = ["--vehicle", str(VEHICLE), "--bootstrap", "0", "--out", str(tmp_path)]
    assert program(["identify", str(log), *options]) == 0
    document = json.loads((tmp_path / "identification.json").read_text())
    assert _level(document, "bicycle") == "good"
    assert _level(document, "roll-yaw") in ("poor", "not identifiable")
    assert document["recommended"] == "bicycle"


def _level(document: dict, model: str) -> str:
    return str(document["models"][model]["verdict"]["level"])


def test_a_fit_without_the_channel_is_not_doubted(log: Path) -> None:
    result = rs.identify(rs.read(log, vehicle=VEHICLE), fit=("r", "ay"), models=("roll-yaw",), bootstrap=0)
    assert not any("reversed" in words for words in result.models["roll-yaw"].verdict.sentences)


def test_a_diagnosis_leaves_it_out_and_says_so(log: Path) -> None:
    tried = ("transport_delay", "roll_dof")  # without p the baseline is the bicycle, and this rover rolls
    found = rs.diagnose(rs.read(log, vehicle=VEHICLE), only=tried)
    assert any(remark.startswith("left out: run1: p is reversed") for remark in found.remarks)
    assert found.verdict == "none", found.sentence


def test_a_reversed_yaw_rate_refuses_a_diagnosis() -> None:
    runs = rs.read(NOMINAL / "run1.BIN", vehicle=VEHICLE)
    turned = rs.Runs((scaled(runs[0], "r", -1.0),), runs.vehicle)
    found = rs.diagnose(turned)
    assert found.verdict == "refused" and "r is reversed" in found.sentence


def test_a_given_speed_that_disagrees_is_a_warning_and_no_fault(sweep: Recording) -> None:
    """One number that somebody gave has no unit to mistake; a file held out is still of use."""
    speed = sweep["speed"]
    given = damaged(sweep, speed=lambda x: np.full(x.shape, 2.2 * sweep.mean_speed))
    assert np.ptp(speed.x) > 0
    assert faults_of(given) == ()
    (note,) = set(with_faults(given).notes) - set(sweep.notes)
    assert note.text.startswith("the given speed of ") and "give the speed of this run" in note.text
