"""`rover-sweep session`: a whole session in the terminal UI, by single keys."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.vehicle_link import LimitType, access_options

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.connection import Access

LOOPBACK = "127.0.0.1"
_PILOT_PATIENCE = 900.0  # s to wait for the pilot to arm and throw the switch, as in `rover-sweep run`


@click.command()
@click.option("--connect", "url", default="", metavar="URL", help="URL to list first, as for `run`.")
@access_options
@click.option(
    "--vehicle",
    "vehicle_file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Vehicle file (default: the session's, or rover.toml here).",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False),
    default="session",
    show_default=True,
    metavar="FOLDER",
    help="Folder of the session; an existing session is continued.",
)
@click.option(
    "--limit",
    "limits",
    type=LimitType(),
    multiple=True,
    help="Limit of the applet, e.g. v_max=3. [default: as set on the rover]",
)
@click.option(
    "--arm", is_flag=True, help="Allow this program to arm and disarm the rover; it asks before each run."
)
@click.option(
    "--throttle",
    type=click.IntRange(1000, 2000),
    metavar="US",
    help="With --arm: allow this program to drive, with this throttle PWM.",
)
@click.option(
    "--throw-switch", is_flag=True, help="Allow this program to throw the applet's switch; it asks first."
)
@click.option("--web", is_flag=True, help="Serve the session to one browser instead of this terminal.")
@click.option(
    "--web-host",
    default=LOOPBACK,
    show_default=True,
    metavar="ADDRESS",
    help="Address to serve at; whoever reaches it can drive the rover.",
)
@click.option("--web-port", type=click.IntRange(1, 65535), default=8000, show_default=True, metavar="PORT")
@click.option("--in-browser", is_flag=True, hidden=True)
def session(
    url: str,
    access: Access,
    vehicle_file: str | None,
    out: str,
    limits: tuple[tuple[str, float], ...],
    arm: bool,
    throttle: int | None,
    throw_switch: bool,
    web: bool,
    web_host: str,
    web_port: int,
    in_browser: bool,
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

    if url:
        parse_url(url)
    if web:
        serve(web_host, web_port)
        return
    folder = Path(out)
    path = _vehicle_path(vehicle_file, folder)
    vehicle = load(path) if path else None
    extra = ({"gcs": 1.0} if throttle is not None else {}) | dict(limits)
    if in_browser:
        extra["gcs"] = 1.0  # a program that hangs or is killed must not leave a run behind
    settings = RunSettings(
        arm, throttle, "override" if throw_switch else "pilot", extra, patience=_PILOT_PATIENCE
    )
    source = VehicleSource(folder, path, access=access)
    kept = source.session
    setup = Setup(
        settings,
        url,
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
