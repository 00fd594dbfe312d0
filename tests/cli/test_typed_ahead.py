"""What is typed before a question moves nothing: keys are pressed into a terminal in advance."""

from __future__ import annotations

import io
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from rich.console import Console

from rover_sweep.bench.drive import steps
from rover_sweep.cli.views.asking import Terminal
from rover_sweep.cli.views.display import PlainDisplay

pytest.importorskip("termios")
LONG_ENOUGH = 0.4  # s, in which a stray answer would have been taken


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Types into the terminal that is stdin."""
    master, slave = os.openpty()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield lambda text: [os.write(master, text.encode()), time.sleep(0.05)][1]
        os.close(master)


def answered(question: Callable[[], object], typed: Callable[[], None]) -> tuple[bool, object]:
    """(whether it ended before anything was typed, its answer)."""
    answers: list[object] = []
    asked = threading.Thread(target=lambda: answers.append(question()), daemon=True)
    asked.start()
    asked.join(LONG_ENOUGH)
    early = not asked.is_alive()
    typed()
    asked.join(5.0)
    assert answers
    return early, answers[0]


def test_a_run_waits_for_a_y_typed_after_the_question(keyboard: Callable[[str], None]) -> None:
    said = io.StringIO()
    display = PlainDisplay(Console(file=said), talk=False)
    keyboard("y\n\ny\n")
    early, _ = answered(
        lambda: display.ask("is the area clear?"), lambda: (keyboard("\n"), keyboard("y\n"))[1]
    )
    assert not early
    assert said.getvalue().count("type y and Enter") == 1  # of the Enter alone


@pytest.mark.parametrize(("answer", "allowed"), [("yes\n", True), ("no\n", False)])
def test_the_wheels_wait_for_a_yes_typed_after_the_question(keyboard, answer, allowed):
    terminal = Terminal(lambda text: None)
    movement = steps((50.0,))
    keyboard("yes\n")
    question = lambda: terminal.allow(movement, "Ctrl-C stops", lambda: time.sleep(0.01))  # noqa: E731
    assert answered(question, lambda: keyboard(answer)) == (False, allowed)
