"""A second rover on the channel: asked for at the start, and without any effect later."""

from __future__ import annotations

from pathlib import Path

import pytest
from virtual_faults import STRANGER, second_rover
from virtual_promises import broken
from virtual_run import Outcome, played
from virtual_world import At, Phase

from rover_sweep.errors import UsageError
from rover_sweep.logs.readers.tlog import open_tlog
from rover_sweep.vehicle.link.connection import Access


def whole(outcome: Outcome) -> None:
    """The run came to its end as if there were no other rover."""
    assert outcome.fired and outcome.error is None, outcome.error
    assert outcome.finished is not None and outcome.finished.completed
    assert outcome.record.completed == (1,) and outcome.finished.number == 1
    assert broken(outcome) == []


def test_without_a_word_on_which_one_nothing_moves(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("connecting"), second_rover())], after=2.0)
    assert isinstance(outcome.error, UsageError)
    assert f"system 1 (ground rover), system {STRANGER} (ground rover)" in outcome.said
    assert outcome.record.metres() == 0.0 and outcome.record.sent == [] and not outcome.armed


def test_the_chosen_one_drives_and_the_other_counts_for_nothing(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("connecting"), second_rover())], after=2.0, access=Access(system=1))
    whole(outcome)
    found = open_tlog(tmp_path / "sweep1.tlog", frozenset({"NAMED_VALUE_FLOAT", "HEARTBEAT"})).messages
    assert {system for frames in found.values() for system in frames.system.tolist()} == {1}


@pytest.mark.parametrize("phase", ["uploading", "sweep"])
def test_one_that_comes_later_changes_nothing_and_is_told_once(tmp_path: Path, phase: Phase) -> None:
    told: list[str] = []
    outcome = played(tmp_path, [(At(phase, 0.3), second_rover())], after=2.0, access=Access(tell=told.append))
    whole(outcome)
    assert [f"system {STRANGER} (ground rover)" in words for words in told] == [True]
