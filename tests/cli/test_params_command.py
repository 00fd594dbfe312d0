"""`rover-sweep params` on the embedded rover: compared, set, read into a file; and its mistakes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from program_calls import RunProgram

from firmware_params.param_files import read, shipped
from sitl import launcher


@pytest.fixture
def rover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[launcher.Running]:
    """A rover as it comes, and an empty folder from which the program is called."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with launcher.start_embedded(tmp_path / "rover", speedup=8) as running:
        yield running


def saved(rover: launcher.Running) -> str:
    return (rover.directory / "parameters.txt").read_text()


@pytest.mark.parametrize("via", ["mavlink", "mavsdk"])
def test_compared_set_booted_and_the_same(run_program: RunProgram, rover: launcher.Running, via: str) -> None:
    where = ("--connect", rover.connection, "--via", via)
    before = saved(rover)
    done = run_program("params", "diff", *where)
    assert done.code == 1 and saved(rover) == before
    assert done.err.endswith(f"next: rover-sweep params push identification --connect {rover.connection}\n")
    rows = {line.split()[0]: line for line in done.out.splitlines() if line.strip()}
    assert rows["SCHED_LOOP_RATE"].split()[1:4] == ["50", "100", "yes"]
    assert "SCR_HEAP_SIZE" not in rows  # behind a switch that is off, and right there
    done = run_program("params", "push", "--json", "--yes", *where)
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert {"name": "SCHED_LOOP_RATE", "old": 50.0, "value": 100.0, "reboot": True} in found["set"]
    assert found["differences"] == found["reboot_due"] == []
    assert "rebooting the rover to apply SCR_ENABLE, SCHED_LOOP_RATE" in done.err
    same = run_program("params", "diff", *where)
    assert same.out == "all parameters of identification are set on the rover\n"
    assert same.err == f"next: rover-sweep preflight --connect {rover.connection}\n"
    done = run_program("params", "pull", "all.param", *where)
    assert done.code == 0 and done.out == "" and "parameters of ArduRover 4.6.3" in done.err
    kept = {p.name: p.value for p in read(Path("all.param"))}
    assert kept["SCHED_LOOP_RATE"] == 100 and len(kept) > 200
    assert json.loads(run_program("params", "diff", "all.param", "--json", *where).out)["differences"] == []
    found = json.loads(run_program("params", "pull", "--json", *where).out)
    assert found["parameters"] == pytest.approx(kept, rel=1e-7)


def test_asked_before_it_is_set_and_before_the_reboot(run_program, rover, monkeypatch):
    push = ("params", "push", "--connect", rover.connection)
    before = saved(rover)
    done = run_program(*push)
    assert done.code == 2 and "give --yes" in done.err and saved(rover) == before
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    questions: list[str] = []

    def answer(*answers: bool) -> None:
        left = list(answers)
        questions.clear()
        monkeypatch.setattr("click.confirm", lambda words, **_: (questions.append(words), left.pop(0))[1])

    answer(False)
    done = run_program(*push, "--json")
    found = json.loads(done.out)  # also where nothing was done; what is asked about stands on stderr
    assert done.code == 1 and found["set"] == [] and len(found["differences"]) == 5
    assert "SCHED_LOOP_RATE" in done.err and questions == ["Set 5 parameters?"]
    assert saved(rover) == before
    answer(True, False)
    done = run_program(*push, "--json")
    assert done.code == 1 and json.loads(done.out)["reboot_due"] == ["SCR_ENABLE", "SCHED_LOOP_RATE"]
    assert questions[1] == "Reboot the rover to apply SCR_ENABLE, SCHED_LOOP_RATE?"
    answer(True)
    done = run_program(*push)
    assert done.code == 0 and questions == ["Reboot the rover to apply SCR_ENABLE, SCHED_LOOP_RATE?"]
    assert run_program(*push).code == 0 and len(questions) == 1


NOBODY = ("--connect", "tcp:127.0.0.1:1")


@pytest.mark.parametrize(
    ("arguments", "content", "code", "said"),
    [
        (("diff", *NOBODY), None, 4, "cannot open tcp:127.0.0.1:1: Connection refused"),
        (("pull", "--connect", "nonsense"), None, 2, "connection 'nonsense' is not understood"),
        (("diff", "--connect", "/dev/null"), None, 4, "/dev/null is not a serial port; "),
        (("diff", "none.param", *NOBODY), None, 2, "there is no file none.param"),
        (("diff", "f.param", *NOBODY), b"ONE 2 3", 2, "f.param, line 1: 'ONE 2 3' is not NAME value"),
        (("diff", "f.param", *NOBODY), b"\xff\xfe\x00", 2, "it is not text"),
        (("diff", "f.param", *NOBODY), b"# nothing", 2, "f.param holds no parameter"),
        (("diff", "f.param", *NOBODY), b"ONE 1e39", 2, "is not a value that a rover can hold"),
        (("push", "f.param", "--yes", *NOBODY), b"ONE nan", 2, "is not a value that a rover can hold"),
        (("diff", "f.param", *NOBODY), b"A_NAME_OF_MANY_LETTERS 1", 2, "at most 16 characters"),
        (("diff", ".", *NOBODY), None, 2, ". cannot be read (Is a directory)"),
        (("pull", "no/where.param", *NOBODY), None, 2, "there is no folder no"),
    ],
)
def test_mistakes_are_one_sentence(run_program, tmp_path, monkeypatch, arguments, content, code, said):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        Path("f.param").write_bytes(content)
    done = run_program("params", *arguments)
    assert done.code == code and said in done.err and done.err.count("\n") == 1 and done.out == ""


def test_the_shipped_files_are_read_and_what_a_rover_counts_is_left_out(tmp_path: Path) -> None:
    from rover_sweep.vehicle.parameters import wanted_of

    assert wanted_of("raw_imu") == read(shipped("raw_imu"))
    own = tmp_path / "own.param"
    own.write_text("STAT_BOOTCNT 5\nSTAT_RESET 1\nBARO1_GND_PRESS 100965.6\nMIS_TOTAL 2\nBARO1_DEVID 3\n")
    assert [p.name for p in wanted_of(str(own))] == ["STAT_RESET", "BARO1_DEVID"]
