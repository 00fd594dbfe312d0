"""`rover-sweep diagnose`: what the engine is given, what comes out, what ends with a sentence."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fabricated_diagnoses import EXPLAINED, NONE, REFUSED
from fabricated_engine import Engine, ProgramResult

from rover_sweep.api.read import same_recording
from rover_sweep.cli.driving import shown_results
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
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
    assert code == 0
    assert out.startswith("EXPLAINED\nPlay in the steering")
    *_, report, following = out.rstrip().splitlines()
    assert report == f"report: {tmp_path}/out/diagnosis.html"
    assert following == f"next: rover-sweep gains {tmp_path}/out"
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [(r["role"], r["name"]) for r in document["recordings"]] == [("fit", "run1"), ("held out", "run4")]
    assert all(len(r["sources"][0]["sha256"]) == 64 for r in document["recordings"])
    assert document["vehicle"]["file"] == "rover.toml" and document["baseline"] == "roll-yaw"


def test_doublets_are_held_out_unless_other_runs_are(engine: Engine, asked: RunProgram) -> None:
    asked(SWEEP, DOUBLET)
    assert [r.name for r in engine.given["runs"]] == ["run1"]
    assert [r.name for r in engine.given["held_out"]] == ["run4"]
    asked(SWEEP, DOUBLET, "--hold-out", NOMINAL / "run2.BIN")
    assert [r.name for r in engine.given["runs"]] == ["run1", "run4"]
    assert [r.name for r in engine.given["held_out"]] == ["run2"]
    assert all("delta" in r for r in (*engine.given["runs"], *engine.given["held_out"]))


def test_what_is_missing_is_said_where_nothing_was_held_out(engine: Engine, asked: RunProgram) -> None:
    assert "- No run was held out" in asked(SWEEP).out
    assert "No run was held out" not in asked(SWEEP, DOUBLET).out


def test_options_become_settings(engine: Engine, asked: RunProgram) -> None:
    asked(
        SWEEP,
        "--baseline",
        "bicycle",
        "--only",
        "servo_lag,tyre_relaxation",
        "--without",
        "servo_lag",
        "--time-limit",
        "12",
        "--seed",
        "7",
    )
    settings = engine.given["settings"]
    assert (settings.baseline, settings.time_limit, settings.seed) == ("bicycle", 12.0, 7)
    assert settings.candidates(("roll_steer", "servo_lag", "tyre_relaxation")) == ("tyre_relaxation",)
    assert engine.given["rover"].mass == pytest.approx(2.66)


def test_json_leaves_stdout_to_the_document(engine: Engine, asked: RunProgram) -> None:
    code, out, err = asked(SWEEP, DOUBLET, "--json")
    assert code == 0 and json.loads(out)["findings"][0]["effect"] == "steering_backlash"
    assert "EXPLAINED" in err


def test_a_simulation_stands_beside_the_recording(engine: Engine, asked: RunProgram) -> None:
    asked(SWEEP, "--simulation", DATA / "ardurover-4.6.3" / "stock" / "run1.BIN")
    assert [r.name for r in engine.given["simulated"]] == ["stock/run1"]
    _, out, _ = asked(SWEEP, DOUBLET, "--full")
    assert "--full" not in out
    code, _, err = asked(SWEEP, "--simulation", SWEEP)
    assert code == 2 and "both the recording and the simulation" in err


@pytest.mark.parametrize("full", [False, True])
def test_the_comparison_with_a_simulation_is_the_answer(
    engine: Engine, asked: RunProgram, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, full: bool
) -> None:
    rover = Geometry(mass=2.66, a=0.203, b=0.188, yaw_inertia=0.07)
    engine.answer = replace(EXPLAINED, model=AugmentedModel("bicycle", rover, (), {}, 2.0))

    def compare(*given: Any) -> Path:
        given[-1].print("THEY AGREE")
        return tmp_path / "comparison.json"

    monkeypatch.setattr(shown_results, "show_compared", compare)
    simulated = DATA / "ardurover-4.6.3" / "stock" / "run1.BIN"
    _, out, _ = asked(SWEEP, "--simulation", simulated, *(["--full"] if full else []))
    assert "THEY AGREE" in out and ("EXPLAINED" in out) is full


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


@pytest.mark.parametrize(
    ("changes", "more", "words"),
    [
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
    ],
)
def test_a_model_that_cannot_be_used_ends_with_a_sentence(
    changes: dict[str, Any],
    more: tuple[str, ...],
    words: str,
    engine: Engine,
    asked: RunProgram,
    tmp_path: Path,
) -> None:
    code, _, err = asked(SWEEP, "--model", identification(tmp_path / "i.json", **changes), *more)
    assert code == 2 and words in err and not engine.given


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
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
    ],
)
def test_mistakes_end_with_a_sentence(
    arguments: tuple[Any, ...], words: str, engine: Engine, asked: RunProgram
) -> None:
    code, out, err = asked(SWEEP, *arguments)
    assert code == 2 and words in err and not out and not engine.given


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


def test_runs_of_one_file_stand_apart_and_a_pair_is_each_of_its_logs() -> None:
    run = read_runs(str(SWEEP))[0]
    later = replace(run, span=(run.span[1] + 1.0, run.span[1] + 9.0))
    pair = replace(run, sources=(*run.sources, ("run1.tlog", "0" * 64)))
    assert not same_recording(run, later) and same_recording(run, pair)
    assert not same_recording(pair, later)


def changed(run: Recording, of: slice, shift: float = 0.0, digits: int = 9) -> Recording:
    """A copy of a part of a run, exported by another program."""
    r = run["r"]
    yaw = replace(r, t=r.t[of] + shift, x=np.round(r.x[of], digits))
    span = float(yaw.t[0]), float(yaw.t[-1])
    return replace(
        run, channels={**run.channels, "r": yaw}, span=span, sources=((f"cut{shift}.csv", f"{of}"),)
    )


def test_a_cut_shifted_or_rounded_copy_is_that_recording_and_a_repeat_is_not() -> None:
    run = read_runs(str(SWEEP))[0]
    middle = slice(run["r"].x.size // 4, run["r"].x.size // 2)
    for copy in (changed(run, middle), changed(run, middle, 100.0), changed(run, slice(None), 3.0, 4)):
        assert same_recording(run, copy) and same_recording(copy, run)
    noise = np.random.default_rng(1).normal(0.0, 0.003, run["r"].x.size)
    repeat = replace(run["r"], x=run["r"].x + noise)
    again = replace(run, channels={**run.channels, "r": repeat}, sources=(("again.csv", "1"),))
    assert not same_recording(run, again)
    assert not same_recording(run, read_runs(str(NOMINAL / "run2.BIN"))[0])


def test_the_two_logs_of_one_drive_are_one_recording() -> None:
    onboard, telemetry = (read_runs(str(SWEEP.with_suffix(suffix)))[0] for suffix in (".BIN", ".tlog"))
    other = read_runs(str(NOMINAL.parent / "defaults" / "run1.tlog"))[0]
    assert same_recording(onboard, telemetry) and not same_recording(onboard, other)


def test_ctrl_c_once_ends_with_what_is_there(engine: Engine, asked: RunProgram, tmp_path: Path) -> None:
    seen: list[bool] = []

    def pressed(stop: Callable[[], bool]) -> None:
        seen.append(stop())
        os.kill(os.getpid(), signal.SIGINT)
        seen.append(stop())

    engine.before, before = pressed, signal.getsignal(signal.SIGINT)
    code, out, err = asked(SWEEP, DOUBLET)
    assert seen == [False, True]
    assert code == 130 and "- Stopped by hand after" in out and "Ctrl-C again to quit" in err
    assert "stopped by hand" in (tmp_path / "out" / "diagnosis.json").read_text()
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_twice_gives_up(engine: Engine, asked: RunProgram, tmp_path: Path) -> None:
    def pressed(stop: Callable[[], bool]) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    engine.before = pressed
    assert asked(SWEEP, DOUBLET).code == 130
    assert not (tmp_path / "out" / "diagnosis.json").exists()


@pytest.mark.parametrize("answer", [REFUSED, DataRefused("run1 has no steering to speak of: 3 us")])
def test_refused_data_leave_a_report_and_say_so(
    answer: Any, engine: Engine, asked: RunProgram, tmp_path: Path
) -> None:
    engine.answer = answer
    code, out, err = asked(SWEEP)
    assert code == 3 and "REFUSED\nrun1 has no steering" in out and "the data were refused" in err
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["verdict"] == "refused" and "no steering" in document["sentence"]


def test_an_older_report_does_not_outlive_a_new_one(
    engine: Engine, asked: RunProgram, tmp_path: Path
) -> None:
    asked(SWEEP, DOUBLET)
    engine.answer = NONE
    asked(SWEEP, DOUBLET)
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"] == "none"
    assert EXPLAINED.findings[0].equation not in (tmp_path / "out" / "diagnosis.html").read_text()
