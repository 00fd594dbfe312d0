"""A long afternoon, shortened: what is recorded is what was received, and memory does not grow with it."""

from __future__ import annotations

from pathlib import Path

from tests.benchmarks.eight_hours import Hour, afternoon, faults


def test_ten_minutes_are_recorded_whole_and_leave_nothing_in_memory(tmp_path: Path) -> None:
    hours = afternoon(1 / 6, tmp_path, every=200.0)
    assert len(hours) >= 3 and hours[-1].frames > 13_000
    assert faults(hours) == []


def test_what_grows_or_is_missing_is_told() -> None:
    first, last = Hour(1, 100.0, 1000, 1080, 10), Hour(8, 200.0, 8000, 8640 - 16, 80)
    assert faults([first, last]) == ["memory grew by 100 MB", "8624 bytes recorded of 8000 in 80 frames"]
