"""`rover-sweep params`: a rover's parameters compared with a file, set from it, written into one."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.types.vehicle_link import connect_option, json_option, unkept_link, via_option
from rover_sweep.cli.views.asking import confirmed, reboot_consent
from rover_sweep.cli.views.output import echo, echo_json
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from firmware_params.param_files import Difference, WantedParameter
    from rover_sweep.vehicle.link.access import Access
    from rover_sweep.vehicle.link.link import Link
    from rover_sweep.vehicle.sources import Via

_via = via_option("Library that reads and writes; the same values come either way.")
_file = click.argument("file", metavar="[FILE]", default="identification")
_NOTES = Path()  # the note on a reboot that is due lies where the command is given


@click.group()
def params() -> None:
    """A rover's parameters against a .param file: of this program (identification, raw_imu) or your own.

    What a rover counts by itself (STAT_BOOTCNT and its like) is neither compared nor set.
    """


@params.command(short_help="What differs; changes nothing.")
@_file
@connect_option
@json_option
@_via
def diff(file: str, connect: str, access: Access, as_json: bool, via: Via) -> int:
    """Compare the rover with FILE. Changes nothing. Exit code 0 if nothing differs, 1 if something does."""
    from rover_sweep.vehicle.parameters.read_param_file import wanted_of

    wanted = wanted_of(file)
    with unkept_link(connect, access) as link:
        found = _differences(link, wanted, via)
    if as_json:
        echo_json(json.dumps({"file": file, "differences": [_told(d) for d in found]}, indent=2))
    else:
        _show(found, file)
    return 1 if found else 0


@params.command(short_help="Set what differs, after asking.")
@_file
@connect_option
@click.option("--yes", is_flag=True, help="Do not ask, not before a reboot either.")
@json_option
@_via
def push(file: str, connect: str, access: Access, yes: bool, as_json: bool, via: Via) -> int:
    """Set what differs from FILE; every value is read back and compared.

    Shows first what differs, and asks; asks again before a reboot. Interrupted, it goes on when it is
    called again: a reboot that is still due is noted in reboot-pending.json here. A parameter that the
    rover does not have, or that does not stay as it was set, is told, and the others are set. The rover
    must be disarmed. Exit code 0 if nothing differs afterwards and no reboot is due, 1 else.
    """
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.cli.views.output import narration
    from rover_sweep.vehicle.events import ParameterSet
    from rover_sweep.vehicle.parameters.read_param_file import wanted_of
    from rover_sweep.vehicle.setup.push import push as bring
    from rover_sweep.vehicle.setup.push import waiting
    from rover_sweep.vehicle.sources import parameter_source

    if not yes and not sys.stdin.isatty():
        raise UsageError("there is no terminal to ask at: give --yes to set them without questions")
    wanted, was_set = wanted_of(file), list[ParameterSet]()
    with unkept_link(connect, access) as link:
        found = _differences(link, wanted, via)
        _show(found, file, as_json)
        count = sum(d.found is not None for d in found)
        consent = yes or not count or confirmed(f"Set {count} parameters?")

        display, may_reboot = PlainDisplay(narration(), talk=True), reboot_consent(yes)
        for event in bring(link, parameter_source(link, via), found, may_reboot, _NOTES) if consent else ():
            display.show(event)
            was_set += [event] if isinstance(event, ParameterSet) else []
        left, due = _differences(link, wanted, via) if found else [], waiting(link, _NOTES)
    if as_json:
        told = {"file": file, "set": [asdict(e) for e in was_set], "differences": [_told(d) for d in left]}
        echo_json(json.dumps(told | {"reboot_due": list(due)}, indent=2))
    return 1 if left or due else 0


@params.command(short_help="Write all of the rover's parameters into a file.")
@click.argument("file", metavar="[FILE]", default="-")
@connect_option
@json_option
@_via
def pull(file: str, connect: str, access: Access, as_json: bool, via: Via) -> None:
    """Write all parameters of the rover into FILE (default: stdout), as any ground station reads them."""
    from rover_sweep.cli.types.text_file import refuse_no_folder, write_text
    from rover_sweep.vehicle.identity import identify_vehicle
    from rover_sweep.vehicle.parameters.read_write import await_booted
    from rover_sweep.vehicle.sources import parameter_source

    refuse_no_folder(file)
    if file != "-" and Path(file).is_file():
        raise UsageError(f"{file} is there already and is kept; give another name")
    with unkept_link(connect, access) as link:
        vehicle = identify_vehicle(link)
        await_booted(link, _wait)
        values = dict(sorted(parameter_source(link, via).read_all().items()))
    told = f"{len(values)} parameters of {vehicle.firmware}"
    if file != "-" or not as_json:
        write_text(file, "\n".join([f"# {told} ({vehicle.git_hash})", *_lines(values), ""]), told)
    if as_json:
        echo_json(json.dumps({"firmware": vehicle.firmware, "parameters": values}, indent=2))


def _lines(values: dict[str, float]) -> Iterator[str]:
    """NAME VALUE, with as many digits as bring the same float32 back."""
    for name, value in values.items():
        yield f"{name} {value:.0f}" if value.is_integer() and abs(value) < 1e9 else f"{name} {value:.9g}"


def _differences(link: Link, wanted: Sequence[WantedParameter], via: Via) -> list[Difference]:
    from firmware_params.param_files import compare
    from rover_sweep.vehicle.identity import identify_vehicle
    from rover_sweep.vehicle.parameters.read_write import await_booted, read_present
    from rover_sweep.vehicle.sources import parameter_source

    identify_vehicle(link)
    one_by_one = via == "mavlink" and len(wanted) < _FEW
    if not one_by_one:
        await_booted(link, _wait)
    has = {} if one_by_one else parameter_source(link, via).read_all()
    # A list leaves out what lies behind a switch that is off, such as SCR_HEAP_SIZE behind SCR_ENABLE.
    has |= read_present(link, [p.name for p in wanted if p.name not in has])
    return list(compare(has, wanted))


def _wait(seconds: float) -> None:
    echo(f"the rover has just booted: waiting up to {seconds:.0f} s for its whole list", err=True)


_FEW = 100  # parameters that are asked for one by one; all 1300 come in the time of 30


def _told(d: Difference) -> dict[str, object]:
    from rover_sweep.vehicle.setup.push import needs_reboot

    told = {"name": d.name, "wanted": d.wanted, "found": d.found, "reason": d.reason}
    return told | {"reboot": needs_reboot(d.name, d.needs_reboot)}


def _show(found: Sequence[Difference], file: str, as_json: bool = False) -> None:
    from rich.table import Table
    from rich.text import Text

    from rover_sweep.cli.views.output import results
    from rover_sweep.vehicle.setup.push import needs_reboot

    console = results(as_json)
    if not found:
        console.print(f"the rover has everything of {file}", style="green", markup=False)
        return
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for heading in ("parameter", "rover", "file", "reboot", "why"):
        table.add_column(heading, justify="right" if heading in ("rover", "file") else "left")
    for d in found:
        has = "-" if d.found is None else f"{d.found:.7g}"
        reboot = "yes" if needs_reboot(d.name, d.needs_reboot) else ""
        table.add_row(d.name, has, f"{d.wanted:.7g}", reboot, Text(d.reason))
    console.print(table)
    console.print(f"{len(found)} differ", style="yellow")
