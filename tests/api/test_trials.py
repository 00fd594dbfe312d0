"""Runs of many short trials, of a source of trials, smoothed and divided runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from small_car import Law, Recorder, SmallCar, by_hand, sine, step

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import material
from rover_sweep.api.read import divided
from rover_sweep.cli.main import run
from rover_sweep.data.recording import Kind, Recording, Signal
from rover_sweep.errors import DataRefused

MAP = {"time": "t", "delta": "steer", "r": "r", "ay": "ay", "speed": "v", "trial": "trial"}
ONLY_R = {k: v for k, v in MAP.items() if k != "ay"}
STEPS = [step(side * size) for size in (0.1, 0.15, 0.2) for side in (1, -1)] * 3
SINES = [sine(hz) for hz in (0.3, 0.5, 0.8, 1.2, 1.8, 2.5)] * 2
BY_HAND = [by_hand(seed) for seed in range(14)]
CAPTURED = Recorder(rate=20, smooth=51)  # motion capture at 20 Hz, smoothed over 0.1 s


@pytest.fixture
def rover(tmp_path: Path) -> Path:
    path = tmp_path / "rover.toml"
    path.write_text(
        "[vehicle]\nmass = 3.0\ncg_to_front_axle = 0.16\ncg_to_rear_axle = 0.16\nyaw_inertia = 0.05\n"
    )
    return path


@pytest.mark.parametrize(
    ("laws", "seconds", "recorder"),
    [
        pytest.param(STEPS, 6.0, Recorder(rate=40), id="steps"),
        pytest.param(BY_HAND, 5.0, CAPTURED, id="by hand"),
    ],
)
def test_the_car_is_found_from_short_trials(
    laws: Sequence[Law], seconds: float, recorder: Recorder, rover: Path, tmp_path: Path
) -> None:
    source = recorder.write(tmp_path / "trials.csv", SmallCar(), laws, seconds)
    runs = rs.read(source, columns=MAP, vehicle=rover)
    assert len(runs) == len(laws) and {run.kind for run in runs} == {"other"}
    found = rs.identify(runs, bootstrap=0)
    assert all(verdict.keep and "short trial" in verdict.sentence for verdict in found.coherence)
    assert found.recommended == "bicycle"
    bicycle = found.models["bicycle"]
    assert bicycle.verdict.level in ("good", "acceptable")
    assert bicycle.fit["C"].value == pytest.approx(45.0, rel=0.15)
    assert bicycle.fit["tau"].value == pytest.approx(0.06, abs=0.015)


def test_the_yaw_rate_alone_gives_wheelbase_and_delay(rover: Path, tmp_path: Path) -> None:
    source = Recorder(rate=40).write(tmp_path / "trials.csv", SmallCar(), BY_HAND, 3.0, speed=1.0)
    found = rs.identify(rs.read(source, columns=ONLY_R, vehicle=rover), bootstrap=0, fit=["r"])
    kinematic = found.models["kinematic"]
    assert kinematic.fit["L_eff"].value == pytest.approx(0.32, rel=0.1)
    assert kinematic.fit["tau"].value == pytest.approx(0.06, abs=0.03)
    assert found.recommended in ("kinematic", "bicycle")


def test_trials_of_constant_steering_are_named_and_left_out(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the whole trial as the run: they divided by zero, or were listed as "keep"."""
    laws = [sine(0.8, 0.0), *SINES, sine(0.8, 0.0)]
    source = Recorder().write(tmp_path / "trials.csv", SmallCar(), laws, 6.0)
    assert len(rs.read(source, columns=MAP, vehicle=rover)) == len(SINES)
    columns = {**MAP, "runs": "whole"}
    (tmp_path / "map.toml").write_text("".join(f'{k} = "{v}"\n' for k, v in columns.items()))
    assert run(["coherence", "--json", source, "--columns", str(tmp_path / "map.toml")]) == 0
    verdicts = {v["run"]: v for v in json.loads(capsys.readouterr().out)}
    idle = ("trials 1", f"trials {len(laws)}")
    assert all(verdicts[name]["sentence"].startswith("discard: no excitation: ") for name in idle)
    runs = rs.read(source, columns=columns, vehicle=rover)
    found = rs.identify(runs, models=["bicycle"], bootstrap=0)
    assert {v.run for v in found.coherence if not v.keep} == {*idle}
    assert [run.name for run in found.groups[0].runs] == [v.run for v in found.coherence if v.keep]
    assert all(any(s.startswith(f"left out {name}: no excitation") for s in found.summary) for name in idle)
    left = rs.diagnose(runs[:6], baseline="bicycle", only=["transport_delay"], time_limit=0.1)
    assert left.verdict != "refused"
    assert any(s.startswith("left out trials 1: no excitation") for s in left.remarks)
    with pytest.raises(rs.DataRefused, match="no steering excitation in trials 1: "):
        rs.identify(runs[:1])
    assert rs.diagnose(runs[:1]).sentence.startswith("no steering excitation in trials 1: ")


