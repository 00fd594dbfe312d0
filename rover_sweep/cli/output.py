"""Where output goes: results to stdout, narration to stderr; --json leaves stdout to the JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

PLAIN_WIDTH = 120  # columns where nobody's window sets a limit


def results(as_json: bool = False) -> Console:
    """For tables, conclusions and paths; as_json: stdout belongs to the JSON."""
    return _console(stderr=as_json)


def narration() -> Console:
    """For progress and warnings."""
    return _console(stderr=True)


def _console(stderr: bool) -> Console:
    from rich.console import Console

    console = Console(stderr=stderr, highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, PLAIN_WIDTH)
    return console
