"""`rover-sweep status`: the runs in a session's folder, and the runs that remain."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rover_sweep.manoeuvre.sweep import Manoeuvre
    from rover_sweep.session.content import Content, DrivenRun

_STATES = {"begun": "", "done": "green", "stopped": "yellow", "cut": "yellow"}


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--json", "as_json", is_flag=True, help="Print session.json and the remaining runs (to_drive) on stdout."
)
def status(folder: Path, as_json: bool) -> None:
    """Show the driven runs of the session in FOLDER with their verdicts, and the runs that remain.

    Changes nothing; the session may be running.
    """
    from rover_sweep.cli.views.output import echo_json, results
    from rover_sweep.session.content import to_json
    from rover_sweep.session.folder import is_session, read_folder

    if not is_session(folder):
        raise UsageError(f"{folder} is not a session folder: it has neither session.json nor a .tlog")
    content = read_folder(folder)
    if as_json:
        document = to_json(content) | {"to_drive": [run.name for run in content.to_drive]}
        echo_json(json.dumps(document, indent=2, default=str))
        return
    console = results()
    firmware = content.vehicle.get("firmware", "an unknown rover")
    console.print(f"{folder}: {firmware}, {len(content.runs)} runs, {len(content.logs)} logs", markup=False)
    if content.runs:
        console.print(_table(content))
    left = ", ".join(f"{run.name} ({_describe(run.manoeuvre)})" for run in content.to_drive)
    remaining = f"still to drive: {left}" if left else "no runs remain"
    console.print(remaining, markup=False, soft_wrap=True)


def _table(content: Content) -> RenderableType:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for heading in ("run", "manoeuvre", "state", "log", "verdict"):
        table.add_column(heading, no_wrap=heading != "verdict")
    for run in content.runs:
        held = next((log.file for log in content.logs if run.label in log.runs), "-")
        state = Text(run.state, _STATES[run.state])
        table.add_row(Text(run.label), _describe(run.manoeuvre), state, Text(held), Text(_verdict(run)))
    return table


def _verdict(run: DrivenRun) -> str:
    """The verdict of a complete run; the reason why another run ended."""
    if run.state != "done":
        return run.reason
    return str(run.verdict["sentence"]) if run.verdict else "not checked; use rover-sweep coherence"


def _describe(manoeuvre: Manoeuvre | None) -> str:
    return (
        "unknown" if manoeuvre is None else f"{manoeuvre.kind.replace('_', ' ')} {manoeuvre.amplitude:g} us"
    )