def test_a_driver_on_a_track_is_no_doublet(rover: Path, tmp_path: Path) -> None:
    """A minute at straight steering with slow turns between was held out as a doublet."""
    law = lambda t: 0.2 * by_hand(3)(t / 8) * (by_hand(4)(t / 8) > 0)  # noqa: E731
    source = Recorder(rate=25).write(tmp_path / "lap.csv", SmallCar(), [law], 60.0)
    runs = rs.read(source, columns=MAP, vehicle=rover)
    assert {run.kind for run in runs} == {"other"}
    assert sum(run.span[1] - run.span[0] for run in runs) > 20.0


# ---- One trial of a CSV named as a source: read alone, or held out of the rest.


@pytest.fixture
def trials(rover: Path, tmp_path: Path) -> str:
    """Four trials of 16 s, driven by hand."""
    (tmp_path / "columns.toml").write_text("\n".join(f'{k} = "{v}"' for k, v in MAP.items()))
    return Recorder(rate=50).write(tmp_path / "drive.csv", SmallCar(), [by_hand(k) for k in range(4)], 16.0)


def test_a_trial_is_read_alone_or_left_out(trials: str, tmp_path: Path) -> None:
    other = Recorder(rate=50).write(tmp_path / "other.csv", SmallCar(), [by_hand(5)], 4.0)
    for sources, without, names in (
        ([f"{trials}:3"], (), ["drive 3"]),
        ([f"{trials}:3.0"], (), ["drive 3"]),
        ([trials], f"{trials}:3", ["drive 1", "drive 2", "drive 4"]),
        ([trials, other], trials, ["other 1"]),
    ):
        assert [r.name for r in rs.read(*sources, columns=MAP, without=without)] == names


def test_wrong_names_of_trials_are_refused(trials: str, tmp_path: Path) -> None:
    bare = {k: v for k, v in MAP.items() if k != "trial"}
    whole = Recorder(rate=50).write(tmp_path / "one.csv", SmallCar(), [by_hand(1)], 16.0)
    odd = tmp_path / "other.csv:3"
    odd.write_text(Path(trials).read_text())
    every = [f"{trials}:{k}" for k in range(1, 5)]
    for source, columns, without, words in (
        (f"{trials}:9", MAP, (), r"drive.csv has no trial '9'.* 1, 2, 3, 4"),
        (trials, MAP, every, "leave some to fit"),
        (trials, MAP, trials, "leaves out all"),
        (trials, MAP, "drvie.csv:3", r"without: drvie.csv:3 is none of the sources \(.*drive.csv"),
        (f"{whole}:1", bare, (), "only one run"),
        (odd, MAP, (), "cannot be read"),  # its extension is not .csv
    ):
        with pytest.raises(rs.UsageError, match=words):
            rs.read(source, columns=columns, without=without)


