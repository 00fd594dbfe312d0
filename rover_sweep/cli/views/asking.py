"""Questions at the terminal."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import nan, radians
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.views.output import echo, narration
from rover_sweep.data.results import Progress
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import printable_lines
from rover_sweep.system import STOP_SIGNALS, drop_typed

if TYPE_CHECKING:
    from rover_sweep.bench.drive import Keep, Movement


def forget_typed() -> None:
    """Drop pending input of a terminal: a key pressed earlier must not move a vehicle. A pipe is not read."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        if sys.stdin.isatty():
            drop_typed()


class Interruption:
    """A context in which the first Ctrl-C only requests a stop (`to_stop`), the second raises."""

    def __init__(self, on_request: Callable[[], object]) -> None:
        self._on_request, self._requested = on_request, False
        self._before: Any = None

    def to_stop(self) -> bool:
        """True once Ctrl-C has been pressed."""
        return self._requested

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():  # elsewhere signals cannot be caught
            self._before = signal.signal(signal.SIGINT, self._pressed)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _pressed(self, number: int, frame: FrameType | None) -> None:
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True
        self._on_request()


@contextmanager
def let_go_on_signals() -> Iterator[None]:
    """Within it, `kill` and a closed terminal act like Ctrl-C, so that a rover is released at once.

    Ctrl-C also works in a program started in the background, where Python would ignore it. Under nohup a
    closed terminal has no effect.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    for number, handler in before.items():
        if number == signal.SIGINT or handler != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


FIRST, EVERY = 2.0, 5.0  # s to the first plain line, and between them
EARLY = 0.03  # share done below which the time left is not estimated


@dataclass(frozen=True)
class ShownWork:
    """Called with the current step and the share done, 0..1. tell: a line above the bar, terminals only."""

    report: Progress
    tell: Callable[[str], None]

    def __call__(self, step: str, share: float) -> None:
        self.report(step, share)


@contextmanager
def long_work(what: str) -> Iterator[ShownWork]:
    """Shows the work on stderr.

    On a terminal the bar disappears at the end. Elsewhere: a line after 2 s, then at most each 5 s.
    """
    console = narration()
    if not console.is_terminal:
        yield ShownWork(_plain_lines(what, time.monotonic), lambda line: None)
        return
    from rich.progress import BarColumn, SpinnerColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bar
    from rich.progress import TimeElapsedColumn as Elapsed

    words = TextColumn("{task.description:<42.42}", markup=False)
    left = TextColumn("{task.fields[left]}", markup=False)
    columns = (SpinnerColumn(), words, BarColumn(20), TaskProgressColumn(), Elapsed(), left)
    with Bar(*columns, console=console, transient=True) as progress:
        task = progress.add_task(what, total=None, left="")
        started = time.monotonic()

        def show(step: str, share: float) -> None:
            rest = left_words(time.monotonic() - started, share)
            progress.update(task, total=1.0, completed=share, description=step or what, left=rest)

        yield ShownWork(show, lambda line: console.print(line, style="dim"))


def _plain_lines(what: str, clock: Callable[[], float]) -> Progress:
    started = clock()
    last = started + FIRST - EVERY

    def show(step: str, share: float) -> None:
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
    """The estimated remaining time; "" if it is too early for an estimate."""
    if not EARLY <= share < 1:
        return ""
    rest = seconds * (1 - share) / share
    return f"about {rest:.0f} s left" if rest < 90 else f"about {rest / 60:.0f} min left"


def confirmed(question: str) -> bool:
    """True if the user answers yes, asked on stderr; drops what was typed before the question."""
    forget_typed()
    return click.confirm(printable_lines(question), err=True)


def chosen_of(question: str, answers: Sequence[str]) -> str:
    """The user's choice of `answers`, asked on stderr until valid; drops what was typed before."""
    forget_typed()
    return str(click.prompt(printable_lines(question), type=click.Choice(answers), err=True))


