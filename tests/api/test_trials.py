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
from rover_sweep.cli.main import run as program
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
        pytest.param(SINES, 6.0, Recorder(), id="sines"),
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


@pytest.mark.parametrize("laws", [STEPS, BY_HAND], ids=["steps", "by hand"])
def test_the_yaw_rate_alone_gives_wheelbase_and_delay(
    laws: Sequence[Law], rover: Path, tmp_path: Path
) -> None:
    source = Recorder(rate=40).write(tmp_path / "trials.csv", SmallCar(), laws, 3.0, speed=1.0)
    found = rs.identify(rs.read(source, columns=ONLY_R, vehicle=rover), bootstrap=0, fit=["r"])
    kinematic = found.models["kinematic"]
    assert kinematic.fit["L_eff"].value == pytest.approx(0.32, rel=0.1)
    assert kinematic.fit["tau"].value == pytest.approx(0.06, abs=0.03)
    assert found.recommended in ("kinematic", "bicycle")


def test_trials_without_steering_are_left_out(rover: Path, tmp_path: Path) -> None:
    laws = [sine(0.8, 0.0), *SINES, sine(0.8, 0.002)]
    source = Recorder().write(tmp_path / "trials.csv", SmallCar(), laws, 4.0)
    assert len(rs.read(source, columns=MAP, vehicle=rover)) == len(SINES)


