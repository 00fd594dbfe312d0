"""`rover-sweep firmware`: what the autopilot needs - applet and parameters - shown, checked, installed."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.types.vehicle_link import connect_option, unkept_link
from rover_sweep.cli.views.asking import confirmed, reboot_consent
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from firmware_params.param_files import WantedParameter
    from rover_sweep.vehicle.link.access import Access
    from rover_sweep.vehicle.setup.survey import Survey, SurveyedParameter

NAMES = ("identification", "raw_imu")
_output = click.option(
    "-o", "--output", default="-", metavar="FILE", help="Where to write; stdout if not said."
)
_name = click.argument("name", type=click.Choice(NAMES), default=NAMES[0])


@click.group()
def firmware() -> None:
    """What the autopilot needs: the Lua applet that drives the sweep, and parameters with a reason each."""


@firmware.command(short_help="Write the Lua applet.")
@_output
def applet(output: str) -> None:
    """Write the Lua applet; it belongs into APM/scripts on the autopilot's card."""
    from firmware_params.applet_parameters import applet_source
    from rover_sweep.cli.types.text_file import write_text

    write_text(output, applet_source())


@firmware.command(short_help="Write a .param file.")
@_name
@_output
def params(name: str, output: str) -> None:
    """Write a parameter file for any ground station: identification, or raw_imu on top of it."""
    from firmware_params.param_files import shipped
    from rover_sweep.cli.types.text_file import write_text

    write_text(output, shipped(name).read_text(encoding="utf-8"))


@firmware.command(short_help="Compare a rover with what is needed; changes nothing.")
@_name
@connect_option
def check(name: str, connect: str, access: Access) -> int:
    """Compare a rover's parameters and its applet with what is needed. Changes nothing.

    Exit code 0 if everything fits, 1 if something does not.
    """
    from rover_sweep.vehicle.setup.survey import survey

    with unkept_link(connect, access) as link:
        found = survey(link, _wanted(name))
    _show(found)
    return 0 if found.fits else 1


@firmware.command(short_help="Bring applet and parameters onto a rover, after asking.")
@_name
@connect_option
@click.option("--yes", is_flag=True, help="Do not ask, not before a reboot either.")
def install(name: str, connect: str, access: Access, yes: bool) -> int:
    """Bring the applet (by MAVLink FTP) and the parameters onto a rover.

    Shows first what differs, and asks; asks again before a reboot. The rover must be disarmed. Exit code
    0 if everything fits afterwards, 1 if something does not.
    """
    from firmware_params.applet_parameters import applet_path
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.cli.views.output import narration
    from rover_sweep.vehicle.setup.install import install as bring
    from rover_sweep.vehicle.setup.survey import survey

    if not yes and not sys.stdin.isatty():
        raise UsageError("there is no terminal to ask at: give --yes to install without questions")
    wanted = _wanted(name)
    with unkept_link(connect, access) as link:
        found = survey(link, wanted)
        _show(found, whole=False)
        if found.fits:
            return 0
        if not yes and not confirmed(f"Make {found.vehicle.firmware} fit?"):
            return 1

        display = PlainDisplay(narration(), talk=True)
        for event in bring(link, wanted, applet_path(), not found.applet.current, reboot_consent(yes)):
            display.show(event)
        found = survey(link, wanted)
    _show(found, whole=False)
    return 0 if found.fits else 1


def _wanted(name: str) -> tuple[WantedParameter, ...]:
    from firmware_params.param_files import read, shipped

    return read(shipped(name))


def _show(found: Survey, whole: bool = True) -> None:
    """The table, whole or of what does not fit, and a verdict on stdout."""
    from rich.text import Text

    from rover_sweep.cli.views.output import results

    console = results()
    if rows := [p for p in found.parameters if whole or not p.fits]:
        console.print(_table(rows))
    console.print(Text(found.applet.sentence, "" if found.applet.fits else "yellow"))
    wrong = sum(not p.fits for p in found.parameters)
    if found.fits:
        console.print(f"{found.vehicle.firmware} has everything", style="green")
    elif wrong:
        console.print(f"{wrong} of {len(found.parameters)} parameters do not fit", style="yellow")


def _table(rows: Sequence[SurveyedParameter]) -> RenderableType:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for heading in ("parameter", "wanted", "found", "", "reboot", "why"):
        right = heading in ("wanted", "found")
        table.add_column(heading, justify="right" if right else "left", no_wrap=heading != "why")
    for p in rows:
        has = "-" if p.found is None else f"{p.found:.7g}"
        bound = ">= " if p.wanted.at_least else ""
        verdict = Text("fits") if p.fits else Text("differs" if p.found is not None else "missing", "yellow")
        reboot = "yes" if p.wanted.needs_reboot else ""
        table.add_row(
            p.wanted.name, f"{bound}{p.wanted.value:.7g}", has, verdict, reboot, Text(p.wanted.reason)
        )
    return table
