"""The engine made by hand in the place of the real one, and the program called in this process."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

import pytest
from fabricated_engine import Engine, ProgramResult

from rover_sweep.cli import main


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Engine:
    found = Engine()
    for name, attribute, function in (
        ("rover_sweep.diagnosis.diagnose", "diagnose", found.diagnose),
        ("rover_sweep.diagnosis.plans.plan", "plan", found.make_plan),
    ):
        monkeypatch.setattr(import_module(name), attribute, function)
    return found


@pytest.fixture
def run_program(capsys: pytest.CaptureFixture[str]) -> Callable[..., ProgramResult]:
    """Calls the program in this process."""

    def call(*arguments: object) -> ProgramResult:
        capsys.readouterr()
        code = main.run([str(a) for a in arguments])
        return ProgramResult(code, *capsys.readouterr())

    return call
