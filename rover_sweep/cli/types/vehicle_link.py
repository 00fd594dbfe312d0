"""Options and link of the commands that only read or set a vehicle, without driving it."""

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
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print JSON on stdout, and nothing else there."
)


def connect_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """--connect (required), with --system and --signing-key."""
    return _connect(access_options(command))


def via_option(meaning: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """--via, the library that talks to the vehicle; meaning: the help text."""
    return click.option(
        "--via", type=click.Choice(["mavlink", "mavsdk"]), default="mavlink", show_default=True, help=meaning
    )


@contextmanager
def unkept_link(url: str, access: Access) -> Iterator[Link]:
    """A link whose recording is deleted at the end; not for driving."""
    from rover_sweep.vehicle.link.link import Link

    with (
        tempfile.TemporaryDirectory() as folder,
        Link.open(url, Path(folder) / "unkept.tlog", access=access) as link,
    ):
        yield link
