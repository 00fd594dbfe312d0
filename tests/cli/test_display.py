"""A session on a terminal and in a file."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from rover_sweep.cli.views.display import display
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
    e.Interrupted("sweep2", TLOG, ("the vehicle did not answer",), True),
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


def test_results_go_to_stdout_unless_json_has_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    long = "x" * PLAIN_WIDTH
    results().print(long)
    results(as_json=True).print("beside the JSON")
    narration().print("narration")
    out, err = capsys.readouterr()
    assert out == long + "\n" and err == "beside the JSON\nnarration\n"
