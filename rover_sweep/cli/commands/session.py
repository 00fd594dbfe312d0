"""`rover-sweep session`: a whole session in the terminal UI, by single keys."""

from __future__ import annotations

import ipaddress
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.driving_options import PERMISSIONS, Permissions
from rover_sweep.cli.options import FOLDER, VEHICLE, option, options
from rover_sweep.cli.vehicle_link import ACCESS
from rover_sweep.cli.views.output import narration
from rover_sweep.errors import UsageError, missing_extra

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
    allowed: Permissions = PERMISSIONS,
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
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.live.vehicle_source import VehicleSource
    from rover_sweep.tui.app import show
    from rover_sweep.tui.model.setup import Setup, fetched_logs, memory_file, records, rows, runs_of_plan
    from rover_sweep.vehicle.link.transport import parse_url

    if connect:
        parse_url(connect)
    if web:
        serve(web_host, web_port)
        return
    folder = Path(out)
    places = (folder / "rover.toml", Path("rover.toml"))
    path = Path(vehicle_file) if vehicle_file else next((p for p in places if p.is_file()), None)
    vehicle = load(path) if path else None
    settings = allowed.settings()
    if in_browser:  # a program that hangs or is killed must not leave a run behind
        settings = replace(settings, extra={**settings.extra, "gcs": 1.0})
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


OPEN = "warning: whoever has the address printed below, or reads the network of {host}, can drive the rover"
ALL = ("0.0.0.0", "::", "")


def serve(host: str, port: int) -> None:
    """Serve the session of this command line until Ctrl-C; UsageError where that is not possible."""
    if os.name == "nt":
        raise UsageError("the session in a browser needs Linux or macOS; use `rover-sweep session` here")
    try:
        from rover_sweep.tui.session_server import SessionServer
    except ImportError:
        raise missing_extra("the session in a browser needs textual-serve", "web") from None
    if host in ALL:
        raise UsageError(
            f"--web-host {host!r} is no single address; give the one of this computer in the network of the "
            "browser, as in --web-host 192.168.1.20"
        )
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = host == "localhost"
    if not loopback:
        narration().print(OPEN.format(host=host), style="yellow", soft_wrap=True)
    try:
        SessionServer(program(sys.argv[1:]), host, port).serve()
    except OSError as error:  # the port is taken, or the address is not one of this computer
        raise UsageError(
            f"cannot serve at {host} port {port}: {error.strerror}; try --web-port {port + 1}"
        ) from None


def program(arguments: Sequence[str]) -> list[str]:
    """The command of the program behind the page, from the arguments of `session --web`."""
    kept, skip = [], False
    for argument in arguments:
        name = argument.partition("=")[0]
        if not skip and name not in ("--web", "--web-host", "--web-port"):
            kept.append(argument)
        skip = not skip and name in ("--web-host", "--web-port") and "=" not in argument
    return [sys.executable, "-m", "rover_sweep", *kept, "--in-browser"]
