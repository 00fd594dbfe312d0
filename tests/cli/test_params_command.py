"""`rover-sweep params` on the embedded rover: compared, set, read into a file; and its mistakes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from program_calls import RunProgram

from firmware_params.param_files import read, shipped
from sitl import launcher

OWN = "ATC_STR_RAT_FF 0.3\nINS_POS1_X 0.1\nSCHED_LOOP_RATE 50\n"


@pytest.fixture
def rover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[launcher.Running]:
    """A rover as it comes, and an empty folder from which the program is called."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with launcher.start_embedded(tmp_path / "rover", speedup=8) as running:
        yield running


@pytest.fixture
def own(rover: launcher.Running) -> str:
    Path("own.param").write_text(OWN)
    return "own.param"


def saved(rover: launcher.Running) -> str:
    return (rover.directory / "parameters.txt").read_text()


@pytest.mark.parametrize("via", ["mavlink", "mavsdk"])
def test_compared_set_booted_and_the_same(run_program: RunProgram, rover: launcher.Running, via: str) -> None:
    where = ("--connect", rover.connection, "--via", via)
    before = saved(rover)
    done = run_program("params", "diff", *where)
    assert done.code == 1 and saved(rover) == before
    rows = {line.split()[0]: line for line in done.out.splitlines() if line.strip()}
    assert rows["SCHED_LOOP_RATE"].split()[1:4] == ["50", "100", "yes"]
    assert "SCR_HEAP_SIZE" not in rows  # behind a switch that is off, and right there
    done = run_program("params", "push", "--json", "--yes", *where)
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert {"name": "SCHED_LOOP_RATE", "old": 50.0, "value": 100.0, "reboot": True} in found["set"]
    assert found["differences"] == found["reboot_due"] == []
    assert "rebooting the rover to apply SCR_ENABLE, SCHED_LOOP_RATE" in done.err
    assert (
        run_program("params", "diff", *where).out == "all parameters of identification are set on the rover\n"
    )
    assert json.loads(run_program("params", "diff", "--json", *where).out)["differences"] == []


def test_a_value_that_float32_rounds_is_no_difference(
    run_program: RunProgram, rover: launcher.Running, own: str
) -> None:
    where = ("--connect", rover.connection)
    done = run_program("params", "push", own, "--yes", *where)
    assert done.code == 0 and "ATC_STR_RAT_FF 0.2 -> 0.3" in done.err and "rebooting" not in done.err
    done = run_program("params", "diff", own, "--json", *where)
    assert done.code == 0 and json.loads(done.out) == {"file": own, "differences": []}


@pytest.mark.parametrize("via", ["mavlink", "mavsdk"])
def test_all_of_them_into_a_file_and_back(run_program: RunProgram, rover: launcher.Running, via: str) -> None:
    where = ("--connect", rover.connection, "--via", via)
    done = run_program("params", "pull", "all.param", *where)
    assert done.code == 0 and done.out == "" and "parameters of ArduRover 4.6.3" in done.err
    kept = {p.name: p.value for p in read(Path("all.param"))}
    assert kept["SCHED_LOOP_RATE"] == 50 and len(kept) > 200
    assert run_program("params", "diff", "all.param", *where).code == 0
    found = json.loads(run_program("params", "pull", "--json", *where).out)
    assert found["parameters"] == pytest.approx(kept, rel=1e-7)
    assert run_program("params", "pull", *where).out == Path("all.param").read_text()


def test_asked_before_it_is_set_and_before_the_reboot(
    run_program: RunProgram, rover: launcher.Running, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_what_the_rover_does_not_have_is_told(run_program: RunProgram, rover: launcher.Running) -> None:
    Path("odd.param").write_text("NO_SUCH_ONE 3\nATC_STR_RAT_FF 0.25\n")
    done = run_program("params", "push", "odd.param", "--yes", "--json", "--connect", rover.connection)
    found = json.loads(done.out)
    assert done.code == 1 and [p["name"] for p in found["set"]] == ["ATC_STR_RAT_FF"]
    assert [(d["name"], d["found"]) for d in found["differences"]] == [("NO_SUCH_ONE", None)]
    assert "NO_SUCH_ONE does not exist on this vehicle" in done.err


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
def test_mistakes_are_one_sentence(
    run_program: RunProgram,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    content: bytes | None,
    code: int,
    said: str,
) -> None:
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
