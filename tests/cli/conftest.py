"""The program called in this process; a simulated rover as it comes, and one that is set up."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from program_calls import ProgramResult, RunProgram

from rover_sweep.cli import main
from rover_sweep.cli.driving import session_display
from rover_sweep.identification.grouping import Settings
from sitl import launcher
from tests.vehicle.simulated_drive import READY


@pytest.fixture
def run_program(capsys: pytest.CaptureFixture[str]) -> RunProgram:
    """Calls the program in this process."""

    def call(*arguments: str) -> ProgramResult:
        capsys.readouterr()
        code = main.run(arguments)
        out, err = capsys.readouterr()
        return ProgramResult(code, out, err)

    return call


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[launcher.Running]:
    """A rover as it comes: no scripting, no applet."""
    with launcher.start_embedded(tmp_path_factory.mktemp("fresh"), speedup=4) as rover:
        yield rover


@pytest.fixture(scope="module")
def ready(tmp_path_factory: pytest.TempPathFactory) -> Iterator[launcher.Running]:
    """A rover with the applet and its parameters."""
    with launcher.start_embedded(tmp_path_factory.mktemp("ready"), options=READY, speedup=8) as rover:
        yield rover


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was driven is identified with hardly any bootstrap."""
    monkeypatch.setattr(session_display, "Settings", lambda bootstrap: Settings(bootstrap=20))
