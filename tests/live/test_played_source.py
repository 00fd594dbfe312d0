"""A recording behind a screen: rates, pause, jumps, the runs in it, and what it refuses."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from screen import Screen

from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.live.played_source import PlayedSource
from rover_sweep.live.source import Ended, Judged, Play, Played, Preflight, Snapshot
from rover_sweep.live.verdict import judge
from rover_sweep.manoeuvre.sweep import Doublet, Sweep
from rover_sweep.vehicle.events import Connected, RunFinished, RunStarted, Said, StateChanged

APPLET = "ardurover-4.6.3/applet/run1"
OLD = "ardurover-4.6.3/nominal/run1"  # driven by an applet that told no states


@pytest.fixture
def screens(data: Path) -> Iterator[list[Screen]]:
    made: list[Screen] = []
    yield made
    for screen in made:
        screen.source.close()


def shown(screens: list[Screen], path: Path, rate: float = math.inf, at: float = 0.0) -> Screen:
    screens.append(Screen(PlayedSource(path, rate, at)))
    return screens[-1]


@pytest.mark.parametrize("kind", ["tlog", "BIN"])
@pytest.mark.parametrize("name", [APPLET, OLD])
def test_a_run_is_told_from_its_start_to_its_verdict(
    screens: list[Screen], data: Path, name: str, kind: str
) -> None:
    path = data / f"{name}.{kind}"
    screen = shown(screens, path)
    screen.until(screen.at_the_end)
    (started,), (finished,), (judged,) = (screen.all(k) for k in (RunStarted, RunFinished, Judged))
    assert isinstance(started.manoeuvre, Sweep)
    assert started.manoeuvre.amplitude == pytest.approx(150.0 if name == APPLET else 120.0, rel=0.02)
    assert finished.completed and finished.reason == "the manoeuvre ran to its end"
    assert judged.verdict == judge(path, finished.span, "run1")  # the one that was given when it was driven
    assert judged.verdict.advice == "keep"
    order = [type(told) for _, told in screen.told]
    assert order.index(Connected) < order.index(RunStarted) < order.index(RunFinished) < order.index(Judged)
    first_motion = next(
        k for k, (_, told) in enumerate(screen.told) if isinstance(told, StateChanged) and told.state
    )
    assert order.index(RunStarted) < first_motion


def test_states_and_texts_are_the_vehicle_s_own(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / f"{APPLET}.tlog")
    screen.until(screen.at_the_end)
    assert [s.state for s in screen.all(StateChanged)] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 0]
    assert "SWP: run 1 done" in [said.text for said in screen.all(Said)]
    (finished,) = screen.all(RunFinished)
    assert {q.message for q in finished.quality} == {"ATTITUDE", "RAW_IMU", "SERVO_OUTPUT_RAW"}
    assert all(q.hz == pytest.approx(50.0, rel=0.02) and q.lost < 0.01 for q in finished.quality)


def test_where_no_applet_told_a_state_the_run_shows(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / f"{OLD}.tlog")
    screen.until(screen.at_the_end)
    assert [s.state for s in screen.all(StateChanged)] == [0, 6, 0]
    progress = [s.progress for s in screen.all(Snapshot) if s.state == 6]
    assert progress == sorted(progress) and progress[0] < 0.02 and progress[-1] > 0.98


def test_a_doublet_is_one(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / "ardurover-4.6.3/nominal/run4.BIN")
    screen.until(screen.at_the_end)
    (started,) = screen.all(RunStarted)
    assert isinstance(started.manoeuvre, Doublet)


def test_it_keeps_the_rate_that_was_asked(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / f"{APPLET}.tlog", rate=4.0)
    time.sleep(1.0)
    screen.source.ask(Play(rate=0.0))
    screen.until(lambda: any(p.rate == 0.0 for p in screen.all(Played)))
    stands = [(when, p.t) for when, p in screen.told if isinstance(p, Played)]
    (since, first), (until, last) = stands[0], stands[-2]
    assert (last - first) / (until - since) == pytest.approx(4.0, rel=0.15)
    snapshots = len(screen.all(Snapshot))
    assert snapshots >= 5  # about ten a second
    time.sleep(0.3)
    assert len(screen.all(Snapshot)) == snapshots  # paused
    screen.source.ask(Play(rate=math.inf))
    screen.until(screen.at_the_end)
    assert screen.all(Played)[-1].rate == 0.0


def test_jumps_land_where_they_should_and_say_what_is_there(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / f"{APPLET}.tlog", rate=0.0, at=40.0)
    screen.until(lambda: bool(screen.all(Played)))
    assert screen.all(RunStarted) and screen.all(StateChanged)[-1].state == 6
    there = screen.all(Snapshot)[-1]
    for at in (80.0, 1.0, 40.0):
        seen = len(screen.all(Played))
        screen.source.ask(Play(at=at))
        screen.until(lambda seen=seen: len(screen.all(Played)) > seen)  # type: ignore[misc]
        assert screen.all(Played)[-1] == Played(at, screen.source.track.length, 0.0)
    assert repr(screen.all(Snapshot)[-1]) == repr(there)
    assert not screen.all(Judged)  # what lay between was not played
    screen.source.ask(Play(rate=math.inf))
    screen.until(screen.at_the_end)
    assert len(screen.all(Judged)) == 1


def test_a_jump_past_the_end_of_a_run_tells_its_verdict(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / f"{APPLET}.tlog", rate=0.0, at=40.0)
    screen.until(lambda: bool(screen.all(Played)))
    screen.source.ask(Play(at=math.nextafter(screen.source.track.length, 0.0)))
    screen.until(lambda: bool(screen.all(Judged)))
    assert screen.all(Judged)[0].verdict.run == screen.all(RunStarted)[0].name
    screen.source.ask(Play(rate=math.inf))
    screen.until(screen.at_the_end)
    assert len(screen.all(Judged)) == 1


def test_what_only_a_vehicle_could_do_is_refused_in_words(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / f"{APPLET}.BIN", rate=1.0)
    screen.source.ask(Preflight())
    screen.until(lambda: bool(screen.all(Ended)))
    assert "recording" in screen.all(Ended)[0].failure
    screen.source.abort()
    screen.until(lambda: screen.all(Played)[-1].rate == 0.0)


def test_closing_ends_the_thread_at_once(screens: list[Screen], data: Path) -> None:
    screen = shown(screens, data / f"{APPLET}.tlog", rate=0.5)
    begun = time.monotonic()
    screen.source.close()
    assert time.monotonic() - begun < 2.0
    count = len(screen.told)
    time.sleep(0.3)
    assert len(screen.told) == count


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.tlog", b"", "empty"),
        ("foreign.tlog", b"not a log at all, only text\n" * 99, "not a telemetry log"),
        ("empty.BIN", b"", "empty"),
        ("foreign.BIN", b"not a log at all, only text\n" * 99, "not a DataFlash log"),
    ],
)
def test_what_is_no_recording_is_refused_in_a_sentence(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataRefused, match=words):
        PlayedSource(tmp_path / name)


def test_what_cannot_be_played_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t,r\n")
    for path, words in (
        (tmp_path / "run.csv", "cannot be played"),
        (tmp_path / "none.tlog", "no such file"),
        (tmp_path, "is a folder"),
    ):
        with pytest.raises(UsageError, match=words):
            PlayedSource(path)


@pytest.mark.parametrize("kind", ["tlog", "BIN"])
def test_half_a_recording_is_played_and_the_verdict_says_so(
    screens: list[Screen], data: Path, tmp_path: Path, kind: str
) -> None:
    whole = (data / f"{APPLET}.{kind}").read_bytes()
    half = tmp_path / f"half.{kind}"
    half.write_bytes(whole[: int(0.6 * len(whole))])
    screen = shown(screens, half)
    screen.until(screen.at_the_end)
    (finished,), (judged,) = screen.all(RunFinished), screen.all(Judged)
    assert not finished.completed and "ends before the end of the run" in finished.reason
    assert judged.verdict.advice == "repeat"
