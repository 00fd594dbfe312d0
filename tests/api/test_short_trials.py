"""Many trials of some seconds, of any shape, sampled coarsely, are joined and identified from."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from small_car import Law, Recorder, SmallCar, by_hand, sine, step

import rover_sweep as rs
from rover_sweep.cli.main import run as program

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
