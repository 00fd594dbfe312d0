"""`rover-sweep coherence`: the quick verdict on runs, before the rover leaves the car park."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import filter_overrides, reading_options

if TYPE_CHECKING:
    from rover_sweep.identify.quality import CoherenceVerdict


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@reading_options
@click.option("--json", "as_json", is_flag=True, help="The verdicts as JSON on stdout.")
def coherence(
    runs: tuple[str, ...],
    columns: str | None,
    gyro_filter: float | None,
    accel_filter: float | None,
    as_json: bool,
) -> None:
    """Say of each run whether its coherence is good enough, and what to change if it is not.

    RUN is a .BIN, a .tlog, a .csv, log.BIN+log.tlog, or the folder of a session. No vehicle
    file is needed. A poor run is an answer, not an error: the exit code is 0.
    """
    from rover_sweep.identify.quality import assess
    from rover_sweep.preparation import load_runs

    found = load_runs(runs, columns, filter_overrides(gyro_filter, accel_filter))
    verdicts = [assess(run) for run in found]
    if as_json:
        noted = [
            asdict(v) | {"notes": [asdict(n) for n in r.notes]} for v, r in zip(verdicts, found, strict=True)
        ]
        click.echo(json.dumps(noted, indent=2))
        return
    for verdict, run in zip(verdicts, found, strict=True):
        show(verdict, [note.text for note in run.notes if note.level == "warning"])


def show(verdict: CoherenceVerdict, warnings: Sequence[str] = ()) -> None:
    """One run's verdict: the sentence first, then what spoils the recording, then a line per response."""
    from rich.table import Table
    from rich.text import Text

    from rover_sweep.cli.output import results

    console = results()
    sentence = (verdict.sentence, "green" if verdict.keep else "yellow")
    console.print(Text.assemble((verdict.run, "bold"), ": ", sentence), soft_wrap=True)
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow", highlight=False, soft_wrap=True, markup=False)
    table = Table(box=None, padding=(0, 2))
    for heading in ("response", "usable band, rad/s", "range at >= 0.6", "lowest coherence"):
        table.add_column(heading, justify="left" if heading == "response" else "right")
    for o in verdict.outputs:
        band = f"{o.band[0]:.2g} - {o.band[1]:.3g}" if o.band else "none"
        table.add_row(o.output, band, f"{100 * o.covered:.0f} %", f"{o.lowest:.2f} at {o.lowest_at:.2g}")
    console.print(table)
