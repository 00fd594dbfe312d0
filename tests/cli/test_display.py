"""A session and long work on a terminal and in a file; a Ctrl-C is answered truly wherever it arrives."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from rover_sweep.cli.driving import session_display
from rover_sweep.cli.driving.session_display import Events, show_session
from rover_sweep.cli.views import asking
from rover_sweep.cli.views.asking import left_words, long_work
from rover_sweep.cli.views.display import display, live_line
from rover_sweep.cli.views.output import PLAIN_WIDTH, narration, results
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.vehicle import events as e

TLOG = Path("sweep1.tlog")
RUN = (
    e.RunStarted("sweep1", Sweep(), TLOG),
    e.SwitchWanted("high", 6),
    e.Said(1.0, 6, "SWP: run 1 start sweep"),
    e.StateChanged(10.0, 3, "straight before"),
    e.Sample(43.5, 6, 1620.0, -0.5, 2.25, 2.4, 12.3),
    e.RunFinished("sweep1", False, "roll 31.0 > 30 deg", TLOG, (0.0, 50.0), 1, ()),
    e.Interrupted("sweep2", TLOG, ("the vehicle did not answer",), True, True),
)


def shown(terminal: bool, talk: bool = True, count: int = len(RUN)) -> str:
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=80, color_system=None)
    with display(console, talk) as screen:
        for event in RUN[:count]:
            screen.show(event)
    return out.getvalue()


def test_a_terminal_has_a_bar_and_a_live_line() -> None:
    text = shown(terminal=True, count=5)
    assert "straight before   1620 us" in text and "12.3 rad/s" in text
    assert " 50%" in text  # 33.5 of 67 s
    whole = shown(terminal=True)
    assert "1620 us" not in whole.rpartition("not everything was released")[2]  # it ends with the run


def test_a_file_has_lines_in_the_order_of_what_happened() -> None:
    lines = shown(terminal=False).splitlines()
    assert [line.strip() for line in lines] == [
        "sweep1: sweep, +-150 us",
        "when ready, throw switch 6 high",
        "SWP: run 1 start sweep",
        "sweep1 is incomplete: roll 31.0 > 30 deg",
        "sweep2 interrupted, but not everything was released: the vehicle did not answer",
    ]
    assert "SWP:" not in shown(terminal=False, talk=False)


def test_results_go_to_stdout_unless_json_has_it(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    long = "x" * PLAIN_WIDTH
    results().print(long)
    results(as_json=True).print("beside the JSON")
    narration().print("narration")
    out, err = capsys.readouterr()
    assert out == long + "\n" and err == "beside the JSON\nnarration\n"


def test_the_live_line_names_what_matters_and_fits() -> None:
    line = live_line(e.Sample(1.0, 6, 1620.0, -0.5, 2.25, 2.4, 12.3), "waiting for speed")
    assert len(line) <= 80
    for words in ("waiting for speed", "1620 us", "-29 deg/s", "+2.2 m/s²", "2.4 m/s", "12.3 rad/s"):
        assert words in line
    unknown = live_line(e.Sample(1.0, 6, *[float("nan")] * 5), "idle")
    assert "nan" not in unknown and len(unknown) == len(line)


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ([0.04 * k for k in range(40)], []),
        (
            [0.5 * k for k in range(1, 41)],  # after two seconds, then each five
            [f"diagnosing: {10 + 25 * k} %, step {4 + 10 * k}" for k in range(4)],
        ),
    ],
)
def test_long_work_says_few_lines_in_a_pipe(times, said, capsys, monkeypatch):
    clock: Iterator[float] = iter([0.0, *times])
    monkeypatch.setattr(asking.time, "monotonic", lambda: next(clock))
    with long_work("diagnosing") as report:
        for k in range(len(times)):
            report(f"step {k + 1}", (k + 1) / len(times))
    lines = capsys.readouterr().err.splitlines()
    assert [line.rpartition(", about")[0].rpartition(",")[0] for line in lines] == said
    assert not lines or lines[0].endswith("2 s, about 18 s left")


def test_the_time_left_is_told_when_there_is_something_to_go_by() -> None:
    assert left_words(1.0, 0.01) == "" and left_words(20.0, 1.0) == ""
    assert left_words(60.0, 0.1) == "about 9 min left"


def in_a_run() -> Events:
    """As `recorded_run`: releases the rover, and says so."""
    try:
        yield RUN[0]
        yield e.Notice("info", "the applet steers")
    except KeyboardInterrupt:
        yield e.Interrupted("sweep1", TLOG, (), False, True)


def before_a_run() -> Events:
    yield e.Notice("info", "connected")


@pytest.mark.parametrize(
    ("events", "said"),
    [
        (in_a_run, "sweep1 interrupted: the rover was released"),
        (before_a_run, "no run was in progress: this program moves nothing"),
    ],
)
def test_a_ctrl_c_between_two_events(events, said, tmp_path, monkeypatch, capsys):
    """It reaches neither the session nor its display, but what is done with an event afterwards."""

    def pressed(*_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(session_display, "_telemetry", pressed)
    with pytest.raises(KeyboardInterrupt):
        show_session(events(), tmp_path)
    shown = capsys.readouterr().err
    assert said in shown and shown.count("interrupted") + shown.count("no run was in progress") == 1
