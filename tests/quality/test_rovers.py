"""Runs of two rovers given together are named; runs of one rover are not accused, whatever changes on it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from damage import NOMINAL, damaged

import rover_sweep as rs
from rover_sweep.cli.main import run as program
from rover_sweep.data.recording import Recording
from rover_sweep.errors import DataRefused
from rover_sweep.logs.applet import identity
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.quality.faults import each_with_length, faults_of
from rover_sweep.quality.rovers import TWO_ROVERS, with_rovers

DATA = NOMINAL.parents[1]
VEHICLE = DATA / "rover.toml"
CONCEALED = DATA / "concealed-ardurover"
SETS = sorted(p for p in CONCEALED.iterdir() if p.is_dir())


def accused(runs: tuple[Recording, ...]) -> list[str]:
    return [note.text for run in with_rovers(runs) for note in run.notes if note.fault == TWO_ROVERS]


def of(folder: Path) -> tuple[Recording, ...]:
    return tuple(run for path in sorted(folder.glob("*.BIN")) for run in read_runs(str(path)))


@pytest.mark.parametrize("folder", [SETS[0], SETS[-1], NOMINAL], ids=lambda p: p.name)
def test_runs_of_one_rover_are_not_accused(folder: Path) -> None:
    assert accused(of(folder)) == []


def first(name: str) -> Recording:
    (run,) = read_runs(str(CONCEALED / name / "run1.BIN"))
    return run


@pytest.mark.parametrize("names", [("a", "e"), ("c", "d")])
def test_other_rovers_are_told_by_their_answers(names: tuple[str, str]) -> None:
    (text,) = accused((first(names[0]), first(names[1])))
    assert "are not from the same rover, or it was changed between them: at 2." in text


def test_a_run_whose_steering_has_the_other_sign_is_named() -> None:
    one = of(NOMINAL)[0]
    pwm = one["pwm"]
    turned = replace(one, name="turned", channels={**one.channels, "pwm": replace(pwm, x=3000.0 - pwm.x)})
    (text,) = accused((one, turned))
    assert "as with the other sign of the steering" in text


def test_another_linkage_is_told_and_another_surface_or_noise_is_no_other_rover(sweep: Recording) -> None:
    """A surface changes the answer to the steering, and leaves the roll for a_y as it is."""
    (text,) = accused((sweep, damaged(sweep, **dict.fromkeys(("r", "ay", "p"), lambda x: 1.4 * x))))
    assert "yaw rate at low frequency for the same steering differs by 34 %" in text
    noise = np.random.default_rng(1)
    loud = lambda x: x + 0.2 * noise.standard_normal(x.size)  # noqa: E731
    for other in (
        damaged(sweep, r=lambda x: 0.85 * x, ay=lambda x: 0.7 * x, p=lambda x: 0.7 * x),
        damaged(sweep, p=lambda x: 0.6 * x),  # dry friction in the suspension
        damaged(sweep, r=loud, p=loud),
    ):
        assert accused((sweep, other)) == []


def test_boards_and_system_ids_tell_whatever_the_runs() -> None:
    one, two = (read_runs(str(NOMINAL / f"run{n}.BIN"))[0] for n in (1, 4))
    assert one.vehicle["system id"] == "1" and one.vehicle["SERVO1_TRIM"] == "1500"
    other = replace(two, vehicle={**two.vehicle, "system id": "7"})
    assert "system id 1 and 7" in accused((one, other))[0]
    boards = [
        replace(r, vehicle={"board": f"CubeOrange 0028001{n} 3432510D 37343231"})
        for n, r in ((1, one), (2, two))
    ]
    assert "00280011 3432510D 37343231 and CubeOrange 00280012" in accused(tuple(boards))[0]
    trimmed = replace(two, vehicle={**two.vehicle, "SERVO1_TRIM": "1520", "INS_GYR_ID": "3"})
    assert accused((one, trimmed)) == []


def test_the_board_is_read_from_the_banner() -> None:
    (log,) = read_logs(str(NOMINAL / "run1.BIN"))
    said = replace(log, marks=((1.0, "ChibiOS: 88b84600"), (1.0, "MatekH743 0028001F 3432510D 37343231")))
    assert identity(said)["board"] == "MatekH743 0028001F 3432510D 37343231"
    assert "board" not in identity(log)
    (telemetry,) = read_logs(str(NOMINAL / "run1.tlog"))
    assert identity(telemetry)["system id"] == "1"


def test_no_model_of_two_rovers_is_good(capsys: pytest.CaptureFixture[str]) -> None:
    """Also at 2.5 and 2.2 m/s, 120 and 240 us: the runs are named first."""
    paths = [str(CONCEALED / name / "run1.BIN") for name in ("c", "e")]
    assert program(["coherence", "--json", *paths]) == 0
    verdicts = json.loads(capsys.readouterr().out)
    assert [v["keep"] for v in verdicts] == [True, False]
    assert "are not from the same rover" in verdicts[1]["sentence"]
    runs = rs.read(*paths, vehicle=VEHICLE)
    found = rs.diagnose(runs)
    assert found.verdict == "refused" and "are not from the same rover" in found.sentence
    others = rs.read(str(NOMINAL / "run1.BIN"), str(CONCEALED / "c" / "run2.BIN"), vehicle=VEHICLE)
    result = rs.identify(others, models=("bicycle",), bootstrap=0)
    assert result.recommended is None and result.summary[0].startswith("use none of these models: ")
    assert "run1 and run2 are not from the same rover" in result.summary[0]


# ---- Recordings that nothing is wrong with are not accused: those of the project, and of real hardware.

CARS = ("dart_free_driving_2024", "umich_ardupilot_rover_circles_2017", "umich_nvidia_rover_joystick_2017")
LOGS = sorted(
    p for kind in ("BIN", "tlog") for p in DATA.rglob(f"*.{kind}") if not {"gains", "throttle"} & {*p.parts}
)


def test_the_recordings_are_there() -> None:
    assert len(LOGS) == 43


@pytest.mark.parametrize("path", LOGS, ids=lambda p: "/".join(p.relative_to(DATA).parts))
def test_a_sound_log_is_not_accused(path: Path) -> None:
    runs = read_runs(str(path))
    assert runs
    assert [fault.text for run in each_with_length(runs) for fault in faults_of(run)] == []


@pytest.mark.parametrize("name", CARS)
def test_a_real_car_is_not_accused(foreign_recordings: Path, name: str) -> None:
    try:
        runs = read_runs(
            str(foreign_recordings / "cars" / f"{name}.csv"),
            column_map=str(DATA / "cars" / f"{name}.columns.toml"),
        )
    except DataRefused as refusal:
        pytest.fail(str(refusal))
    assert [fault.text for run in each_with_length(runs) for fault in faults_of(run)] == []
