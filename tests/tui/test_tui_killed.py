"""`rover-sweep session` in a terminal, killed in mid-sweep and started again where it was."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from terminal import Terminal
from test_tui_on_rover import LIMITS, OWN, PARAMETERS, ROVER_FILE

from rover_sweep.session.folder import read_folder as read_session
from rover_sweep.vehicle.link.link import Link
from sitl import launcher

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")


@pytest.fixture
def rover(tmp_path: Path) -> Iterator[launcher.Running]:
    options = ("--applet", *PARAMETERS)
    with launcher.start_embedded(tmp_path / "vehicle", options=options, speedup=8) as running:
        with Link.open(running.connection, tmp_path / "boot.tlog") as link:
            while link.clock.now < 20.0:  # until its EKF has a position, so that the preflight finds all good
                link.request_message("SYSTEM_TIME")
        yield running


@contextmanager
def session(rover: launcher.Running, folder: Path) -> Iterator[Terminal]:
    """Connected and looked at."""
    command = (sys.executable, "-m", "rover_sweep", "session", "--connect", rover.connection)
    options = ("--vehicle", str(ROVER_FILE), "--out", str(folder), *OWN, *LIMITS)
    state = {"XDG_STATE_HOME": str(folder.parent / "state"), "PYTHONPATH": str(Path(__file__).parents[2])}
    with Terminal((*command, *options), state) as terminal:
        terminal.until("[1 CONNECT]", rover.connection)
        terminal.press("\r")
        terminal.until("[2 PREFLIGHT]", "✓ good      applet")
        yield terminal


def driven(terminal: Terminal, name: str) -> None:
    terminal.press("g")
    terminal.until(f"{name}: ", "This program arms the rover", "Is the area clear")
    terminal.press("y")
    terminal.until("[4 RUN]", "applet steers", "ARMED", "SPACE or ESC")


def test_killed_in_mid_sweep_it_goes_on_where_it_was(rover: launcher.Running, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    with session(rover, folder) as killed:
        killed.press("3")
        killed.until("[3 PLAN]", "sweep1", "sweep2", "doublet1")
        killed.press("x")
        killed.until("2 runs")  # what is left of the plan: sweep2 and doublet1
        driven(killed, "sweep2")
    recorded = (folder / "sweep2.tlog").stat().st_size
    assert recorded > 20_000

    with session(rover, folder) as again:
        again.press("6")
        again.until("[6 LOG]", "runs: 1, complete: 0", "✗ failed", "was still armed")
        again.press("3")
        again.until("[3 PLAN]", "▶ sweep2", "doublet1", "2 runs")
        driven(again, "sweep2")
        again.until("[5 VERDICT]", "sweep2-2: ", "✓ complete", "KEEP", "Next: doublet1")
        again.press("q")
        assert again.program.wait(20) == 0

    content = read_session(folder)
    assert [(run.label, run.state) for run in content.runs] == [("sweep2", "cut"), ("sweep2-2", "done")]
    assert [run.name for run in content.to_drive] == ["doublet1"]
    assert (folder / "sweep2.tlog").stat().st_size == recorded
