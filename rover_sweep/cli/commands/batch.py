"""`rover-sweep batch`: what drifted on the vehicles of a fleet over a season."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import FOLDER, argument, check_writable, option, options
from rover_sweep.cli.views.asking import long_work
from rover_sweep.cli.views.output import echo_json, narration, results, say_next
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.batch.measured_logs import Progress

KEPT = "measured"  # folder of the saved values


@click.command()
@options
def batch(
    logs: tuple[str, ...] = argument("LOGS...", nargs=-1, required=True),
    vehicles: str | None = option(
        "Folder with the vehicle files: NAME.toml for the logs in a folder NAME, rover.toml for all others; "
        "fleet.toml lists boards by NAME. Default: rover.toml beside the logs.",
        click.Path(exists=True, file_okay=False),
        "DIR",
    ),
    scheduler: str | None = option("Work on a Dask cluster, e.g. tcp://10.0.0.5:8786.", metavar="URL"),
    workers: int | None = option(
        "Local processes (default: one per processor; not with --scheduler).", click.IntRange(1), "N"
    ),
    diagnose: bool = option("Also diagnose each day of each vehicle (a minute each)."),
    parquet: bool = option("Write the tables as Parquet too (needs pyarrow)."),
    out: str = option(
        "Folder of the report; created if missing. Logs measured there before are not measured again.",
        FOLDER,
        "SEASON",
        required=True,
    ),
    as_json: bool = option("Print season.json on stdout; the summary goes to stderr.", flag="--json"),
) -> None:
    """Find out what drifted on each vehicle of a fleet over a season.

    LOGS are .BIN and .tlog files, folders of them, or URLs (s3://..., with * for many). The runs of each log
    are found and fitted; its vehicle is that of its vehicle file, else of the board's id in the log. Tyres,
    servo lag, delay, play, trim, inertia and instruments are compared from day to day. A log that cannot be
    used is listed with the reason.
    """
    from rover_sweep.batch import measured_logs as measured
    from rover_sweep.batch.season_of_logs import diagnosed_days, drawn_pages, season_of_logs
    from rover_sweep.report.on_terminal import on_terminal
    from rover_sweep.report.season_report import season_document, season_report, write_season

    if scheduler and workers:
        raise UsageError(
            "--workers is for local processes; start the workers of the cluster with dask worker"
        )
    folder = Path(out)
    check_writable(folder)
    sources = measured.log_sources(logs)
    files = measured.read_vehicle_files(Path(vehicles)) if vehicles else measured.files_beside(sources)
    with measured.workers(workers, scheduler) as pool:
        with _progress("log", len(sources)) as progress:
            values = measured.measured_logs(sources, files, folder / KEPT, pool, progress)
        found = season_of_logs(values, files)
        said = {}
        if diagnose:
            with _progress("day", sum(len(v.logs) for v in found.vehicles)) as progress:
                said = diagnosed_days(found, values, files, folder, pool, progress)
        pages = drawn_pages(found, said, pool)
    page = write_season(found, values, pages, folder, parquet)
    shown = results(as_json)
    shown.print(on_terminal(season_report(found)))
    shown.print(f"report: {page}", soft_wrap=True)
    if not diagnose:
        say_next("the same with --diagnose explains the changes that it lists")
    if as_json:
        echo_json(season_document(found))


@contextmanager
def _progress(what: str, count: int) -> Iterator[Progress]:
    """A bar with an estimate on a terminal; a line now and then elsewhere."""
    with long_work(f"{count} {what}s") as work:

        def show(done: int, left: int) -> None:
            if not done and left < count:
                narration().print(f"{count - left} of {count} {what}s were done before")
            work(f"{done} of {left}", done / max(left, 1))
            if done and done == left:
                narration().print(f"{done} of {left} {what}s done")

        yield show
