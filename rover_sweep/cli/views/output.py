"""Output streams: results to stdout, progress and warnings to stderr; with --json only JSON to stdout."""

from __future__ import annotations

import codecs
import shlex
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.files.documents import printable_lines, shortened, within_json

if TYPE_CHECKING:
    from rich.console import Console

    from rover_sweep.data.recording import Recording
    from rover_sweep.report.document import Cell

_LONGEST = 6000  # characters of an error; a damaged file may quote a megabyte of itself
PLAIN_WIDTH = 120  # columns when not in a terminal


def echo(text: str = "", err: bool = False, nl: bool = True) -> None:
    """As click.echo, with control characters made visible; for plain text."""
    click.echo(printable_lines(text), err=err, nl=nl)


def say_next(*steps: str) -> None:
    """Print on stderr how the user goes on: commands, or what to do by hand."""
    echo(f"next: {'; '.join(steps)}", err=True)


def identify_command(session: str | Path) -> str:
    """The command that identifies from a session's folder, with its report where a session writes its own."""
    folder, report = (shlex.quote(str(path)) for path in (session, Path(session) / "report"))
    return f"rover-sweep identify {folder} --out {report}"


def echo_json(text: str) -> None:
    """Print JSON on stdout, with control characters that a terminal would obey escaped."""
    click.echo(within_json(text).removesuffix("\n"))


def print_error(message: str, notes: Sequence[str] = ()) -> None:
    """Print the error of a failed command, then one line per note (such as failed clean-up)."""
    echo(f"rover-sweep: {shortened(message, _LONGEST)}", err=True)
    for note in notes:
        echo(shortened(note, _LONGEST), err=True)


def results(as_json: bool = False) -> Console:
    """Console for tables, conclusions and paths: stdout, or stderr with as_json."""
    return _console(stderr=as_json)


def narration() -> Console:
    """Console for progress and warnings: stderr."""
    return _console(stderr=True)


def print_warnings(console: Console, runs: Sequence[Recording]) -> None:
    """Print the warnings on the recordings, each once."""
    from rover_sweep.data.recording import grouped_warnings

    for text in grouped_warnings(runs):
        console.print(f"warning: {text}", style="yellow", soft_wrap=True)


def print_table(
    console: Console,
    headings: tuple[str, ...],
    rows: Iterable[tuple[Cell | str, ...]],
    text_columns: int | tuple[int, ...] = 1,
) -> None:
    """Print a table without a title. text_columns: as of `Table`."""
    from rover_sweep.report.document import table_of
    from rover_sweep.report.on_terminal import rich_table

    console.print(rich_table(table_of("", headings, rows, text_columns=text_columns), titled=False))


def _console(stderr: bool) -> Console:
    console = _safe_console()(stderr=stderr, highlight=False, markup=False)
    if not console.is_terminal:
        console.width = max(console.width, PLAIN_WIDTH)
    return console


@cache
def _safe_console() -> type[Console]:
    """A rich console that makes control characters in text visible, but keeps rich's own control codes."""
    from rich.console import Console

    class SafeConsole(Console):
        def render(self, renderable: Any, options: Any = None) -> Iterable[Any]:
            """Each text segment, of any table or bar, made printable; control codes are separate segments."""
            for segment in super().render(renderable, options):
                safe = segment.control or segment.text.isprintable()
                yield segment if safe else segment._replace(text=printable_lines(segment.text))

    return SafeConsole


# Greek letters and signs in plain letters, for a terminal that has no others: tau instead of ?.


NAME = "rover-sweep-plain"
PLAIN = {
    **dict(
        zip("αβδκμτφψω", ("alpha", "beta", "delta", "kappa", "mu", "tau", "phi", "psi", "omega"), strict=True)
    ),
    **{"²": "^2", "³": "^3", "±": "+-", "µ": "u", "°": "deg", "·": " ", "×": "x", "√": "sqrt"},
    **{"…": "..", "–": "-", "—": "-", "−": "-", "≤": "<=", "≥": ">=", "’": "'", "→": "->", "Δ": "Delta"},
}


def in_plain_letters(error: UnicodeError) -> tuple[str, int]:
    """An error handler of `codecs`: replaces an unencodable character by its ASCII form, else by ?."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(c, "?") for c in error.object[error.start : error.end]), error.end


codecs.register_error(NAME, in_plain_letters)
