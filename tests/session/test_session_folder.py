"""What stands in a session's folder, without any vehicle."""

from __future__ import annotations

import contextlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rover_sweep.api.read import load_runs
from rover_sweep.cli.main import run
from rover_sweep.cli.options import vehicle_path
from rover_sweep.data.recording import Recording, Signal
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Sweep, ThrottleSweep
from rover_sweep.session.content import FetchedLog, SessionRun
from rover_sweep.session.folder import Session, is_session, read_folder, without_run
from rover_sweep.session.session import origin_words, session_runs
from rover_sweep.vehicle.run.controls import MAY_BE_ARMED

MISSING = object()
PLAN = (
    SessionRun("sweep1", Sweep(amplitude=120), speed=2.4),
    SessionRun("bias", BiasSweep(amplitude=80, bias=-100)),
    SessionRun("multisine1", Multisine()),
    SessionRun("doublet", Doublet()),
)


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    session = Session.open(tmp_path / "s")
    session.plan(PLAN)
    session.on({"firmware": "ArduRover 4.6.3", "uid": 7})
    session.logs_before(((1, 100, 0),))
    session.logs_before(((1, 100, 0), (2, 200, 0)))  # only the first word counts
    for planned, state in zip(PLAN, ("done", "stopped", "cut", "done"), strict=True):
        tlog = session.tlog(planned.name)
        session.begun(planned, tlog, arming=True)
        session.ended(tlog, state, "why", left_armed=False, span=(1.5, 20.25), number=3)  # type: ignore[arg-type]
        session.judged(tlog, {"sentence": "keep", "source": tlog})
    session.fetched(FetchedLog("log4.BIN", 4, 10, 99))
    session.fetched(FetchedLog("log4.BIN", 4, 20, 99, ("sweep1",)))
    found = read_folder(tmp_path / "s")
    assert found == session.content
    assert found.logs == (FetchedLog("log4.BIN", 4, 20, 99, ("sweep1",)),)
    assert found.logs_before == ((1, 100, 0),)
    assert found.run("sweep1").verdict == {"sentence": "keep", "source": "sweep1.tlog"}
    assert [run.name for run in found.to_drive] == ["bias", "multisine1"]


def test_a_run_is_driven_again_where_the_plan_says_otherwise_than_it_was(tmp_path: Path) -> None:
    session = Session.open(tmp_path)
    session.plan(PLAN[:1])
    session.begun(PLAN[0], tmp_path / "sweep1.tlog", arming=False)
    session.ended(tmp_path / "sweep1.tlog", "done", "", left_armed=False)
    assert session.to_drive == ()
    larger = SessionRun("sweep1", Sweep(amplitude=200))
    session.plan((larger,))
    assert session.to_drive == (larger,)
    assert session.tlog("sweep1").name == "sweep1-2.tlog"  # the first has no file and is kept all the same


def test_one_program_at_a_time(tmp_path: Path) -> None:
    first = Session.open(tmp_path)
    with pytest.raises(UsageError, match="another rover-sweep uses"):
        Session.open(tmp_path)
    read_folder(tmp_path)  # looking is free
    first.close()
    Session.open(tmp_path).close()


def test_a_session_is_of_one_rover(tmp_path: Path) -> None:
    session = Session.open(tmp_path / "s")
    session.on({"uid": 1})
    session.on({"uid": 2})  # nothing was driven yet
    session.begun(PLAN[0], tmp_path / "s" / "sweep1.tlog", arming=False)
    with pytest.raises(UsageError, match="begun on another rover .autopilot 2, this one is 3."):
        session.on({"uid": 3})


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"format": 1}', '{"format": "rover-sweep session 2", "runs": 3}']
)
def test_a_damaged_description_is_refused_in_words(tmp_path: Path, text: str) -> None:
    (tmp_path / "session.json").write_text(text)
    with pytest.raises(UsageError, match="session.json is damaged|written by another version"):
        Session.open(tmp_path)
    assert (tmp_path / "session.json").read_text() == text