def refuse_unasked(given: bool, words: str) -> None:
    """UsageError where consent is neither given nor can be asked for."""
    if not given and not sys.stdin.isatty():
        raise UsageError(f"cannot ask, stdin is not a terminal; give --yes to {words} without questions")


def reboot_consent(given: bool) -> Callable[[tuple[str, ...]], bool]:
    """A function that asks for consent to a reboot, given its reasons; given: consent without asking."""
    return lambda because: given or confirmed(f"Reboot the rover to apply {', '.join(because)}?")


LARGEST = 60.0  # deg
_YES = ("y", "yes")
_NUMBER = re.compile(r"\s*([+-]?\d+(?:[.,]\d*)?|[+-]?[.,]\d+)\s*(?:deg|°)?\s*([lr]?)\s*", re.IGNORECASE)


def parse_angle(text: str) -> float | None:
    """Angle in rad, left positive, from `12.5`, `-3`, `4,2 l` or `4.2r`; None for other text."""
    match = _NUMBER.fullmatch(text)
    if not match:
        return None
    degrees, side = float(match[1].replace(",", ".")), match[2].lower()
    if abs(degrees) > LARGEST or (side and match[1].strip()[0] in "+-"):
        return None
    return radians(-degrees if side == "r" else degrees)


class _Reading(threading.Thread):
    """One read of a file in a thread: Windows cannot be asked whether one would wait."""

    def __init__(self, source: int) -> None:
        super().__init__(name="read the terminal", daemon=True)
        self._source, self.data = source, b""
        self.start()

    def run(self) -> None:
        with contextlib.suppress(OSError):
            self.data = os.read(self._source, 4096)


class Terminal:
    """An `Operator` at a terminal. unasked: allow movements without asking (simulated rover)."""

    def __init__(self, say: Callable[[str], None], unasked: bool = False) -> None:
        self._say, self._unasked = say, unasked
        self._pending = b""
        self._reading: _Reading | None = None  # stays, if a question is left without an answer

    def tell(self, text: str) -> None:
        self._say(text)

    def allow(self, movement: Movement, stops: str, keep: Keep) -> bool:
        """True if the user types yes; any other answer skips this movement."""
        self._say(f"\n{movement.name}: {movement.words}\n{stops}")
        if self._unasked:
            return True
        self._forget()
        self._say("wheels off the ground, hands and cables clear? yes to move, anything else to skip:")
        return self._line(keep).strip().lower() in _YES

    def angle(self, number: int, of: int, offset: float, keep: Keep) -> tuple[float, str]:
        """Ask until an angle is typed; (rad, text), (nan, "") for an empty line."""
        self._forget()
        self._say(f"{number}/{of}, {offset:+.0f} us: wheel angle [deg], l or r (empty: skip)")
        while True:
            typed = self._line(keep).strip()
            if not typed:
                return nan, ""
            angle = parse_angle(typed)
            if angle is not None:
                return angle, typed
            self._say(
                f"{typed!r} is not an angle; type up to {LARGEST:g} deg, as '12.5 l', '3 r' or '-4' (right)"
            )

    def _forget(self) -> None:
        """Drop what was typed before the question."""
        if sys.stdin.isatty():
            self._pending = b""
            if self._reading is not None and not self._reading.is_alive():  # typed after a question
                self._reading = None
            forget_typed()

    def _line(self, keep: Keep) -> str:
        """A line of stdin; keeps the link alive meanwhile. UsageError at the end of input."""
        try:
            source = sys.stdin.fileno()
        except (OSError, ValueError, AttributeError):  # not a file, as in a program that calls this one
            text = sys.stdin.readline()
            if text:
                return text
            raise UsageError("no answer (end of input); the steering was released") from None
        while b"\n" not in self._pending:
            if self._reading is None:
                self._reading = _Reading(source)
            keep()
            if self._reading.is_alive():
                continue
            data, self._reading = self._reading.data, None
            if not data:
                raise UsageError("no answer (end of input); the steering was released")
            self._pending += data
        line, _, self._pending = self._pending.partition(b"\n")
        return line.decode(errors="replace")
