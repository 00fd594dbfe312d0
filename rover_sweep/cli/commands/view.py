"""`rover-sweep view`: a page that plots any channel of a log against another."""

from __future__ import annotations

from pathlib import Path

import click

from rover_sweep.cli.types.options import filter_overrides, reading_options
from rover_sweep.cli.types.text_file import refuse_input
from rover_sweep.errors import UsageError


@click.command()
@click.argument("log", metavar="LOG")
@reading_options
@click.option(
    "--out",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The page, one HTML file. [default: the log's name with .html, here]",
)
def view(
    log: str,
    columns: str | None,
    gyro_filter: float | None,
    accel_filter: float | None,
    system: int | None,
    out: str | None,
) -> None:
    """Write a page with the channels of LOG (.BIN, .tlog, .csv): any against time or another.

    The page needs no network and no other file.
    """
    from rover_sweep.cli.views.long_work import long_work
    from rover_sweep.cli.views.output import results
    from rover_sweep.files.replaced import write_file
    from rover_sweep.logs.read import read_logs
    from rover_sweep.report.view.log_page import log_page

    page = Path(out or f"{Path(log).stem}.html")
    refuse_input(str(page), log, columns)
    if out is None and page.exists() and b"rover-sweep" not in page.read_bytes():
        raise UsageError(f"{page} exists and is no page of this program; give --out FILE")
    filters = filter_overrides(gyro_filter, accel_filter)
    with long_work(f"reading {Path(log).name}"):
        logs = read_logs(log, column_map=columns, filters=filters, system=system)
    channels = [
        {**dict(each.signals), **{_steering(s.unit, k): s for k, s in enumerate(each.steering)}}
        for each in logs
    ]
    path = write_file(page, log_page(Path(log).name, channels))
    results().print(f"page: {path}", soft_wrap=True, markup=False)


def _steering(unit: str, place: int) -> str:
    """The name of a recorded steering output, best first."""
    name = "delta" if "rad" in unit else "pwm"
    return name if not place else f"{name} {place + 1}"
