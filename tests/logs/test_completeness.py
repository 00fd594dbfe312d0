"""Half a run, a hole, a late start: warnings, or a refusal when almost nothing was recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from drives import applet_rows, drive
from recordings import NOMINAL

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.find import find_runs
from rover_sweep.logs.judgement import with_notes
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_runs
from rover_sweep.manoeuvre.sweep import Manoeuvre, Sweep

SWEEP: Manoeuvre = Sweep(amplitude=100, t_rec=30, w_min=0.8)


def warnings(run: Recording) -> str:
    return " | ".join(n.text for n in run.notes if n.level == "warning")


def cut(log: Log, start: float, end: float) -> Log:
    """The log with nothing recorded outside of start..end [s]."""

    def part(s: Signal) -> Signal:
        inside = (s.t >= start) & (s.t <= end)
        return replace(s, t=s.t[inside], x=s.x[inside])

    return replace(
        log,
        signals={n: part(s) for n, s in log.signals.items()},
        steering=tuple(part(s) for s in log.steering),
        marks=tuple(m for m in log.marks if start <= m[0] <= end),
    )


def without(log: Log, start: float, end: float) -> Log:
    """The log with a hole from start to end [s]."""

    def part(s: Signal) -> Signal:
        outside = (s.t < start) | (s.t > end)
        return replace(s, t=s.t[outside], x=s.x[outside])

    steering = tuple(part(s) for s in log.steering)
    return replace(log, signals={n: part(s) for n, s in log.signals.items()}, steering=steering)


@pytest.mark.parametrize(("name", "share"), [("run1.BIN", 0.4), ("run1.BIN", 0.7), ("run1.tlog", 0.5)])
def test_a_cut_log_says_so(tmp_path: Path, name: str, share: float) -> None:
    data = (NOMINAL / name).read_bytes()
    path = tmp_path / name
    path.write_bytes(data[: int(len(data) * share)])
    (run,) = read_runs(str(path))
    assert "The recording ends before the end of the run: it ends at" in warnings(run)
    assert "the applet did not announce the end of the run" in warnings(run)


@pytest.mark.parametrize("name", ["run1.BIN", "run2.BIN", "run4.BIN", "run1.tlog"])
def test_a_whole_run_says_nothing_of_the_kind(name: str) -> None:
    (run,) = read_runs(str(NOMINAL / name))
    assert "The recording" not in warnings(run) and "hole" not in warnings(run)


def test_a_stump_is_refused(tmp_path: Path) -> None:
    data = (NOMINAL / "run1.BIN").read_bytes()
    path = tmp_path / "run1.BIN"
    path.write_bytes(data[: int(len(data) * 0.3)])
    with pytest.raises(DataRefused, match="run1: only .. s of the run were recorded, with . half waves"):
        read_runs(str(path))


def test_without_any_message_the_steering_tells() -> None:
    log, (start,) = drive([SWEEP])
    (whole,) = find_runs(log)
    assert whole.notes == ()
    (trimmed,) = find_runs(cut(log, whole.span[0], whole.span[1]))  # a .csv of the manoeuvre alone
    assert trimmed.notes == ()
    (early,) = find_runs(cut(log, 0.0, start + 25.0))
    assert "The recording ends before the end of the run: it ends at 50.0 s." in warnings(early)
    (late,) = find_runs(cut(log, start + 15.0, 1e9))
    assert "The recording begins after the start of the run: it steers at its start" in warnings(late)


def test_states_that_end_in_the_wave() -> None:
    log, (start,) = drive([SWEEP])
    states = [(start, 3), (start + 3, 4), (start + 7, 6), (start + 25, 0)]
    rows = applet_rows(log.steering[0].t, 3, states)
    (run,) = find_runs(replace(log, applet=rows))
    assert "the last state is 6, at 50.0 s" in warnings(run)
    (found,) = find_runs(replace(log, applet=rows, marks=((start + 25, "SWP: run 3 done"),)))
    assert found.notes == ()


def test_a_hole_within_a_run_is_told_with_place_and_length() -> None:
    log, (start,) = drive([SWEEP])
    broken = without(log, start + 20.0, start + 23.5)
    (run,) = (with_notes(r, broken) for r in find_runs(broken))
    assert "A hole of 3.5 s at 45.0 s in r, ay, p, speed, pwm" in warnings(run)
    short = without(log, start + 20.0, start + 20.8)
    (run,) = (with_notes(r, short) for r in find_runs(short))
    assert "hole" not in warnings(run) and "gaps" in warnings(run)


def test_a_long_hole_parts_a_run() -> None:
    log, (start,) = drive([SWEEP])
    (run,) = find_runs(without(log, start + 6.0, start + 18.0))
    assert "The recording has a hole of 12.0 s before 43.0 s, in the run" in warnings(run)
    first, second = find_runs(without(log, start + 25.0, start + 32.0))
    assert "The recording has a hole of 7.0 s at 50.0 s, before the end of the run" in warnings(first)
    assert "The recording has a hole of 7.0 s before 57.0 s, in the run" in warnings(second)


def test_a_stump_beside_a_whole_run_is_left_out_and_told() -> None:
    log, (one, two) = drive([SWEEP, SWEEP])
    marks = ((one, "SWP: run 1 start sweep"), (one + 42, "SWP: run 1 done"), (two, "SWP: run 2 start sweep"))
    (run,) = find_runs(cut(replace(log, marks=marks), 0.0, two + 12.0))
    assert "Another run was left out: made run 2: only 9 s of the run were recorded" in warnings(run)
