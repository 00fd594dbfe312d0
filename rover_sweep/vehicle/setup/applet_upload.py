"""Copies the Lua applet to the vehicle by MAVLink FTP and starts it."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import ftp_get, ftp_put
from rover_sweep.vehicle.link.remote_files import crc32, remote_crc32
from rover_sweep.vehicle.parameters.read_write import read_present

HARDWARE, SITL = "/APM/scripts", "scripts"  # folder of scripts on a flight controller, in SITL
VERSION = re.compile(r'^local VERSION = "(.*)"$', re.MULTILINE)  # in the applet's text
_RESTART = 3.0  # SCRIPTING_CMD_STOP_AND_RESTART


@dataclass(frozen=True)
class AppletFile:
    """The applet's file on the vehicle. version: stated in its text, '' if none."""

    path: str
    version: str
    text: str


def version_of(text: str) -> str:
    """The version stated in an applet's text, '' if none."""
    found = VERSION.search(text)
    return found[1] if found else ""


def read_applet(link: Link, name: str, ours: str = "") -> AppletFile | None:
    """Read the file `name` from the vehicle's script folder; None if it is missing, or without MAVLink FTP.

    ours: the text expected; if the checksum of the vehicle's file matches it, the file is not read.
    """
    for place in (HARDWARE, SITL) if ours else ():
        if remote_crc32(link, f"{place}/{name}") == crc32(ours.encode()):
            return AppletFile(f"{place}/{name}", version_of(ours), ours)
    with tempfile.TemporaryDirectory() as folder:
        local = Path(folder) / name
        for place in (HARDWARE, SITL):
            if not ftp_get(link, f"{place}/{name}", str(local)):
                text = local.read_text(encoding="utf-8", errors="replace")
                return AppletFile(f"{place}/{name}", version_of(text), text)
    return None


def upload(link: Link, applet: Path, progress: Callable[[float], None] | None = None) -> str:
    """Copy the applet to the vehicle's script folder and return its path there. LinkError if that fails."""
    if link.armed:
        raise LinkError("the applet is not replaced while the rover is armed; disarm first")
    errors = []
    for folder in (HARDWARE, SITL):
        error = ftp_put(link, str(applet), f"{folder}/{applet.name}", progress)
        if not error:
            return f"{folder}/{applet.name}"
        errors.append(f"{folder}: {error}")
    raise LinkError(
        f"{applet.name} could not be copied to the vehicle ({'; '.join(errors)}); is there a card in it? "
        "You can also copy it to APM/scripts on the card by hand"
    )


def restart_scripts(link: Link) -> None:
    """Stop and start all scripts (MAV_CMD_SCRIPTING); Refused if scripting is off (SCR_ENABLE 0)."""
    link.require("restart its scripts", "MAV_CMD_SCRIPTING", _RESTART)


def reboot(link: Link) -> None:
    """Reboot the vehicle and wait until it is back. LinkError while armed or when it does not return."""
    if link.armed:
        raise LinkError("the rover is not rebooted while it is armed; disarm first")
    link.request_message("SYSTEM_TIME")  # its clock shows the reboot
    while link.clock.now < 3.0 and link.receive(1.0) is not None:
        link.request_message("SYSTEM_TIME")
    link.require("reboot", "MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN", 1.0)
    link.reconnect()


def await_applet(link: Link, seconds: float = 15.0) -> bool:
    """Whether the applet's parameters appear within `seconds` s of the vehicle's clock: scripts start some
    time after boot."""
    start = link.clock.now
    while "SWP_ENABLE" not in read_present(link, ["SWP_ENABLE"]):
        link.forget(("PARAM_VALUE", "SWP_ENABLE"))  # it does not exist yet
        link.request_message("SYSTEM_TIME")  # its clock, as no streams may be on
        if link.clock.now - start > seconds:
            return False
    return True
