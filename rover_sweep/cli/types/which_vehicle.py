"""Options that choose the vehicle at --connect; if several are heard, the user is asked."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.views.asking import chosen_of
from rover_sweep.cli.views.output import echo, narration
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.access import Access, Heard

_SYSTEM = click.option(
    "--system",
    type=click.IntRange(1, 255),
    metavar="N",
    help="MAVLink system id of the vehicle, if several are heard.",
)

_KEY = click.option(
    "--signing-key",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="File with the MAVLink signing key: 32 bytes, 64 hex digits, or a passphrase "
    "(its SHA-256 is the key, as in Mission Planner).",
)


def access_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--system and --signing-key of a command with --connect; the command gets them as `access`."""

    @functools.wraps(command)
    def with_access(*args: Any, system: int | None, signing_key: str | None, **rest: Any) -> Any:
        given = "--system" if system is not None else "--signing-key" if signing_key else ""
        if given and None in (rest.get("connect", ""), rest.get("url", "")):
            raise UsageError(f"{given} needs --connect; give --connect too")
        return command(*args, access=_access(system, signing_key), **rest)

    return _SYSTEM(_KEY(with_access))


def _access(system: int | None, key: str | None) -> Access:
    from rover_sweep.vehicle.link.access import Access
    from rover_sweep.vehicle.link.signing import read_key

    choose = _ask_system if sys.stdin.isatty() else None
    return Access(system, choose, _warn, read_key(Path(key)) if key else None)


def _ask_system(heard: Sequence[Heard]) -> int:
    echo(f"{len(heard)} vehicles are heard:", err=True)
    for one in heard:
        echo(f"  {one}", err=True)
    return int(chosen_of("Which system?", [str(one.system) for one in heard]))


def _warn(sentence: str) -> None:
    narration().print(sentence, style="yellow", markup=False, soft_wrap=True)
