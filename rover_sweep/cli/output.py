"""Where output goes: results to stdout, narration to stderr; --json leaves stdout to the JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from rover_sweep.identify.recording import Recording

PLAIN_WIDTH = 120  # columns where nobody's window sets a limit


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
    from rich.console import Console

    console = Console(stderr=stderr, highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, PLAIN_WIDTH)
    return console
