"""A session before the user's eyes: a Ctrl-C is answered truly wherever it arrives."""

from __future__ import annotations

from pathlib import Path

import pytest

from rover_sweep.cli.driving import session_display
from rover_sweep.cli.driving.session_display import Events, show_session
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.vehicle.events import Interrupted, Notice, RunStarted

TLOG = Path("sweep1.tlog")


def in_a_run() -> Events:
    """As `recorded_run`: releases the rover, and says so."""
    try:
        yield RunStarted("sweep1", Sweep(), TLOG)
        yield Notice("info", "the applet steers")
    except KeyboardInterrupt:
        yield Interrupted("sweep1", TLOG, (), False)


def before_a_run() -> Events:
    yield Notice("info", "connected")


@pytest.mark.parametrize(
    ("events", "said"),
    [
        (in_a_run, "sweep1 interrupted: the rover was released"),
        (before_a_run, "no run was in progress: nothing moves"),
    ],
)
def test_a_ctrl_c_between_two_events(
    events: type[Events],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It reaches neither the session nor its display, but what is done with an event afterwards."""

    def pressed(*_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(session_display, "_telemetry", pressed)
    with pytest.raises(KeyboardInterrupt):
        show_session(events(), tmp_path)
    shown = capsys.readouterr().err
    assert said in shown and shown.count("interrupted") + shown.count("no run was in progress") == 1
