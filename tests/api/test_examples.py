"""The examples in the docstrings of the public API, run where their files are."""

from __future__ import annotations

import doctest
import inspect
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib
import pytest

import rover_sweep as rs
from rover_sweep.api.read import Runs
from rover_sweep.data.recording import Recording
from rover_sweep.data.results import ByName
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.verify import Verification
from rover_sweep.quality.verdict import CoherenceTable
from rover_sweep.spectra.response import FrequencyResponse

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
FOUND_BY_USERS = (Recording, ModelResult, Verification, FrequencyResponse, CoherenceTable, ByName)
OPTIONS = doctest.ELLIPSIS
LONG = ("rover_sweep", "diagnose", "identify_speed", "identify_driving")  # they make what others use
WITHOUT = {  # public functions and methods without an example, each with the reason
    "compare": "needs the recordings of a simulator",
    "Harmonics": "see `harmonics`",
    "DataRefused": "an error",
    "RoverSweepError": "an error",
    "UsageError": "an error",
}


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
    """The examples that were run: what they said, and the names that they made."""

    names: dict[str, Any] = field(default_factory=lambda: {"rs": rs})
    said: dict[str, str] = field(default_factory=dict)

    def run(self, example: doctest.DocTest) -> dict[str, Any]:
        """Runs one with the names; keeps what failed. Returns the names that it leaves."""
        lines: list[str] = []
        example.globs = dict(self.names)
        runner = doctest.DocTestRunner(optionflags=OPTIONS)
        assert runner.run(example, out=lines.append, clear_globs=False).attempted
        self.said[example.name] = "".join(lines)
        return example.globs


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Examples]:
    """The long examples, run once in a folder with the recordings; the others use their names."""
    matplotlib.use("Agg")
    folder = tmp_path_factory.mktemp("examples")
    for name in ("run1.BIN", "run4.BIN"):
        (folder / name).symlink_to(NOMINAL / name)
    (folder / "throttle.BIN").symlink_to(DATA / "ardurover-4.6.3" / "throttle" / "sweep.BIN")
    (folder / "rover.toml").symlink_to(DATA / "rover.toml")
    (folder / "worn").symlink_to(DATA / "concealed-ardurover" / "f")
    known, done = {test.name: test for test in examples()}, Examples()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setitem(matplotlib.rcParams, "figure.max_open_warning", 0)
        for name in LONG:
            done.names |= done.run(known[name])
        yield done


@pytest.mark.parametrize("example", examples(), ids=lambda example: str(example.name))
def test_an_example_of_a_docstring(example: doctest.DocTest, done: Examples) -> None:
    if example.name not in done.said:
        done.run(example)
    assert not done.said[example.name], done.said[example.name]


def test_every_public_name_has_an_example() -> None:
    names = {test.name for test in examples()}
    lacking = {n for n in public() if n not in WITHOUT and not any(t.partition(".")[0] == n for t in names)}
    assert lacking == set()
    for shown in (
        Runs,
        Recording,
        FrequencyResponse,
        ModelResult,
        rs.Result,
        rs.FullDiagnosis,
        rs.Simulation,
        rs.SpeedIdentification,
    ):
        for method in ("plot", "to_frame"):
            own = getattr(shown, method)
            assert ">>>" in (inspect.getdoc(own) or ""), f"{shown.__name__}.{method}"
