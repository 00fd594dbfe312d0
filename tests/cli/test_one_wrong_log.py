"""One wrong log among others: it is named and left out, and the analysis stays that of the rest."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from program_calls import ROVER, RunProgram

import rover_sweep as rs
from rover_sweep.api import driving, read
from rover_sweep.api.diagnosis_input import why_not_diagnosed
from rover_sweep.logs import read as log_reader
from rover_sweep.logs.read import read_logs

DATA = Path(__file__).parents[1] / "data"
RUN, OTHER = (str(DATA / "ardurover-4.6.3/nominal" / name) for name in ("run1.BIN", "run4.BIN"))
FACTORY = str(DATA / "ardurover-4.6.3/defaults/run1.BIN")


@pytest.fixture
def copter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A log that says that it is a copter's."""
    path = tmp_path / "hexa.BIN"
    path.write_bytes(Path(OTHER).read_bytes() + bytes(1))

    def named(source: str, **more: Any) -> Any:
        logs = read_logs(source, **more)
        return tuple(replace(log, vehicle="copter") for log in logs) if source == str(path) else logs

    for place in (driving, log_reader):
        monkeypatch.setattr(place, "read_logs", named)
    return str(path)


def test_a_copters_log_is_named_and_the_rest_identified(run_program: RunProgram, copter: str, tmp_path: Path):
    call = ("identify", RUN, copter, "--vehicle", ROVER, "--bootstrap", "0", "--models", "bicycle", "--json")
    done = run_program(*call, "--out", str(tmp_path / "report"))
    assert done.code == 0, done.err
    assert "left out: hexa is the log of a copter" in " ".join(done.err.split())
    assert json.loads(done.out)["format"] == "rover-sweep identification"
    assert not (tmp_path / "report" / "driving.html").exists()


def test_without_a_vehicle_file_it_is_named_too(copter: str) -> None:
    alone, both = rs.identify_driving(RUN), rs.identify_driving(RUN, copter)
    assert any("left out: hexa is the log of a copter" in words for words in both.read)
    assert both.level == alone.level and both.sources == ("run1.BIN", "hexa.BIN")
    assert both.numbers["curvature"].value == alone.numbers["curvature"].value
    assert not any("left out" in words for words in alone.read)


def test_a_wrong_log_alone_is_refused(run_program: RunProgram, copter: str, tmp_path: Path) -> None:
    done = run_program("identify", copter, "--vehicle", ROVER, "--out", str(tmp_path / "report"))
    assert done.code == 3 and "is the log of a copter" in done.err
    with pytest.raises(rs.DataRefused, match="copter"):
        rs.read(copter)


def test_a_damaged_log_does_not_hide_the_others(tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.BIN"
    damaged.write_bytes(b"no log at all" * 1000)
    runs = rs.read(RUN, damaged)
    assert [run.name for run in runs] == ["run1"]
    assert any(note.text.startswith("left out: damaged.BIN is not a DataFlash log") for note in runs[0].notes)
    found = rs.identify_driving(RUN, damaged)
    assert found.level == "good" and any("damaged.BIN is not" in words for words in found.read)


def test_a_factory_sweep_with_a_vehicle_file_stays_an_identification(
    run_program: RunProgram, copter: str, tmp_path: Path
) -> None:
    """Steering logged at 10 Hz, next to a log of another vehicle."""
    call = ("identify", FACTORY, copter, "--vehicle", ROVER, "--bootstrap", "0", "--models", "bicycle")
    done = run_program(*call, "--out", str(tmp_path / "report"), "--json")
    assert done.code == 0 and json.loads(done.out)["format"] == "rover-sweep identification", done.err


def two_rovers() -> tuple[Any, ...]:
    """Two runs with the numbers of two boards."""
    first, second = rs.read(RUN, str(DATA / "ardurover-4.6.3/nominal/run2.BIN"), vehicle=ROVER)
    return replace(first, vehicle={"board": "1"}), replace(second, vehicle={"board": "2"})


def test_two_rovers_have_no_next_step_that_is_refused(
    run_program: RunProgram, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = two_rovers()
    assert "not from the same rover" in why_not_diagnosed(runs, ()) and not why_not_diagnosed(runs[:1], ())
    monkeypatch.setattr(read, "load_steered", lambda *given: runs)
    call = ("identify", "a.BIN", "b.BIN", "--vehicle", ROVER, "--bootstrap", "0", "--models", "bicycle")
    monkeypatch.chdir(tmp_path)
    for name in ("a.BIN", "b.BIN"):
        (tmp_path / name).write_bytes(Path(RUN).read_bytes())
    done = run_program(*call, "--out", "report")
    said = " ".join(done.out.split())
    assert done.code == 0 and "rover-sweep diagnose" not in said, done
    assert "next: give other runs" in said and "give runs of one rover only" in said