@pytest.mark.parametrize(("command", "option"), [("identify", "--verify"), ("diagnose", "--hold-out")])
def test_the_command_holds_a_trial_out(
    command: str, option: str, trials: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = {}
    shown = "show_" + {"identify": "identified", "diagnose": "diagnosed"}[command]

    def keep(*given: object, **options: object) -> None:
        seen["given"] = given

    monkeypatch.setattr(f"rover_sweep.cli.driving.shown_results.{shown}", keep)
    common = ["--columns", str(tmp_path / "columns.toml"), "--vehicle", str(tmp_path / "rover.toml")]
    assert run([command, trials, option, f"{trials}:2", *common, "--out", str(tmp_path / "out")]) == 0
    fitted, kept = (
        seen["given"][:2] if command == "identify" else (seen["given"][0].runs, seen["given"][0].held_out)
    )
    assert [r.name for r in fitted] == ["drive 1", "drive 3", "drive 4"]
    assert [r.name for r in kept] == ["drive 2"]


# ---- Driving by hand in short trials, smoothed and at 20 Hz, of a car that hides nothing: no name is said.


# ---- Which runs are identified from, and which are kept for verification.


def recording(name: str, kind: Kind) -> Recording:
    t = np.arange(0.0, 10.0, 0.01)
    channels = {"r": Signal(t, np.zeros(t.size), "rad/s", "test")}
    return Recording(name, channels, (0.0, 10.0), kind, sources=((name, name),))


def names(runs: tuple[Recording, ...]) -> list[str]:
    return [run.name for run in runs]


def test_a_sweep_about_an_offset_is_not_mixed_with_straight_ones_and_that_is_said() -> None:
    runs = [
        recording("bent", "bias_sweep"),
        recording("a", "sweep"),
        recording("b", "multisine"),
        recording("d", "doublet"),
    ]
    fitted, checks = divided(runs)
    assert (names(fitted), names(checks)) == (["a", "b"], ["d"])
    (note,) = fitted[0].notes
    assert note.level == "warning" and note.text.startswith("bent is not fitted")
    assert fitted[1].notes == ()


def test_runs_of_one_kind_are_all_used_but_doublets_alone_need_a_sweep() -> None:
    for kind in ("sweep", "bias_sweep", "other"):
        fitted, checks = divided([recording("a", kind), recording("b", kind)])
        assert (names(fitted), checks) == (["a", "b"], ()) and all(not run.notes for run in fitted)
    for doublets, words in (("a", "^a is a doublet; a sweep"), ("ab", "^a, b are doublets; a sweep")):
        with pytest.raises(DataRefused, match=words):
            divided([recording(name, "doublet") for name in doublets])
    runs = [recording("bent", "bias_sweep"), recording("a", "sweep"), recording("d", "doublet")]
    given = material(runs, ())  # a diagnosis drives every run by itself and keeps them all
    assert (names(given.runs), names(given.held_out)) == (["bent", "a"], ["d"])


def test_a_car_slower_than_a_walk_drives(rover: Path, tmp_path: Path) -> None:
    source = Recorder(noise=0.005).write(tmp_path / "trials.csv", SmallCar(), STEPS, 3.0, speed=0.28)
    runs = rs.read(source, columns=ONLY_R, vehicle=rover)
    assert len(runs) == len(STEPS)
    fitted = rs.identify(runs, bootstrap=0).models["kinematic"].fit
    assert fitted["L_eff"].value == pytest.approx(0.32, rel=0.1)


@pytest.mark.slow
def test_nothing_is_named_in_smoothed_short_trials(rover: Path, tmp_path: Path) -> None:
    laws = [by_hand(seed) for seed in range(12)]
    recorder = Recorder(rate=20, smooth=51)
    source = recorder.write(tmp_path / "trials.csv", SmallCar(delay=0.03), laws, 3.5)
    fitted = rs.read(source, columns=ONLY_R, vehicle=rover, without=f"{source}:12")
    held = rs.read(f"{source}:12", columns=ONLY_R, vehicle=rover)
    only = ("servo_lag", "servo_rate_limit", "steering_backlash", "tyre_saturation")
    found = rs.diagnose(fitted, held, baseline="bicycle", only=only)
    assert found.verdict == "none" and not found.findings
    assert any(
        "r was smoothed or resampled: its spectrum collapses above" in remark for remark in found.remarks
    )
    for stiffness in (found.parameters["Cf"], found.parameters["Cr"]):
        assert stiffness.low is not None and stiffness.high is not None
        assert stiffness.low < 45.0 < stiffness.high
    slow = SmallCar(delay=0.03, lag=0.2)
    source = recorder.write(tmp_path / "slow.csv", slow, laws, 3.5)
    found = rs.diagnose(rs.read(source, columns=ONLY_R, vehicle=rover), baseline="bicycle", only=only)
    assert [f.effect for f in found.findings] == ["servo_lag"]