def set_at(document: Any, place: tuple[Any, ...], value: Any) -> None:
    *way, last = place
    for key in way:
        document = document[key]
    if value is MISSING:
        del document[last]
    else:
        document[last] = value


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("runs", 0, "state"), "flying", "runs[0].state is 'flying', not one of begun, done, stopped, cut"),
        (("runs", 0, "state"), MISSING, "runs[0].state is missing"),
        (("runs", 0, "tlog"), "../x.tlog", "runs[0].tlog is '../x.tlog'"),
        (("runs", 0, "reason"), None, "runs[0].reason is None, not a text"),
        (("runs", 0, "span"), [1.0, float("nan")], "runs[0].span[1] is nan, not a finite number"),
        (("runs", 0, "number"), "one", "runs[0].number is 'one', not a whole number"),
        (("runs", 0, "left_armed"), "no", "runs[0].left_armed is 'no', not true or false"),
        (("runs", 0, "quality"), {}, "runs[0].quality is {}, not a list"),
        (("runs", 0, "verdict"), "keep", "runs[0].verdict is 'keep', not an object"),
        (("runs", 0, "verdict"), {}, "runs[0].verdict.sentence is missing"),
        (("runs", 0, "flown"), 1, "this rover-sweep does not know runs[0].flown"),
        (("runs", 0), None, "runs[0] is None, not an object"),
        (("runs",), MISSING, "runs is missing"),
        (("plan", 0, "speed"), "fast", "plan[0].speed is 'fast', not a finite number"),
        (("plan", 0, "manoeuvre", "kind"), "loop", "plan[0].manoeuvre.kind is 'loop', not one of sweep,"),
        (("plan", 0, "manoeuvre", "amplitude"), "120", "plan[0].manoeuvre.amplitude is '120', not a finite"),
        (("plan", 0, "manoeuvre", "t_rec"), -1, "plan[0].manoeuvre cannot be driven: need t_rec > 0"),
        (
            ("plan", 2, "manoeuvre", "t_rec"),
            1e15,
            "plan[2].manoeuvre cannot be driven: 0.3 to 25 rad/s contain",
        ),
        (("plan", 3, "manoeuvre", "count"), 10**400, "plan[3].manoeuvre.count is 1000"),
        (("logs", 0, "runs"), "sweep1", "logs[0].runs is 'sweep1', not a list"),
        (("logs_before",), [[1, 2]], "logs_before[0] has 2 numbers"),
        (("vehicle", "uid"), "7", "vehicle.uid is '7', not a whole number"),
        (("settings", "extra"), {"v_max": "5"}, "settings.extra.v_max is '5', not a finite number"),
    ],
)
def test_a_value_that_no_session_writes_is_named_and_nothing_changed(tmp_path, place, value, words, capsys):
    session = Session.open(tmp_path)
    session.plan(PLAN)
    session.on({"firmware": "ArduRover 4.6.3", "uid": 7})
    session.set({"extra": {"v_max": 5.0}})
    session.begun(PLAN[0], tmp_path / "sweep1.tlog", arming=False)
    session.fetched(FetchedLog("log4.BIN", 4, 10, 99, ("sweep1",)))
    session.close()
    path = tmp_path / "session.json"
    document = json.loads(path.read_text())
    set_at(document, place, value)
    path.write_text(text := json.dumps(document))
    with pytest.raises(UsageError, match=re.escape(f"session.json is damaged ({words}")):
        Session.open(tmp_path)
    assert run(["status", str(tmp_path)]) == 2
    assert words in (said := capsys.readouterr().err) and said.count("\n") == 1
    assert path.read_text() == text


