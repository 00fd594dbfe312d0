"""Progress in a pipe: few plain lines with the share, the step and the time left."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from rover_sweep.cli.views import asking as module
from rover_sweep.cli.views.asking import left_words, long_work


def told(
    times: list[float], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    clock: Iterator[float] = iter([0.0, *times])
    monkeypatch.setattr(module.time, "monotonic", lambda: next(clock))
    with long_work("diagnosing") as report:
        for k in range(len(times)):
            report(f"step {k + 1}", (k + 1) / len(times))
    return capsys.readouterr().err.splitlines()


def test_short_work_says_nothing_in_a_pipe(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told([0.04 * k for k in range(40)], capsys, monkeypatch) == []


def test_long_work_says_a_line_after_two_seconds_then_each_five(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = told([0.5 * k for k in range(1, 41)], capsys, monkeypatch)
    assert len(lines) == 4
    assert lines[0] == "diagnosing: 10 %, step 4, 2 s, about 18 s left"


def test_the_time_left_is_told_when_there_is_something_to_go_by() -> None:
    assert left_words(1.0, 0.01) == "" and left_words(20.0, 1.0) == ""
    assert left_words(60.0, 0.1) == "about 9 min left"
