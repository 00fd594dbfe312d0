"""A recording behind a screen: rates, pause, jumps, the runs in it, and what it refuses."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from screen import Screen

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


@pytest.mark.parametrize(
    ("name", "amplitude", "states"),
    [(f"{APPLET}.tlog", 150.0, [*range(10), 0]), (f"{OLD}.tlog", 120.0, [0, 6, 0])],
)
def test_a_run_is_told_from_its_start_to_its_verdict(screens, data, name, amplitude, states):
    """Where no applet told a state, the run shows."""
    path = data / name
    screen = shown(screens, path)
    screen.until(screen.at_the_end)
    (started,), (finished,), (judged,) = (screen.all(k) for k in (RunStarted, RunFinished, Judged))
    assert isinstance(started.manoeuvre, Sweep)
    assert started.manoeuvre.amplitude == pytest.approx(amplitude, rel=0.02)
    assert finished.completed and finished.reason == "the manoeuvre ran to its end"
    assert judged.verdict == judge(path, finished.span, "run1")  # the one that was given when it was driven
    assert judged.verdict.advice == "keep"
    order = [type(told) for _, told in screen.told]
    assert order.index(Connected) < order.index(RunStarted) < order.index(RunFinished) < order.index(Judged)
    moves = [k for k, (_, told) in enumerate(screen.told) if isinstance(told, StateChanged) and told.state]
    assert order.index(RunStarted) < moves[0]
    assert [s.state for s in screen.all(StateChanged)] == states
    if name.startswith(OLD):
        progress = [s.progress for s in screen.all(Snapshot) if s.state == 6]
        assert progress == sorted(progress) and progress[0] < 0.02 and progress[-1] > 0.98
    else:
        assert "SWP: run 1 done" in [said.text for said in screen.all(Said)]
        assert {q.message for q in finished.quality} == {"ATTITUDE", "RAW_IMU", "SERVO_OUTPUT_RAW"}
        assert all(q.hz == pytest.approx(50.0, rel=0.02) and q.lost < 0.01 for q in finished.quality)


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


def test_half_a_recording_is_played_and_the_verdict_says_so(screens, data, tmp_path):
    whole = (data / f"{APPLET}.BIN").read_bytes()
    half = tmp_path / "half.BIN"
    half.write_bytes(whole[: int(0.6 * len(whole))])
    screen = shown(screens, half)
    screen.until(screen.at_the_end)
    (finished,), (judged,) = screen.all(RunFinished), screen.all(Judged)
    assert not finished.completed and "ends before the end of the run" in finished.reason
    assert judged.verdict.advice == "repeat"
