"""`rover-sweep diagnose`: what the engine is given, what comes out, what ends with a sentence."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fabricated_diagnoses import EXPLAINED, REFUSED
from fabricated_engine import PLAIN, Engine, ProgramResult

from rover_sweep.api.read import same_recording
from rover_sweep.cli.driving import shown_results
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import load
from rover_sweep.data.vehicle_geometry import tolerances_of
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.errors import DataRefused
from rover_sweep.logs.read import read_runs

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
SWEEP, DOUBLET = NOMINAL / "run1.BIN", NOMINAL / "run4.BIN"
RunProgram = Callable[..., ProgramResult]


@pytest.fixture
def asked(run_program: RunProgram, tmp_path: Path) -> RunProgram:
    """`diagnose` with the vehicle file, into the test's folder."""

    def call(*arguments: object) -> ProgramResult:
        return run_program(
            "diagnose", *arguments, "--vehicle", DATA / "rover.toml", "--out", tmp_path / "out"
        )

    return call


def test_the_report_is_written_and_the_summary_printed(
    engine: Engine, asked: RunProgram, tmp_path: Path
) -> None:
    code, out, _ = asked(SWEEP, DOUBLET)
    assert code == 0 and "--full" in out
    assert out.startswith("EXPLAINED\nPlay in the steering")
    *_, report, following = out.rstrip().splitlines()
    assert report == f"report: {tmp_path}/out/diagnosis.html"
    assert following == f"next: rover-sweep gains {tmp_path}/out"
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [(r["role"], r["name"]) for r in document["recordings"]] == [("fit", "run1"), ("held out", "run4")]
    assert all(len(r["sources"][0]["sha256"]) == 64 for r in document["recordings"])
    assert document["vehicle"]["file"] == "rover.toml" and document["baseline"] == "roll-yaw"


@pytest.mark.parametrize("origin", ["commanded", "measured", "unknown"])
def test_a_steering_that_was_measured_or_may_have_been_is_remarked(
    engine: Engine, asked: RunProgram, tmp_path: Path, origin: str
) -> None:
    """The model of a measured one has no conversion from PWM, as the servo is not in it."""
    sys.path.insert(0, str(DATA.parent / "gains"))
    from csv_drives import as_csv, column_map

    engine.answer = replace(PLAIN, model=AugmentedModel("bicycle", Geometry(2.66, 0.203, 0.188), (), {}, 2.0))
    (sweep,) = as_csv(tmp_path, ["run1"])
    code, out, _ = asked(sweep, "--columns", column_map(tmp_path, origin), "--full")
    assert code == 0
    assert ("the steering was measured in run1 (angle)" in out.lower()) == (origin == "measured")
    assert ("commanded or measured is unknown in run1 (angle)" in out) == (origin == "unknown")
    model = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["model"]
    assert (model["steering"] is None) == (origin == "measured")


def test_doublets_are_held_out_unless_other_runs_are(engine: Engine, asked: RunProgram) -> None:
    assert "No run was held out" not in asked(SWEEP, DOUBLET).out
    assert [r.name for r in engine.given["runs"]] == ["run1"]
    assert [r.name for r in engine.given["held_out"]] == ["run4"]
    asked(SWEEP, DOUBLET, "--hold-out", NOMINAL / "run2.BIN")
    assert [r.name for r in engine.given["runs"]] == ["run1", "run4"]
    assert [r.name for r in engine.given["held_out"]] == ["run2"]
    assert all("delta" in r for r in (*engine.given["runs"], *engine.given["held_out"]))


def test_options_become_settings(engine: Engine, asked: RunProgram) -> None:
    names = ("--only", "servo_lag,tyre_relaxation", "--without", "servo_lag")
    out = asked(SWEEP, "--baseline", "bicycle", *names, "--time-limit", "12", "--seed", "7", "--full").out
    assert "- No run was held out" in out and "--full" not in out
    settings = engine.given["settings"]
    assert (settings.baseline, settings.time_limit, settings.seed) == ("bicycle", 12.0, 7)
    assert settings.candidates(("roll_steer", "servo_lag", "tyre_relaxation")) == ("tyre_relaxation",)
    assert engine.given["rover"].mass == pytest.approx(2.66)