@pytest.mark.parametrize(
    "command",
    [
        ("status",),
        ("status", "--json"),
        ("identify", "--out", "report"),
        ("diagnose", "--out", "report"),
        ("session", "--out"),
        ("resume", "--connect", "tcp:127.0.0.1:1"),
    ],
)
def test_every_command_that_reads_a_session_refuses_an_unknown_state(tmp_path, command, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with contextlib.closing(Session.open(tmp_path)) as session:
        session.begun(PLAN[0], tmp_path / "sweep1.tlog", arming=False)
    session.keep_vehicle_file(Path(__file__).parents[1] / "data" / "rover.toml")
    path = tmp_path / "session.json"
    path.write_text(text := path.read_text().replace('"begun"', '"flying"'))
    assert run([*command, str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert "runs[0].state is 'flying'" in said.err and said.err.count("\n") == 1 and not said.out
    assert path.read_text() == text


def test_names_are_shown_as_they_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Brackets are markup to the terminal's library."""
    with contextlib.closing(Session.open(tmp_path)) as session:
        odd = SessionRun("a[]b", Sweep())
        session.plan((odd, SessionRun("[bold]c", Sweep())))
        session.begun(odd, tmp_path / "[bold]d.tlog", arming=False)
    assert run(["status", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "[bold]c" in told and "[bold]d" in told


@pytest.mark.parametrize("content", [b"", b"nothing of a tlog", bytes(3000)])
def test_a_tlog_that_tells_nothing_is_no_run(tmp_path: Path, content: bytes) -> None:
    session = Session.open(tmp_path)
    session.begun(PLAN[0], tmp_path / "sweep1.tlog", arming=False)
    session.close()
    (tmp_path / "sweep1.tlog").write_bytes(content)
    (tmp_path / "unknown.tlog").write_bytes(content)
    (found,) = read_folder(tmp_path).runs
    assert (found.state, found.reason) == ("cut", "the program ended before the run began")
    with pytest.raises(DataRefused, match="no run in .* was completed .sweep1 was left out: the program"):
        session_runs(tmp_path)


def test_the_vehicle_file_is_the_sessions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (("one", "a"), ("two", "a"), ("three", "b")):
        (tmp_path / "rover.toml").write_text(text)
        Session.open(tmp_path / name).keep_vehicle_file(tmp_path / "rover.toml")
    assert vehicle_path(None, ("one", "two", "x.BIN")) == "one/rover.toml"
    assert vehicle_path("mine.toml", ("one",)) == "mine.toml"
    assert vehicle_path(None, ("x.BIN",)) == "rover.toml"
    with pytest.raises(UsageError, match="choose one with --vehicle"):
        vehicle_path(None, ("one", "three"))


def test_what_is_a_session(tmp_path: Path) -> None:
    assert not is_session(tmp_path) and not is_session(tmp_path / "none")
    (tmp_path / "a.BIN").touch()
    assert not is_session(tmp_path)
    (tmp_path / "a.tlog").touch()
    assert is_session(tmp_path)
    assert not is_session(tmp_path / "a.tlog")


def test_a_description_is_whole_or_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = Session.open(tmp_path)
    session.plan(PLAN[:1])
    monkeypatch.setattr(
        Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    )
    with pytest.raises(UsageError, match="No space left"):
        session.plan(PLAN)
    monkeypatch.undo()
    assert read_folder(tmp_path).plan == PLAN[:1]
    assert json.loads((tmp_path / "session.json").read_text())["format"] == "rover-sweep session 2"


def test_throttle_sweeps_alone_ask_for_the_log(tmp_path: Path) -> None:
    session = Session.open(tmp_path / "s")
    planned = SessionRun("throttle1", ThrottleSweep())
    session.plan((planned,))
    tlog = session.tlog(planned.name)
    session.begun(planned, tlog, arming=False)
    session.ended(tlog, "done", "", left_armed=False, span=(1.5, 70.0), number=1)
    with pytest.raises(DataRefused, match=r"throttle sweeps only \(throttle1\).*fetch its .BIN"):
        session_runs(tmp_path / "s")


def test_a_tlog_between_the_runs_names_those_that_hold_one(tmp_path: Path) -> None:
    with contextlib.closing(Session.open(tmp_path)) as session:
        for planned, state in zip((*PLAN[:2], PLAN[0]), ("done", "done", "stopped"), strict=True):
            tlog = session.tlog(planned.name)
            session.begun(planned, tlog, arming=False)
            session.ended(tlog, state, "", left_armed=False, span=(1.5, 70.0), number=1)
    (tmp_path / "connect.tlog").write_bytes(bytes(3000))
    with pytest.raises(DataRefused) as refused:
        load_runs([str(tmp_path / "connect.tlog")], None, None)
    first, second, stopped = (run.tlog for run in read_folder(tmp_path).runs)
    assert f"no run in connect.tlog; {first}, {second} have one each" in str(refused.value)
    assert stopped not in str(refused.value)
    assert without_run(tmp_path / "none" / "connect.tlog") == "", "outside a session"


@pytest.mark.parametrize(
    ("ended", "all_driven", "said"),
    [
        (None, False, True),  # cut: the program was killed in the run
        ("stopped", False, True),
        ("stopped", True, True),
        ("done", True, False),
    ],
)
def test_status_says_first_that_the_rover_may_still_be_armed(tmp_path, ended, all_driven, said, capsys):
    tlog = tmp_path / "sweep1.tlog"
    with contextlib.closing(Session.open(tmp_path)) as session:
        session.plan(() if all_driven else PLAN)
        session.begun(PLAN[0], tlog, arming=True)
        if ended:
            session.ended(tlog, ended, "why", left_armed=said)
    assert run(["status", str(tmp_path)]) == 0
    told = capsys.readouterr()
    first, disarm = told.out.splitlines()[0], "rover-sweep preflight --connect URL --fix armed"
    assert (MAY_BE_ARMED in first and disarm in first and "sweep1 ended without" in first) == said
    assert (disarm in told.err) == said
    whole = f"rover-sweep identify {tmp_path} --out {tmp_path}/report"
    assert whole in told.err if all_driven else "rover-sweep resume" in told.err


def test_rates_are_those_within_the_run(tmp_path: Path) -> None:
    """The applet reports at 10 Hz while it waits, longer than the sweep, and at 100 Hz in it."""
    waits, sweeps = np.arange(0.0, 300.0, 0.1), np.arange(300.0, 320.0, 0.01)
    t = np.concatenate((waits, sweeps))
    channels = {
        "pwm": Signal(t, np.sin(t), "us", "SWEP.Out", hold=True),
        "r": Signal(t, np.cos(t), "rad/s", "IMU.GyrZ"),
    }
    made = Recording("sweep1", channels, (300.0, 319.9), "sweep", sources=(("log1.BIN", ""),))
    assert made["pwm"].rate == pytest.approx(10.0)
    (words,) = origin_words(tmp_path, [made])
    assert "steering (SWEP.Out) at 100 Hz, gyro (IMU.GyrZ) at 100 Hz" in words
