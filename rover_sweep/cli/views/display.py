"""Events of a session: progress bars and a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import shutil
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from rover_sweep.cli.views.asking import forget_typed
from rover_sweep.data.braille import BARS
from rover_sweep.data.recording import Array
from rover_sweep.files.documents import printable_lines
from rover_sweep.vehicle import events as e

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live
    from rich.progress import Progress, TaskID

_STEERED_FROM = 3  # state in which the clock of the manoeuvre starts
_WARNING = 4  # MAV_SEVERITY_WARNING


class PlainDisplay:
    """One line per important event. talk: also the messages of applet and vehicle, for a pilot."""

    def __init__(self, console: Console, talk: bool = False) -> None:
        self.console, self.talk = console, talk

    def show(self, event: e.Event) -> None:
        """One event."""
        match event:
            case e.Connected():
                self.say(f"connected to {event.vehicle.words} on {event.url}")
            case e.Notice():
                self.say(event.text, "yellow" if event.level == "warning" else "")
            case e.ParameterSet() if self.talk and not event.name.startswith("SWP_"):
                self.say(f"{event.name} {event.old:g} -> {event.value:g}")
            case e.Rebooting():
                self.say(f"rebooting the rover to apply {', '.join(event.because)}")
            case e.Said() if self.talk and (event.text.startswith("SWP") or event.severity <= _WARNING):
                self.say(f"  {event.text}")
            case e.SwitchWanted():
                words = "when ready, throw" if event.position == "high" else "throw"
                self.say(f"{words} switch {event.channel} {event.position}", "bold cyan")
            case e.RunStarted():
                self.run_started(event)
            case e.StateChanged() | e.Sample():
                self.moved(event)
            case e.RunFinished():
                self.run_finished(event)
            case e.Interrupted():
                self.interrupted(event)
            case e.LogProgress():
                self.fetching(event)
            case e.LogSaved():
                self.say(f"log fetched: {event.path}, {event.size / 1e6:.1f} MB")

    def say(self, text: str, style: str = "") -> None:
        """Print a line; wrapped only on a terminal."""
        from rich.text import Text

        self.console.print(Text(text, style), soft_wrap=not self.console.is_terminal)

    def ask(self, question: str) -> None:
        """Wait for a typed y. KeyboardInterrupt for Ctrl-C or at the end of input."""
        forget_typed()
        words = printable_lines(question)
        try:
            while self.console.input(f"{words} ", markup=False).strip().lower() not in ("y", "yes"):
                self.say("type y and Enter to start, or Ctrl-C to stop")
        except EOFError:
            raise KeyboardInterrupt from None

    def run_started(self, event: e.RunStarted) -> None:
        self.say(_title(event))

    def moved(self, event: e.StateChanged | e.Sample) -> None:
        """Does nothing: a file needs no live line."""

    def run_finished(self, event: e.RunFinished) -> None:
        if event.completed:
            self.say(f"  {event.name}: {_verdict(event)}")
        else:
            self.say(f"  {event.name} is incomplete: {event.reason}", "bold red")

    def interrupted(self, event: e.Interrupted) -> None:
        self.say(interrupted_words(event), "bold yellow")

    def fetching(self, event: e.LogProgress) -> None:
        """Does nothing: only the saved log is reported."""


class TerminalDisplay(PlainDisplay):
    """With a bar per run and a live line of the rover's state."""

    def __init__(self, live: Live, progress: Progress, talk: bool = False) -> None:
        super().__init__(live.console, talk)
        self._live, self._progress = live, progress
        self._bar: TaskID | None = None
        self._fetching: TaskID | None = None
        self._length, self._start, self._state = 0.0, math.nan, ""

    def ask(self, question: str) -> None:
        self._live.stop()
        try:
            super().ask(question)
        finally:
            self._live.start()

    def run_started(self, event: e.RunStarted) -> None:
        self._live.start()
        self._length, self._start = event.manoeuvre.duration, math.nan
        self._bar = self._progress.add_task(_title(event), total=self._length)

    def moved(self, event: e.StateChanged | e.Sample) -> None:
        if isinstance(event, e.StateChanged):
            self._state = event.name
            self._start = event.t if event.state == _STEERED_FROM else self._start
            return
        if self._bar is not None and not math.isnan(self._start):
            self._progress.update(self._bar, completed=min(event.t - self._start, self._length))
        self._line(live_line(event, self._state))

    def run_finished(self, event: e.RunFinished) -> None:
        if event.completed and self._bar is not None:
            self._progress.update(self._bar, completed=self._length)
        self._line("")
        super().run_finished(event)

    def interrupted(self, event: e.Interrupted) -> None:
        self._line("")
        super().interrupted(event)

    def fetching(self, event: e.LogProgress) -> None:
        if self._fetching is None:
            self._live.start()
            self._fetching = self._progress.add_task("", total=event.total)
        self._progress.update(
            self._fetching,
            completed=event.done,
            total=event.total,
            description=f"downloading log {event.number}",
        )

    def _line(self, text: str) -> None:
        from rich.console import Group
        from rich.text import Text

        line = Text(text, no_wrap=True, overflow="crop")
        self._live.update(Group(self._progress, line) if text else self._progress)