def test_trials_of_constant_steering_are_named_and_left_out(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the whole trial as the run: they divided by zero, or were listed as "keep"."""
    laws = [sine(0.8, 0.0), *SINES, sine(0.8, 0.0)]
    source = Recorder().write(tmp_path / "trials.csv", SmallCar(), laws, 6.0)
    columns = {**MAP, "runs": "whole"}
    (tmp_path / "map.toml").write_text("".join(f'{k} = "{v}"\n' for k, v in columns.items()))
    assert program(["coherence", "--json", source, "--columns", str(tmp_path / "map.toml")]) == 0
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


def test_a_car_slower_than_a_walk_drives(rover: Path, tmp_path: Path) -> None:
    source = Recorder(noise=0.005).write(tmp_path / "trials.csv", SmallCar(), STEPS, 3.0, speed=0.28)
    runs = rs.read(source, columns=ONLY_R, vehicle=rover)
    assert len(runs) == len(STEPS)
    fitted = rs.identify(runs, bootstrap=0).models["kinematic"].fit
    assert fitted["L_eff"].value == pytest.approx(0.32, rel=0.1)


def test_a_driver_on_a_track_is_no_doublet(rover: Path, tmp_path: Path) -> None:
    """A minute at straight steering with slow turns between was held out as a doublet."""
    law = lambda t: 0.2 * by_hand(3)(t / 8) * (by_hand(4)(t / 8) > 0)  # noqa: E731
    source = Recorder(rate=25).write(tmp_path / "lap.csv", SmallCar(), [law], 60.0)
    runs = rs.read(source, columns=MAP, vehicle=rover)
    assert {run.kind for run in runs} == {"other"}
    assert sum(run.span[1] - run.span[0] for run in runs) > 20.0


# ---- One trial of a CSV named as a source: read alone, or held out of the rest.

ROVER = """
[vehicle]
mass = 3.0
cg_to_front_axle = 0.16
cg_to_rear_axle = 0.16
"""


@pytest.fixture
def trials(tmp_path: Path) -> str:
    """Four trials of 16 s, driven by hand."""
    (tmp_path / "rover.toml").write_text(ROVER)
    (tmp_path / "columns.toml").write_text("\n".join(f'{k} = "{v}"' for k, v in MAP.items()))
    return Recorder(rate=50).write(tmp_path / "drive.csv", SmallCar(), [by_hand(k) for k in range(4)], 16.0)


def test_one_trial_is_read_alone(trials: str) -> None:
    assert [r.name for r in rs.read(f"{trials}:3", columns=MAP)] == ["drive 3"]
    assert [r.name for r in rs.read(f"{trials}:3.0", columns=MAP)] == ["drive 3"]


def test_a_trial_is_left_out_of_its_file(trials: str) -> None:
    rest = rs.read(trials, columns=MAP, without=f"{trials}:3")
    assert [r.name for r in rest] == ["drive 1", "drive 2", "drive 4"]


def test_an_unknown_trial_is_refused_with_those_that_are_there(trials: str) -> None:
    with pytest.raises(rs.UsageError, match=r"drive.csv has no trial '9'.* 1, 2, 3, 4"):
        rs.read(f"{trials}:9", columns=MAP)


def test_nothing_is_left_when_every_trial_is_held_out(trials: str) -> None:
    every = [f"{trials}:{k}" for k in range(1, 5)]
    with pytest.raises(rs.UsageError, match="leave some to fit"):
        rs.read(trials, columns=MAP, without=every)


def test_a_whole_file_is_left_out(trials: str, tmp_path: Path) -> None:
    other = Recorder(rate=50).write(tmp_path / "other.csv", SmallCar(), [by_hand(5)], 16.0)
    assert [r.name for r in rs.read(trials, other, columns=MAP, without=trials)] == ["other 1"]
    with pytest.raises(rs.UsageError, match="leaves out everything"):
        rs.read(trials, columns=MAP, without=trials)


def test_nothing_is_left_out_by_a_misspelt_name(trials: str) -> None:
    with pytest.raises(rs.UsageError, match=r"without: drvie.csv:3 is not among what is read \(.*drive.csv"):
        rs.read(trials, columns=MAP, without="drvie.csv:3")


def test_a_run_of_a_file_without_trials_has_its_number(tmp_path: Path) -> None:
    whole = Recorder(rate=50).write(tmp_path / "one.csv", SmallCar(), [by_hand(1)], 16.0)
    bare = {k: v for k, v in MAP.items() if k != "trial"}
    with pytest.raises(rs.UsageError, match="only one run"):
        rs.read(f"{whole}:1", columns=bare)


def test_a_colon_in_the_name_of_a_file_names_no_trial(trials: str, tmp_path: Path) -> None:
    odd = tmp_path / "drive.csv:3"
    odd.write_text(Path(trials).read_text())
    with pytest.raises(rs.UsageError, match="cannot be read"):  # its extension is not .csv
        rs.read(odd, columns=MAP)


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

SMOOTHED_MAP = {"time": "t", "delta": "steer", "r": "r", "speed": "v", "trial": "trial"}


@pytest.mark.slow
def test_nothing_is_named_in_smoothed_short_trials(tmp_path: Path) -> None:
    rover = tmp_path / "rover.toml"
    rover.write_text(
        "[vehicle]\nmass = 3.0\ncg_to_front_axle = 0.16\ncg_to_rear_axle = 0.16\nyaw_inertia = 0.05\n"
    )
    laws = [by_hand(seed) for seed in range(12)]
    recorder = Recorder(rate=20, smooth=51)
    source = recorder.write(tmp_path / "trials.csv", SmallCar(delay=0.03), laws, 3.5)
    fitted = rs.read(source, columns=SMOOTHED_MAP, vehicle=rover, without=f"{source}:12")
    held = rs.read(f"{source}:12", columns=SMOOTHED_MAP, vehicle=rover)
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
    found = rs.diagnose(rs.read(source, columns=SMOOTHED_MAP, vehicle=rover), baseline="bicycle", only=only)
    assert [f.effect for f in found.findings] == ["servo_lag"]


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


@pytest.mark.parametrize("kind", ["sweep", "bias_sweep", "other"])
def test_runs_of_one_kind_are_all_identified_from(kind: Kind) -> None:
    fitted, checks = divided([recording("a", kind), recording("b", kind)])
    assert (names(fitted), checks) == (["a", "b"], ())
    assert all(not run.notes for run in fitted)


def test_a_diagnosis_drives_every_run_by_itself_and_keeps_them_all() -> None:
    given = material(
        [recording("bent", "bias_sweep"), recording("a", "sweep"), recording("d", "doublet")], ()
    )
    assert (names(given.runs), names(given.held_out)) == (["bent", "a"], ["d"])


def test_doublets_alone_need_a_sweep() -> None:
    with pytest.raises(DataRefused, match="^a is a doublet; a sweep is needed: "):
        divided([recording("a", "doublet")])
    with pytest.raises(DataRefused, match="^a, b are doublets; a sweep is needed: "):
        divided([recording("a", "doublet"), recording("b", "doublet")])
