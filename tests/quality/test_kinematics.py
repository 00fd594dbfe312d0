"""A channel that is reversed or in another unit alone is named, with the number that mends it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from damage import NOMINAL, clipped, damaged, rewritten

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import Material, diagnosed
from rover_sweep.cli.main import run as program
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Note, Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.result import Diagnosis, DiagnosisSettings
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.pipeline import Identification, identify, wrong_place_in
from rover_sweep.quality.faults import CLIPPED, faults_of, with_faults
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


@pytest.fixture
def quick_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Finds nothing at once; what the recordings lack is said apart from it."""
    none = Diagnosis("none", "", "roll-yaw")
    monkeypatch.setattr("rover_sweep.diagnosis.diagnose.diagnose", lambda *_: none)


@pytest.mark.usefixtures("quick_diagnosis")
def test_one_run_that_contradicts_itself_is_left_out_and_named() -> None:
    runs = rs.read(*(NOMINAL / f"run{n}.BIN" for n in (1, 2, 3)), vehicle=VEHICLE)
    bad = rs.Runs((runs[0], scaled(runs[1], "speed", 1.95), runs[2]), runs.vehicle)
    result = rs.identify(bad, models=("bicycle",), bootstrap=0)
    assert [r.name for g in result.groups for r in g.runs] == ["run1", "run3"]
    assert result.models["bicycle"].verdict.level == "good" and result.recommended == "bicycle"
    assert any(s.startswith("left out run2: speed and ay contradict") for s in result.summary)
    found = rs.diagnose(bad)
    assert found.verdict != "refused"
    assert any(s.startswith("left out run2: speed and ay contradict") for s in found.remarks)
    most = (scaled(runs[0], "speed", 2.237), scaled(runs[1], "speed", 2.237), runs[2])
    result = rs.identify(rs.Runs(most, runs.vehicle), models=("bicycle",), bootstrap=0)
    assert result.recommended is None, "a fault of most runs is one of the file"
    assert "speed is in mph" in result.models["bicycle"].verdict.sentences[0]


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


@pytest.mark.usefixtures("quick_diagnosis")
def test_the_answers_say_which_channel_to_leave_out() -> None:
    runs = rs.read(NOMINAL / "run1.BIN", vehicle=VEHICLE)
    turned = rs.Runs((with_faults(scaled(runs[0], "p", -1.0)),), runs.vehicle)
    (verdict,) = turned.coherence()
    assert verdict.sentence.startswith("discard: p is reversed") and not verdict.keep
    assert verdict.sentence.endswith("without p: --fit r,ay")
    result = rs.identify(turned, models=("bicycle", "roll-yaw"), bootstrap=0)
    assert result.models["bicycle"].verdict.level == "good" and result.recommended == "bicycle"
    assert result.models["roll-yaw"].verdict.level in ("poor", "not identifiable")
    found = rs.diagnose(turned)
    assert any(remark.startswith("left out: run1: p is reversed") for remark in found.remarks)


def test_a_given_speed_that_disagrees_is_a_warning_and_no_fault(sweep: Recording) -> None:
    """One number that somebody gave has no unit to mistake; a file held out is still of use."""
    speed = sweep["speed"]
    given = damaged(sweep, speed=lambda x: np.full(x.shape, 2.2 * sweep.mean_speed))
    assert np.ptp(speed.x) > 0
    assert faults_of(given) == ()
    (note,) = set(with_faults(given).notes) - set(sweep.notes)
    assert note.text.startswith("the given speed of ") and "give the speed of this run" in note.text


# ---- A gyro or accelerometer that is clipped below its full range is named, and no model of it is good.


@pytest.mark.parametrize(("channel", "share"), [("r", 0.9), ("r", 0.6), ("p", 0.6), ("ay", 0.7)])
def test_a_plateau_at_the_extremes_is_named(sweep: Recording, channel: str, share: float) -> None:
    (fault,) = faults_of(clipped(sweep, channel, share))
    assert (fault.fault, fault.spoils) == (CLIPPED, (channel,))
    limit = share * float(np.max(np.abs(sweep.manoeuvre(channel).x)))
    assert f"{channel} is clipped: it stays at" in fault.text and f"{limit:.4g}" in fault.text


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_a_coarse_sensor_is_not_clipped(sweep: Recording, step: float) -> None:
    coarse = {c: (lambda x: step * np.round(x / step)) for c in ("r", "p", "ay")}
    assert faults_of(damaged(sweep, **coarse)) == ()