def test_the_comparison_with_a_simulation_is_the_answer(
    engine: Engine, asked: RunProgram, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rover = Geometry(mass=2.66, a=0.203, b=0.188, yaw_inertia=0.07)
    engine.answer = replace(PLAIN, model=AugmentedModel("bicycle", rover, (), {}, 2.0))

    def compare(*given: Any) -> Path:
        given[-1].print("THEY AGREE")
        return tmp_path / "comparison.json"

    monkeypatch.setattr(shown_results, "show_compared", compare)
    simulated = DATA / "ardurover-4.6.3" / "stock" / "run1.BIN"
    for full in (False, True):
        _, out, _ = asked(SWEEP, "--simulation", simulated, *(["--full"] if full else []))
        assert "THEY AGREE" in out and ("EXPLAINED" in out) is full
    assert [r.name for r in engine.given["simulated"]] == ["stock/run1"]
    code, _, err = asked(SWEEP, "--simulation", SWEEP)
    assert code == 2 and "both the recording and the simulation" in err


def identification(path: Path, **changes: Any) -> Path:
    values = {"C": {"value": 32.0}, "Izz": {"value": 0.071}, "V": {"value": 2.4}}
    models = {"roll-yaw": {"parameters": values}, "bicycle": {"parameters": {"C": {"value": None}}}}
    document = {"format": "rover-sweep identification", "recommended": "roll-yaw", "models": models}
    path.write_text(json.dumps(document | changes))
    return path


def test_an_identified_model_is_the_baseline(engine: Engine, asked: RunProgram, tmp_path: Path) -> None:
    asked(SWEEP, "--model", identification(tmp_path / "identification.json"))
    assert engine.given["settings"].baseline == "roll-yaw"
    assert engine.given["settings"].parameters == {"C": 32.0, "Izz": 0.071, "V": 2.4}


UNUSABLE: list[tuple[dict[str, Any], tuple[str, ...], str]] = [
    ({}, ("--baseline", "lumped"), "has no model 'lumped'; it has roll-yaw, bicycle"),
    ({}, ("--baseline", "bicycle"), "C of its bicycle model could not be identified"),
    ({"recommended": None}, (), "has no model None"),
    ({"format": "something"}, (), "is not an identification.json"),
    ({"models": [1]}, (), "cannot be read as a model: models is [1], not an object"),
    ({"models": {"roll-yaw": None}}, (), "roll-yaw is None, not an object"),
    ({"models": {"roll-yaw": {}}}, (), "parameters of roll-yaw is None"),
    ({"models": {"roll-yaw": {"parameters": {"C": 3}}}}, (), "C of roll-yaw is 3, not an object"),
    ({"models": {"roll-yaw": {"parameters": {"C": {"value": -3}}}}}, (), "is -3; it must be above 0"),
    ({"models": {"roll-yaw": {"parameters": {}}}}, (), "has none of Izz, k_phi"),
    ({}, ("--simulation", str(SWEEP)), "--model and --simulation are alternatives"),
]


def test_a_model_that_cannot_be_used_ends_with_a_sentence(
    engine: Engine, asked: RunProgram, tmp_path: Path
) -> None:
    for changes, more, words in UNUSABLE:
        code, _, err = asked(SWEEP, "--model", identification(tmp_path / "i.json", **changes), *more)
        assert code == 2 and words in err and not engine.given, words


MISTAKES: list[tuple[tuple[Any, ...], str]] = [
    (("--only", "tyre_relax"), "there is no effect 'tyre_relax'; did you mean tyre_relaxation?"),
    (("--only", ""), "'' contains no name; give a name or remove the option"),
    (("--only", "roll_dof,tyre_slip"), "can be missing from the roll-yaw baseline"),
    (("--only", "roll_steer", "--baseline", "kinematic"), "none of roll_steer can be missing"),
    (("--time-limit", "nan"), "the time limit is nan s; give a time above 0"),
    (("--time-limit", "inf"), "the time limit is inf s; give a time above 0"),
    (("--only", "tyre_saturation/brush"), "there is no effect 'tyre_saturation/brush'"),
    (("--only", "foo"), "there is no effect 'foo'; there are "),
    (("--hold-out", NOMINAL), "is a folder; give the path of a .BIN, .tlog or .csv in it"),
    (("--only", "servo_lag", "--without", "servo_lag"), "no candidate is left"),
    (("--hold-out", SWEEP), "run1 is used both to identify and to verify"),
    (("--baseline", "tricycle"), "'tricycle' is not one of"),
    (("--hold-out", "absent.BIN"), "absent.BIN"),
]


def test_mistakes_end_with_a_sentence(engine: Engine, asked: RunProgram) -> None:
    for arguments, words in MISTAKES:
        code, out, err = asked(SWEEP, *arguments)
        assert code == 2 and words in err and not out and not engine.given, words


def test_a_copy_of_a_recording_is_that_recording(engine: Engine, asked: RunProgram, tmp_path: Path) -> None:
    copy, doublet = tmp_path / "other.BIN", tmp_path / "judge.BIN"
    copy.write_bytes(SWEEP.read_bytes())
    doublet.write_bytes(DOUBLET.read_bytes())
    for arguments, words in (
        ((SWEEP, copy), "other is the same recording as run1, so its noise would count as signal"),
        ((SWEEP, "--hold-out", copy), "verify (it is the same recording as run1); verify on another"),
        ((SWEEP, "--hold-out", DOUBLET, "--hold-out", doublet), "judge is the same recording as run4"),
        ((SWEEP, "--simulation", copy), "other is both the recording and the simulation"),
    ):
        code, _, err = asked(*arguments)
        assert code == 2 and words in err and not engine.given


def changed(run: Recording, of: slice, shift: float = 0.0, digits: int = 9) -> Recording:
    """A copy of a part of a run, exported by another program."""
    r = run["r"]
    yaw = replace(r, t=r.t[of] + shift, x=np.round(r.x[of], digits))
    span = float(yaw.t[0]), float(yaw.t[-1])
    return replace(
        run, channels={**run.channels, "r": yaw}, span=span, sources=((f"cut{shift}.csv", f"{of}"),)
    )


def test_a_cut_shifted_or_rounded_copy_and_each_log_of_a_pair_are_that_recording() -> None:
    run = read_runs(str(SWEEP))[0]
    middle = slice(run["r"].x.size // 4, run["r"].x.size // 2)
    for copy in (changed(run, middle), changed(run, middle, 100.0), changed(run, slice(None), 3.0, 4)):
        assert same_recording(run, copy) and same_recording(copy, run)
    noise = np.random.default_rng(1).normal(0.0, 0.003, run["r"].x.size)
    repeat = replace(run["r"], x=run["r"].x + noise)
    again = replace(run, channels={**run.channels, "r": repeat}, sources=(("again.csv", "1"),))
    assert not same_recording(run, again)
    assert not same_recording(run, read_runs(str(NOMINAL / "run2.BIN"))[0])

    later = replace(run, span=(run.span[1] + 1.0, run.span[1] + 9.0))  # of one file
    pair = replace(run, sources=(*run.sources, ("run1.tlog", "0" * 64)))
    assert not same_recording(run, later) and same_recording(run, pair)
    assert not same_recording(pair, later)
    telemetry, other = (
        read_runs(str(NOMINAL.parent / log))[0] for log in ("nominal/run1.tlog", "defaults/run1.tlog")
    )
    assert same_recording(run, telemetry) and not same_recording(run, other)


def test_ctrl_c_once_ends_with_what_is_there(engine: Engine, asked: RunProgram, tmp_path: Path) -> None:
    seen: list[bool] = []

    def pressed(stop: Callable[[], bool]) -> None:
        seen.append(stop())
        os.kill(os.getpid(), signal.SIGINT)
        seen.append(stop())

    engine.before, before = pressed, signal.getsignal(signal.SIGINT)
    code, out, err = asked(SWEEP)
    assert seen == [False, True]
    assert code == 130 and "- Stopped by hand after" in out and "Ctrl-C again to quit" in err
    assert "stopped by hand" in (tmp_path / "out" / "diagnosis.json").read_text()
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_twice_gives_up(engine: Engine, asked: RunProgram, tmp_path: Path) -> None:
    def pressed(stop: Callable[[], bool]) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    engine.before = pressed
    assert asked(SWEEP).code == 130
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_refused_data_leave_a_report_in_the_place_of_an_older_one(
    engine: Engine, asked: RunProgram, tmp_path: Path
) -> None:
    asked(SWEEP)
    for answer in (REFUSED, DataRefused("run1 has no steering to speak of: 3 us")):
        engine.answer = answer
        code, out, err = asked(SWEEP)
        assert code == 3 and "REFUSED\nrun1 has no steering" in out and "the data were refused" in err
        document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
        assert document["verdict"] == "refused" and "no steering" in document["sentence"]
        assert EXPLAINED.findings[0].equation not in (tmp_path / "out" / "diagnosis.html").read_text()


def test_sizes_of_the_vehicle_file_that_matter_reach_the_diagnosis_and_the_plan(
    engine: Engine, run_program: RunProgram, tmp_path: Path
) -> None:
    vehicle = tmp_path / "rover.toml"
    text = (DATA / "rover.toml").read_text(encoding="utf-8")
    vehicle.write_text(text.replace("servo_lag = 0.040", "servo_lag = 0.015"), encoding="utf-8")
    own, out = ("--vehicle", vehicle), tmp_path / "out"
    code, printed, err = run_program("diagnose", SWEEP, DOUBLET, *own, "--out", out, "--json")
    assert code == 0 and json.loads(printed)["findings"][0]["effect"] == "steering_backlash"
    assert "EXPLAINED" in err  # stdout has the document alone
    spread = tolerances_of(load(vehicle))
    assert spread.lag == 0.015 and engine.given["settings"].spread == spread
    assert run_program("plan", *own, "--sweep", "150@2.4").code == 0
    assert engine.given["spread"] == spread
