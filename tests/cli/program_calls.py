"""Shared by the tests of the commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

ROVER = str(Path(__file__).parents[1] / "data" / "rover.toml")
SWEEP = ("--sweep", "120,2,20,10")
DOUBLET = ("--doublet", "150")
DRIVEN = ("--arm", "--throttle", "1710", "--throw-switch", "--limit", "v_max=5", "--limit", "still=1")


class ProgramResult(NamedTuple):
    """Exit code, stdout and stderr of a call of the program."""

    code: int
    out: str
    err: str


RunProgram = Callable[..., ProgramResult]
