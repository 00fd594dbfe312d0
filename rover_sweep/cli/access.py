"""Which vehicle behind --connect is meant, as the command line says it, or asked at the terminal."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.asking import chosen_of
from rover_sweep.cli.output import echo, narration
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.vehicle.access import Access, Heard

_SYSTEM = click.option("--system", type=click.IntRange(1, 255), metavar="N",
                       help="MAVLink system id of the vehicle, where several are heard.")  # fmt: skip


def access_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--system, of every command with --connect; the command gets an `access` of them."""

    @functools.wraps(command)
    def with_access(*args: Any, system: int | None, **rest: Any) -> Any:
        if system is not None and None in (rest.get("connect", ""), rest.get("url", "")):
            raise UsageError("--system says which vehicle behind --connect is meant; give --connect too")
        return command(*args, access=_access(system), **rest)

    return _SYSTEM(with_access)


def _access(system: int | None) -> Access:
    from rover_sweep.vehicle.access import Access

    return Access(system, _asked if sys.stdin.isatty() else None, _tell)


def _asked(heard: Sequence[Heard]) -> int:
    echo(f"{len(heard)} vehicles are heard:", err=True)
    for one in heard:
        echo(f"  {one}", err=True)
    return int(chosen_of("Which system?", [str(one.system) for one in heard]))


def _tell(sentence: str) -> None:
    narration().print(sentence, style="yellow", markup=False, soft_wrap=True)