def test_a_held_answer_is_not_clipped(sweep: Recording) -> None:
    """Where the steering is held, so may the rover's answer be."""
    wave = np.clip(2 * np.sin(0.5 * (sweep["pwm"].t - sweep.span[0])), -1, 1)
    r = np.interp(sweep["r"].t, sweep["pwm"].t, wave)
    assert faults_of(damaged(sweep, pwm=lambda _: 1500 - 100 * wave, r=lambda _: r)) == ()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory, sweep: Recording) -> Path:
    limit = 0.7 * float(np.max(np.abs(sweep.manoeuvre("r").x)))
    out = tmp_path_factory.mktemp("clipped") / "run1.BIN"
    return rewritten(NOMINAL / "run1.BIN", out, {("IMU", "GyrZ"): lambda x: min(max(x, -limit), limit)})


def test_no_model_of_it_is_good(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert program(["coherence", "--json", str(log)]) == 0
    (verdict,) = json.loads(capsys.readouterr().out)
    assert not verdict["keep"] and verdict["sentence"].startswith("repeat: r is clipped: it stays at")
    assert [note["fault"] for note in verdict["notes"] if note["fault"]] == [CLIPPED]
    runs = rs.read(log, vehicle=VEHICLE)
    result = rs.identify(runs, models=("bicycle",), bootstrap=0)
    assert result.recommended is None
    assert {m.verdict.level for m in result.models.values()} <= {"poor", "not identifiable"}
    found = rs.diagnose(runs)
    assert found.verdict == "refused" and "r is clipped" in found.sentence


# ---- The sign of the IMU's place in the vehicle file: with the wrong one no model is good, and it is named.

NAMED = "the IMU's position has the wrong sign"


@pytest.fixture(scope="module")
def runs() -> rs.Runs:
    return rs.read(NOMINAL / "run1.BIN", NOMINAL / "run2.BIN", vehicle=VEHICLE)


def moved(run: Recording, x: float, z: float) -> Recording:
    """The run with its accelerometer moved by x [m] forward and z [m] up: a_y + x r' - z p'."""
    r, p, ay = run["r"], run["p"], run["ay"]
    slopes = (np.interp(ay.t, s.t, np.gradient(s.x, s.t)) for s in (r, p))
    shift = sum(k * slope for k, slope in zip((x, -z), slopes, strict=True))
    return replace(run, channels={**run.channels, "ay": replace(ay, x=ay.x + shift)})


def identified(runs: rs.Runs, true: tuple[float, float], stated: tuple[float, float]) -> Identification:
    assert runs.vehicle is not None
    geometry: Geometry = replace(geometry_of(runs.vehicle), imu_x=stated[0], imu_z=stated[1])
    return identify([moved(run, *true) for run in runs], geometry, (), Settings(models=("roll-yaw",)))


@pytest.mark.parametrize(
    ("true", "stated", "axis"), [((0.05, 0.0), (-0.05, 0.0), "forward"), ((0.0, 0.0), (0.0, 0.116), "down")]
)
def test_a_wrong_sign_is_named(
    runs: rs.Runs, true: tuple[float, float], stated: tuple[float, float], axis: str
) -> None:
    found = identified(runs, true, stated)
    sentence = found.models["roll-yaw"].verdict.sentences[0]
    assert sentence.startswith(f"{NAMED}: with {axis} of imu.position reversed, J_ave falls from")
    assert found.models["roll-yaw"].verdict.level in ("poor", "not identifiable")
    assert any(NAMED in words for words in found.summary)


@pytest.mark.parametrize("place", [(0.0, 0.0), (-0.03, 0.0), (0.0, 0.116)])
def test_a_right_place_is_not_doubted(runs: rs.Runs, place: tuple[float, float]) -> None:
    found = identified(runs, place, place)
    assert not any(NAMED in words for words in found.summary)
    assert found.models["roll-yaw"].verdict.level == "good"


@pytest.mark.usefixtures("quick_diagnosis")
def test_without_a_yaw_inertia_in_the_file_mass_and_axles_tell(runs: rs.Runs) -> None:
    """5 cm on the wrong side: C 78 for 32, at a J_ave of 6 for 5. A diagnosis says it too."""
    assert runs.vehicle is not None
    given = tuple(moved(run, 0.05, 0.0) for run in runs)
    geometry = replace(geometry_of(runs.vehicle), yaw_inertia=None, imu_x=-0.05)
    words = wrong_place_in(grouped(given, Settings()), geometry, "roll-yaw")
    assert words.startswith(f"{NAMED}: with forward") and "(mass and axles suggest 0.0761)" in words
    wrong = diagnosed(Material(given), at(runs.vehicle, -0.05), DiagnosisSettings())
    assert any(words.startswith(NAMED) for words in wrong.remarks)


def at(vehicle: Vehicle, forward: float) -> Vehicle:
    """The vehicle with its IMU so far ahead of the CG [m]."""
    assert vehicle.imu_position is not None
    x, y, z = vehicle.imu_position
    return replace(vehicle, imu_position=(replace(x, value=forward), y, z))
