"""Measure the logs of a fleet, find its drifts, write the report: for `batch`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rover_sweep.batch.finished_work import Progress

KEPT = "measured"  # folder of the saved values


@dataclass(frozen=True)
class BatchCall:
    """What the user asked for. scheduler: of a Dask cluster; workers: local processes; out: the folder."""

    logs: tuple[str, ...]
    vehicles: Path | None
    scheduler: str | None
    workers: int | None
    diagnose: bool
    parquet: bool
    out: Path


def show_season(call: BatchCall, as_json: bool) -> None:
    """Measure, analyse, write, print the summary."""
    from rover_sweep.batch.diagnosed_days import diagnosed_days
    from rover_sweep.batch.drawn_pages import drawn_pages
    from rover_sweep.batch.log_sources import log_sources
    from rover_sweep.batch.measured_logs import measured_logs
    from rover_sweep.batch.season_of_logs import season_of_logs
    from rover_sweep.batch.vehicle_files import files_beside, read_vehicle_files
    from rover_sweep.batch.workers import workers
    from rover_sweep.cli.views.output import echo_json, results
    from rover_sweep.report.season.season_folder import season_document, write_season
    from rover_sweep.report.season.season_terminal import season_summary

    sources = log_sources(call.logs)
    files = read_vehicle_files(call.vehicles) if call.vehicles else files_beside(sources)
    with workers(call.workers, call.scheduler) as pool:
        with _progress("log", len(sources)) as progress:
            logs = measured_logs(sources, files, call.out / KEPT, pool, progress)
        found = season_of_logs(logs, files)
        said = {}
        if call.diagnose:
            with _progress("day", sum(len(v.logs) for v in found.vehicles)) as progress:
                said = diagnosed_days(found, logs, files, call.out, pool, progress)
        pages = drawn_pages(found, said, pool)
    page = write_season(found, logs, pages, call.out, call.parquet)
    shown = results(as_json)
    season_summary(found, shown)
    shown.print(f"report: {page}", markup=False, soft_wrap=True)
    if as_json:
        echo_json(season_document(found))


@contextmanager
def _progress(what: str, count: int) -> Iterator[Progress]:
    """A bar with an estimate on a terminal; a line each tenth elsewhere."""
    import time

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from rover_sweep.cli.views.output import narration

    console = narration()
    started = time.monotonic()
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console,
        transient=True,
    ) as bar:
        task = bar.add_task(f"{what}s", total=count)

        def show(done: int, left: int) -> None:
            if not done and left < count:
                console.print(f"{count - left} of {count} {what}s were done before")
            bar.update(task, completed=done, total=left)
            if not console.is_terminal and done and (done == left or done % max(1, left // 10) == 0):
                rest = (time.monotonic() - started) / done * (left - done)
                click.echo(f"{done} of {left} {what}s done, about {rest:.0f} s left", err=True)

        yield show
