"""What could not be let go is said after the error, on lines of its own."""

from __future__ import annotations

import click
import pytest

from rover_sweep.cli import main
from rover_sweep.errors import LinkError


def test_the_notes_of_an_error_are_its_last_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @click.command()
    def lost() -> None:
        error = LinkError("the link is gone")
        error.add_note("RC_OVERRIDE_TIME is still 1 s; it was 3 s before")
        error.add_note("The rover may still be armed")
        raise error

    monkeypatch.setattr(main, "cli", lost)
    assert main.run([]) == 4
    assert capsys.readouterr().err.splitlines() == [
        "rover-sweep: the link is gone",
        "RC_OVERRIDE_TIME is still 1 s; it was 3 s before",
        "The rover may still be armed",
    ]
