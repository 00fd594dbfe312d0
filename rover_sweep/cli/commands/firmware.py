"""`rover-sweep firmware`: write, check or install the Lua applet and the parameters on the autopilot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import OUTPUT, argument, option, options, write_text
from rover_sweep.cli.vehicle_link import LINK, LinkOptions
from rover_sweep.cli.views.asking import confirmed, reboot_consent, refuse_unasked
from rover_sweep.cli.views.output import narration, print_table, results, say_next

if TYPE_CHECKING:
    from rover_sweep.vehicle.setup import Survey

NAMES = ("identification", "raw_imu")
_NAME = argument(type=click.Choice(NAMES), default=NAMES[0])


@click.group()
def firmware() -> None:
    """Set up the autopilot: the Lua applet that drives the sweep, and the parameters with their reasons."""


@firmware.command(short_help="Write the Lua applet.")
@options
def applet(output: str = OUTPUT) -> None:
    """Write the Lua applet; copy it to APM/scripts on the autopilot's SD card."""
    from firmware_params.applet_parameters import applet_source

    write_text(output, applet_source())
    say_next("copy it to APM/scripts on the card and reboot", "rover-sweep firmware check --connect URL")


@firmware.command(short_help="Write a .param file.")
@options
def params(name: str = _NAME, output: str = OUTPUT) -> None:
    """Write a parameter file for any ground station: identification, or raw_imu in addition to it."""
    from firmware_params.param_files import shipped

    write_text(output, shipped(name).read_text(encoding="utf-8"))
    say_next("load it in a ground station", "rover-sweep firmware check --connect URL")


@firmware.command(short_help="Check a rover's applet and parameters; changes nothing.")
@options
def check(name: str = _NAME, rover: LinkOptions = LINK) -> int:
    """Compare a rover's parameters and applet with the required ones. Changes nothing.

    Exit code 0 if everything matches, 1 if not.
    """
    from firmware_params.param_files import read, shipped
    from rover_sweep.vehicle.setup import survey

    with rover.link() as link:
        found = survey(link, read(shipped(name)))
    _show(found)
    say_next(f"rover-sweep {'preflight' if found.fits else 'firmware install'} --connect {rover.connect}")
    return 0 if found.fits else 1


@firmware.command(short_help="Install applet and parameters on a rover, after asking.")
@options
def install(
    name: str = _NAME, rover: LinkOptions = LINK, yes: bool = option("Do not ask, not even before a reboot.")
) -> int:
    """Install the applet (by MAVLink FTP) and the parameters on a rover.

    Shows the differences and asks first; asks again before a reboot. The rover must be disarmed. Exit code
    0 if everything matches afterwards, 1 if not.
    """
    from firmware_params.applet_parameters import applet_path
    from firmware_params.param_files import read, shipped
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.vehicle.setup import install as bring
    from rover_sweep.vehicle.setup import survey

    refuse_unasked(yes, "install")
    wanted = read(shipped(name))
    with rover.link() as link:
        found = survey(link, wanted)
        _show(found, whole=False)
        if found.fits:
            say_next(f"rover-sweep preflight --connect {rover.connect}")
            return 0
        if not yes and not confirmed(f"Install on {found.vehicle.firmware}?"):
            return 1

        display = PlainDisplay(narration(), talk=True)
        for event in bring(link, wanted, applet_path(), not found.applet.current, reboot_consent(yes)):
            display.show(event)
        found = survey(link, wanted)
    _show(found, whole=False)
    say_next(f"rover-sweep preflight --connect {rover.connect}")
    return 0 if found.fits else 1


def _show(found: Survey, whole: bool = True) -> None:
    """Print all parameters (or those that differ), the state of the applet and the verdict on stdout."""
    from rich.text import Text

    from rover_sweep.report.document import Cell

    console, rows = results(), []
    for p in (p for p in found.parameters if whole or not p.fits):
        has = "-" if p.found is None else f"{p.found:.7g}"
        wanted = f"{'>= ' if p.wanted.at_least else ''}{p.wanted.value:.7g}"
        verdict = Cell("fits") if p.fits else Cell("missing" if p.found is None else "differs", "warn")
        reboot = "yes" if p.wanted.needs_reboot else ""
        rows.append((p.wanted.name, wanted, has, verdict, reboot, p.wanted.reason))
    if rows:
        print_table(console, ("parameter", "wanted", "found", "", "reboot", "why"), rows, (0, 3, 4, 5))
    console.print(Text(found.applet.sentence, "" if found.applet.fits else "yellow"))
    wrong = sum(not p.fits for p in found.parameters)
    if found.fits:
        console.print(f"{found.vehicle.firmware} has everything needed", style="green")
    elif wrong:
        console.print(f"{wrong} of {len(found.parameters)} parameters do not match", style="yellow")
