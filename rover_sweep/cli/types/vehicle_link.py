"""The vehicle behind --connect, for commands that only ask or set it: their options, and their link."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.types.which_vehicle import access_options

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.access import Access
    from rover_sweep.vehicle.link.link import Link

URL_HELP = "tcp:HOST:PORT, udp:HOST:PORT (listen), or /dev/ttyACM0,115200."

_connect = click.option("--connect", required=True, metavar="URL", help=URL_HELP)
json_option = click.option("--json", "as_json", is_flag=True, help="JSON on stdout, nothing else there.")


def connect_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """--connect, which must be given, and what says which vehicle there is meant."""
    return _connect(access_options(command))


def via_option(meaning: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """--via, the library that talks to the vehicle; meaning: what it does for the command."""
    return click.option(
        "--via", type=click.Choice(["mavlink", "mavsdk"]), default="mavlink", show_default=True, help=meaning
    )


@contextmanager
def unkept_link(url: str, access: Access) -> Iterator[Link]:
    """A link whose recording is thrown away: nothing is driven on it."""
    from rover_sweep.vehicle.link.link import Link

    with (
        tempfile.TemporaryDirectory() as folder,
        Link.open(url, Path(folder) / "unkept.tlog", access=access) as link,
    ):
        yield link
