"""Long work: what it does, how far it is, how long it will take; a bar on a terminal, else plain lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rover_sweep.cli.views.output import echo, narration

FIRST, EVERY = 2.0, 5.0  # s to the first plain line, and between them
EARLY = 0.03  # share done below which the time left is not estimated
Report = Callable[[float, str], None]


@dataclass(frozen=True)
class ShownWork:
    """Called with the share done, 0..1, and the current step. tell: a line above the bar, terminals only."""

    report: Report
    tell: Callable[[str], None]

    def __call__(self, share: float, step: str) -> None:
        self.report(share, step)


@contextmanager
def long_work(what: str) -> Iterator[ShownWork]:
    """Shows the work on stderr.

    On a terminal the bar disappears at the end. Elsewhere: a line after 2 s, then at most each 5 s.
    """
    console = narration()
    if not console.is_terminal:
        yield ShownWork(_plain_lines(what, time.monotonic), lambda line: None)
        return
    from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn
    from rich.progress import TimeElapsedColumn as Elapsed

    words = TextColumn("{task.description:<42.42}", markup=False)
    left = TextColumn("{task.fields[left]}", markup=False)
    columns = (SpinnerColumn(), words, BarColumn(20), TaskProgressColumn(), Elapsed(), left)
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(what, total=None, left="")
        started = time.monotonic()

        def show(share: float, step: str) -> None:
            rest = left_words(time.monotonic() - started, share)
            progress.update(task, total=1.0, completed=share, description=step or what, left=rest)

        yield ShownWork(show, lambda line: console.print(line, style="dim", markup=False))


def _plain_lines(what: str, clock: Callable[[], float]) -> Report:
    started = clock()
    last = started + FIRST - EVERY

    def show(share: float, step: str) -> None:
        nonlocal last
        now = clock()
        if now - last < EVERY:
            return
        last = now
        parts = [
            f"{what}: {100 * share:.0f} %",
            step,
            f"{now - started:.0f} s",
            left_words(now - started, share),
        ]
        echo(", ".join(part for part in parts if part), err=True)

    return show


def left_words(seconds: float, share: float) -> str:
    """About how long the rest takes, from the time so far; "" too early to say."""
    if not EARLY <= share < 1:
        return ""
    rest = seconds * (1 - share) / share
    return f"about {rest:.0f} s left" if rest < 90 else f"about {rest / 60:.0f} min left"
