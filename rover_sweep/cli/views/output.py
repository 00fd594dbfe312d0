"""Where output goes: results to stdout, narration to stderr; --json leaves stdout to the JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from rover_sweep.files.printable import printable_lines, shortened, within_json

if TYPE_CHECKING:
    from rich.console import Console

    from rover_sweep.data.recording import Recording

_LONGEST = 6000  # characters of an error; a damaged file may quote a megabyte of itself
PLAIN_WIDTH = 120  # columns where nobody's window sets a limit


def echo(text: str = "", err: bool = False, nl: bool = True) -> None:
    """As click.echo: the door to the terminal for plain text, which no control character passes."""
    click.echo(printable_lines(text), err=err, nl=nl)


def echo_json(text: str) -> None:
    """JSON to stdout: what JSON need not escape and a terminal would obey is escaped as JSON does."""
    click.echo(within_json(text).removesuffix("\n"))


def tell_error(words: str, notes: Sequence[str] = ()) -> None:
    """The last sentence of a command that failed, and what could not be undone after it, a line each."""
    echo(f"rover-sweep: {shortened(words, _LONGEST)}", err=True)
    for note in notes:
        echo(shortened(note, _LONGEST), err=True)


def results(as_json: bool = False) -> Console:
    """For tables, conclusions and paths; as_json: stdout belongs to the JSON."""
    return _console(stderr=as_json)


def narration() -> Console:
    """For progress and warnings."""
    return _console(stderr=True)


def tell_warnings(console: Console, runs: Sequence[Recording]) -> None:
    """What spoils a recording, once for all runs of the same file."""
    texts = dict.fromkeys(f"{r.name}: {n.text}" for r in runs for n in r.notes if n.level == "warning")
    for text in texts:
        console.print(f"warning: {text}", style="yellow", markup=False, soft_wrap=True)


def _console(stderr: bool) -> Console:
    from rover_sweep.cli.views.safe_console import SafeConsole

    console = SafeConsole(stderr=stderr, highlight=False, markup=False)
    if not console.is_terminal:
        console.width = max(console.width, PLAIN_WIDTH)
    return console
