"""The examples in the docstrings of the public API, run where their files are."""

from __future__ import annotations

import doctest
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib
import pytest

import rover_sweep as rs
from rover_sweep.data.recording import Recording
from rover_sweep.data.results import ByName
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.verify import Verification
from rover_sweep.quality.verdict import CoherenceTable
from rover_sweep.spectra.response import FrequencyResponse

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
FOUND_BY_USERS = (Recording, ModelResult, Verification, FrequencyResponse, CoherenceTable, ByName)
LONG = ("rover_sweep", "diagnose", "identify_speed", "identify_driving")  # they make what others use


def public() -> dict[str, Any]:
    return {name: getattr(rs, name) for name in rs.__all__ if name != "__version__"}


def examples() -> list[doctest.DocTest]:
    """All examples of the package, the public names, and the classes that they return."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    things = public() | {c.__name__: c for c in FOUND_BY_USERS}
    found = [test for name, thing in things.items() for test in finder.find(thing, name, globs={})]
    package = doctest.DocTestParser().get_doctest(rs.__doc__ or "", {}, "rover_sweep", None, 0)
    return [package, *(test for test in found if test.examples)]


@dataclass
class Examples:
    """The examples that were run in a folder: what they said, and the names that they made."""

    folder: Path
    names: dict[str, Any] = field(default_factory=lambda: {"rs": rs})
    said: dict[str, str] = field(default_factory=dict)

    def run(self, example: doctest.DocTest) -> dict[str, Any]:
        """Runs one with the names; keeps what failed. Returns the names that it leaves."""
        lines: list[str] = []
        example.globs = dict(self.names)
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(self.folder)
            patch.setitem(matplotlib.rcParams, "figure.max_open_warning", 0)
            assert runner.run(example, out=lines.append, clear_globs=False).attempted
        self.said[example.name] = "".join(lines)
        return example.globs


def long_examples(folder: Path) -> Examples:
    """The long ones, with the recordings in the folder; the others use their names."""
    matplotlib.use("Agg")
    for name in ("run1.BIN", "run4.BIN"):
        (folder / name).symlink_to(NOMINAL / name)
    (folder / "throttle.BIN").symlink_to(DATA / "ardurover-4.6.3" / "throttle" / "sweep.BIN")
    (folder / "rover.toml").symlink_to(DATA / "rover.toml")
    (folder / "worn").symlink_to(DATA / "concealed-ardurover" / "f")
    known, done = {test.name: test for test in examples()}, Examples(folder)
    for name in LONG:
        done.names |= done.run(known[name])
    return done
