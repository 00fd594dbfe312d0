"""Runs of equal file names get different names."""

from __future__ import annotations

from pathlib import Path

import pytest

from rover_sweep.api.read import load_runs
from rover_sweep.data.recording import source_names

NEW, OLD = "ardurover-4.6.3", "ardurover-4.5.7"


@pytest.mark.parametrize(
    ("sources", "names"),
    [
        (["a/run1.BIN", "a/run2.BIN"], ["run1", "run2"]),
        (["a/run1.BIN", "b/run1.BIN"], ["a/run1", "b/run1"]),
        (["a/run1.BIN", "a/run1.tlog"], ["run1.BIN", "run1.tlog"]),
        (["a/x/run1.BIN", "b/x/run1.BIN", "run2.BIN"], ["a/x/run1.BIN", "b/x/run1.BIN", "run2"]),
        (["a/run1.tlog+a/run1.BIN", "b/run1.tlog"], ["a/run1", "b/run1"]),
        (["a/run1.BIN", "a/run1.BIN"], ["run1", "run1"]),
        (["a/run1.BIN", "a/../a/run1.BIN"], ["run1", "run1"]),
    ],
)
def test_names_are_short_and_differ(sources: list[str], names: list[str]) -> None:
    found = source_names(sources)
    assert [found[s] for s in sources] == names


def test_runs_carry_the_names(data: Path) -> None:
    sources = [str(data / NEW / "nominal/run2.BIN"), str(data / OLD / "nominal/run2.BIN")]
    names = [f"{part}/nominal/run2.BIN" for part in (NEW, OLD)]
    assert [r.name for r in load_runs(sources, None, None)] == names
    assert [r.name for r in load_runs(sources[:1], None, None, other_sources=sources[1:])] == names[:1]
    assert [r.name for r in load_runs(sources[:1], None, None)] == ["run2"]


def test_runs_of_one_log_keep_their_numbers(data: Path, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        parts = [(data / NEW / "nominal" / name).read_bytes() for name in ("run2.BIN", "run1.BIN")]
        (tmp_path / folder / "both.BIN").write_bytes(b"".join(parts))
    runs = load_runs([str(tmp_path / folder / "both.BIN") for folder in ("a", "b")], None, None)
    assert [r.name for r in runs] == ["a/both log 1", "a/both log 2", "b/both log 1", "b/both log 2"]
