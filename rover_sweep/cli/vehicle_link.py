"""The vehicle at --connect: its options, and a link that is not kept, for commands that drive nothing."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import FILE, gathered, option
from rover_sweep.cli.views.asking import chosen_of
from rover_sweep.cli.views.output import echo, narration
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.connection import Access, Heard
    from rover_sweep.vehicle.link.link import Link


def _access(
    connect: str | None,
    system: int | None = option(
        "MAVLink system id of the vehicle, if several are heard.", click.IntRange(1, 255), "N"
    ),
    signing_key: str | None = option(
        "File with the MAVLink signing key: 32 bytes, 64 hex digits, or a passphrase "
        "(its SHA-256 is the key, as in Mission Planner).",
        FILE,
    ),
) -> Access:
    """Of a command with --connect. UsageError for these options without it."""
    from rover_sweep.vehicle.link.connection import Access
    from rover_sweep.vehicle.link.mavlink import read_key

    given = "--system" if system is not None else "--signing-key" if signing_key else ""
    if given and connect is None:
        raise UsageError(f"{given} needs --connect; give --connect too")
    choose = _ask_system if sys.stdin.isatty() else None
    return Access(system, choose, _warn, read_key(Path(signing_key)) if signing_key else None)


ACCESS = gathered(_access)


def _ask_system(heard: Sequence[Heard]) -> int:
    echo(f"{len(heard)} vehicles are heard:", err=True)
    for one in heard:
        echo(f"  {one}", err=True)
    return int(chosen_of("Which system?", [str(one.system) for one in heard]))


def _warn(sentence: str) -> None:
    narration().print(sentence, style="yellow", soft_wrap=True)


_URL = "tcp:HOST:PORT, udp:HOST:PORT (listen), or a serial port: COM5, /dev/ttyACM0, /dev/ttyUSB0,57600."
CONNECT, MAYBE_CONNECT = option(_URL, None, "URL", required=True), option(_URL, None, "URL")
VIA = option(
    "Library that talks to the rover; the result is the same.",
    click.Choice(["mavlink", "mavsdk"]),
    default="mavlink",
)
JSON_ALONE = option("Print JSON on stdout, and nothing else there.", flag="--json")


@dataclass(frozen=True)
class LinkOptions:
    """The rover at --connect, for commands that read or set it without driving."""

    connect: str = CONNECT
    access: Access = ACCESS

    @contextmanager
    def link(self) -> Iterator[Link]:
        """A link whose recording is deleted at the end."""
        from rover_sweep.vehicle.link.link import Link

        with (
            tempfile.TemporaryDirectory() as folder,
            Link.open(self.connect, Path(folder) / "unkept.tlog", access=self.access) as link,
        ):
            yield link


LINK = gathered(LinkOptions)
