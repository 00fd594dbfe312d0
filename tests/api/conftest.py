"""What the long examples of the docstrings made, once for all tests: runs, their models, a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from docstring_examples import Examples, long_examples

import rover_sweep as rs
from rover_sweep.api.read import Runs

QUICK = {"bootstrap": 20, "models": ("bicycle", "roll-yaw")}


@pytest.fixture(autouse=True)
def quick_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    """By default `identify` fits three models and makes 200 replicates."""
    for name, value in QUICK.items():
        monkeypatch.setitem(rs.identify.__kwdefaults__, name, value)


@pytest.fixture(scope="session")
def done(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Examples]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in QUICK.items():
            patch.setitem(rs.identify.__kwdefaults__, name, value)
        yield long_examples(tmp_path_factory.mktemp("examples"))


@pytest.fixture(scope="session")
def runs(done: Examples) -> Runs:
    return done.names["runs"]


@pytest.fixture(scope="session")
def result(done: Examples) -> rs.Result:
    return done.names["result"]


@pytest.fixture(scope="session")
def found(done: Examples) -> rs.FullDiagnosis:
    return done.names["found"]
