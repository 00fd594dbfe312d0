"""`rover-sweep session`: a whole session in the terminal UI, by single keys."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import FOLDER, VEHICLE, option, options
from rover_sweep.cli.vehicle_link import ACCESS, LIMIT_SET, PILOT_PATIENCE, THROTTLE

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.connection import Access

LOOPBACK = "127.0.0.1"


@click.command()
@options
def session(
    connect: str = option("URL to list first, as for `run`.", metavar="URL", default=""),
    access: Access = ACCESS,
    vehicle_file: str | None = VEHICLE,
    out: str = option(
        "Folder of the session; an existing session is continued.", FOLDER, "FOLDER", default="session"
    ),
    limit: tuple[tuple[str, float], ...] = LIMIT_SET,
    arm: bool = option("Allow this program to arm and disarm the rover; it asks before each run."),
    throttle: int | None = THROTTLE,
    throw_switch: bool = option("Allow this program to throw the applet's switch; it asks first."),
    web: bool = option("Serve the session to one browser instead of this terminal."),
    web_host: str = option(
        "Address to serve at; whoever reaches it can drive the rover.", metavar="ADDRESS", default=LOOPBACK
    ),
    web_port: int = option(None, click.IntRange(1, 65535), "PORT", default=8000),
    in_browser: bool = option(None, hidden=True),
) -> None:
    """Connect, check, plan, drive, judge, identify and diagnose on one screen, by single keys.

    The pilot arms, drives and throws the switch, unless --arm, --throttle or --throw-switch allow this
    program to do it; it then asks before each run. SPACE or ESC ends a run at once. Without the laptop,
    switch low, disarming or a mode change ends it.
    """
    from rover_sweep.cli.driving.job import serve
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.live.vehicle_source import VehicleSource
    from rover_sweep.tui.app import show
    from rover_sweep.tui.model.setup import Setup, fetched_logs, memory_file, records, rows, runs_of_plan
    from rover_sweep.vehicle.link.transport import parse_url
    from rover_sweep.vehicle.run.controls import RunSettings

    if connect:
        parse_url(connect)
    if web:
        serve(web_host, web_port)
        return
    folder = Path(out)
    path = _vehicle_path(vehicle_file, folder)
    vehicle = load(path) if path else None
    extra = ({"gcs": 1.0} if throttle is not None else {}) | dict(limit)
    if in_browser:
        extra["gcs"] = 1.0  # a program that hangs or is killed must not leave a run behind
    settings = RunSettings(
        arm, throttle, "override" if throw_switch else "pilot", extra, patience=PILOT_PATIENCE
    )
    source = VehicleSource(folder, path, access=access)
    kept = source.session
    setup = Setup(
        settings,
        connect,
        folder,
        path,
        vehicle,
        memory_file(),
        rows(kept.content),
        records(kept.content, folder),
        fetched_logs(kept.content, folder),
        lambda plan: kept.plan(runs_of_plan(plan)),
    )
    show(source, setup, in_browser=in_browser)


def _vehicle_path(given: str | None, folder: Path) -> Path | None:
    """The vehicle file: as given, else the session's, else rover.toml here, else None."""
    if given:
        return Path(given)
    return next((p for p in (folder / "rover.toml", Path("rover.toml")) if p.is_file()), None)