@contextmanager
def display(console: Console, talk: bool = False) -> Iterator[PlainDisplay]:
    """The display for this console: bars on a terminal, else plain lines."""
    if not console.is_terminal:
        yield PlainDisplay(console, talk)
        return
    from rich.live import Live
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    title = TextColumn("{task.description:<34}", markup=False)
    columns = (title, BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    progress = Progress(*columns, console=console)
    live = Live(progress, console=console, refresh_per_second=10)
    try:  # the first bar starts it, so that it does not draw over questions before a run
        yield TerminalDisplay(live, progress, talk)
    finally:
        live.stop()


def live_line(sample: e.Sample, state: str) -> str:
    """State, steering, yaw rate, lateral acceleration, speed and frequency, at most 80 columns."""
    return (
        f"{state:<17} {_number(sample.pwm, '4.0f')} us  r {_number(math.degrees(sample.r), '+5.0f')} deg/s  "
        f"a_y {_number(sample.ay, '+5.1f')} m/s²  {_number(sample.speed, '4.1f')} m/s  "
        f"{_number(sample.frequency, '4.1f')} rad/s"
    )


def _number(value: float, form: str) -> str:
    """The number, or a dash of the same width for NaN."""
    text = format(value if math.isfinite(value) else 0.0, form)
    return text if math.isfinite(value) else "-".rjust(len(text))


def interrupted_words(event: e.Interrupted) -> str:
    """A sentence on the rover's state after Ctrl-C: only what it confirmed."""
    if event.failures:
        return f"{event.name} interrupted, but not everything was released: {event.unreleased}"
    armed = "armed" if event.armed else "disarmed"
    if not event.confirmed:
        return f"{event.name} interrupted: {event.unreleased}; it was {armed} when it was last heard"
    now = "it is still armed" if event.armed else "it is disarmed"
    return f"{event.name} interrupted: the rover was released, the pilot has steering and throttle; {now}"


def _title(event: e.RunStarted) -> str:
    from rover_sweep.manoeuvre.sweep import Sweep

    m = event.manoeuvre
    about = f" about {m.middle:+g} us" if isinstance(m, Sweep) and m.middle else ""
    return f"{event.name}: {m.kind.replace('_', ' ')}, +-{m.amplitude:g} us{about}"


def _verdict(event: e.RunFinished) -> str:
    """Verdict on a run from its telemetry; "done" for a doublet, which needs no coherence."""
    from rover_sweep.live.verdict import judge

    if event.name.startswith("throttle"):
        return "done; the speed is judged from the rover's log"
    verdict = judge(event.tlog, event.span, event.name)
    return verdict.sentence if verdict.bands or verdict.advice != "keep" else "done"


WIDTH = 80


def bullet(mark: str, text: str) -> str:
    """`text` wrapped to the terminal (at most 80 columns), indented by two, with `mark` before it."""
    return _hanging(f"  {mark} ", text)


def fact(name: str, text: str) -> str:
    """`name` and wrapped `text` in two columns."""
    return _hanging(f"  {name:<16}", text)


def _hanging(head: str, text: str) -> str:
    width = min(shutil.get_terminal_size((WIDTH, 24)).columns, WIDTH)
    return textwrap.fill(text, width, initial_indent=head, subsequent_indent=" " * len(head))


def blocks(values: Array, low: float, high: float) -> str:
    """One line of bars: values (n,) between `low` (empty) and `high` (full)."""
    share = np.clip((values - low) / (high - low), 0, 1)
    return "".join(BARS[round(8 * float(s))] for s in share)
