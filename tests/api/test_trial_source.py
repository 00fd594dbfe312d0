"""One trial of a CSV named as a source: read alone, or held out of the rest."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_car import Recorder, SmallCar, by_hand

import rover_sweep as rs
from rover_sweep.cli.main import run

MAP = {"time": "t", "delta": "steer", "r": "r", "ay": "ay", "speed": "v", "trial": "trial"}
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
