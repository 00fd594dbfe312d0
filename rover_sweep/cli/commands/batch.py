"""`rover-sweep batch`: what drifted on the vehicles of a fleet over a season."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("logs", nargs=-1, required=True, metavar="LOGS...")
@click.option(
    "--vehicles",
    type=click.Path(exists=True, file_okay=False),
    metavar="DIR",
    help="Folder with the vehicle files: NAME.toml for the logs in a folder NAME, rover.toml for all others; "
    "fleet.toml lists boards by NAME. Default: rover.toml beside the logs.",
)
@click.option("--scheduler", metavar="URL", help="Work on a Dask cluster, e.g. tcp://10.0.0.5:8786.")
@click.option(
    "--workers",
    type=click.IntRange(1),
    metavar="N",
    help="Local processes (default: one per processor; not with --scheduler).",
)
@click.option("--diagnose", is_flag=True, help="Also diagnose each day of each vehicle (a minute each).")
@click.option("--parquet", is_flag=True, help="Write the tables as Parquet too (needs pyarrow).")
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False),
    metavar="SEASON",
    help="Folder of the report; created if missing. Logs measured there before are not measured again.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print season.json on stdout; the summary goes to stderr."
)
def batch(
    logs: tuple[str, ...],
    vehicles: str | None,
    scheduler: str | None,
    workers: int | None,
    diagnose: bool,
    parquet: bool,
    out: str,
    as_json: bool,
) -> None:
    """Find out what drifted on each vehicle of a fleet over a season.

    LOGS are .BIN and .tlog files, folders of them, or URLs (s3://..., with * for many). The runs of each log
    are found and fitted; its vehicle is that of its vehicle file, else of the board's id in the log. Tyres,
    servo lag, delay, play, trim, inertia and instruments are compared from day to day. A log that cannot be
    used is listed with the reason.
    """
    from rover_sweep.cli.driving.shown_results import BatchCall, show_season
    from rover_sweep.cli.options import check_writable
    from rover_sweep.errors import UsageError

    if scheduler and workers:
        raise UsageError(
            "--workers is for local processes; start the workers of the cluster with dask worker"
        )
    check_writable(Path(out))
    call = BatchCall(
        logs, Path(vehicles) if vehicles else None, scheduler, workers, diagnose, parquet, Path(out)
    )
    show_season(call, as_json)
