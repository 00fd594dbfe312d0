"""Writes a .param file to a rover: sets the parameters that differ, reads them back, reboots if needed.

It can be interrupted anywhere and repeated: parameters already set no longer differ, and those that wait
for a reboot are noted in a folder before the reboot (`setup.pending_reboot`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from firmware_params.param_files import Difference
from rover_sweep.vehicle.events import Event, Notice, ParameterSet, Rebooting
from rover_sweep.vehicle.identity import VehicleIdentity, identify_vehicle
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters.read_write import ParameterKept, read_present
from rover_sweep.vehicle.setup import pending_reboot
from rover_sweep.vehicle.setup.applet_upload import reboot
from rover_sweep.vehicle.setup.install import Consent, refuse_armed
from rover_sweep.vehicle.sources import ParameterSource

# Parameters that take effect after a reboot only, in addition to those that a file marks with [reboot]
# (@RebootRequired in the sources of Rover-4.6.3).
NEED_REBOOT = frozenset(
    {
        *("SCR_ENABLE", "SCR_HEAP_SIZE", "SCHED_LOOP_RATE", "LOG_BACKEND_TYPE", "LOG_FILE_BUFSIZE"),
        *("AHRS_ORIENTATION", "EK3_ENABLE", "BATT_MONITOR", "INS_GYRO_RATE", "CAN_P1_DRIVER", "RC_PROTOCOLS"),
        *("GPS1_TYPE", "GPS_TYPE", "COMPASS_ENABLE", "FRAME_CLASS"),
    }
)


def needs_reboot(name: str, marked: bool = False) -> bool:
    """Whether a parameter is known to take effect after a reboot only. marked: by its file."""
    return marked or name in NEED_REBOOT or (name.startswith("SERIAL") and name.endswith("_PROTOCOL"))


def awaiting_reboot(link: Link, folder: Path) -> tuple[str, ...]:
    """Names of parameters that an earlier push or remedy noted in `folder` and that still need a reboot."""
    return pending_reboot.waiting(folder, *_boot(link))


def push(
    link: Link, source: ParameterSource, differences: Sequence[Difference], may_reboot: Consent, folder: Path
) -> Iterator[Event]:
    """Set the parameters that differ, and reboot if that is needed and allowed. LinkError while armed.

    Yields ParameterSet for each, Rebooting, and a Notice for each parameter that the rover does not have,
    does not keep as set (read-only, integer, out of range) or that still needs a reboot.
    """
    refuse_armed(link)
    vehicle, boots = _boot(link)
    noted = pending_reboot.waiting(folder, vehicle, boots)
    for difference in differences:
        if difference.found is None:
            yield Notice("warning", difference.sentence)
            continue
        restart = needs_reboot(difference.name, difference.needs_reboot)
        if restart:  # noted before it is set: an interruption in between must not hide the reboot
            pending_reboot.note(folder, vehicle, boots, [difference.name])
        try:
            written = source.write(difference.name, difference.wanted)
        except ParameterKept as kept:
            if restart and difference.name not in noted:
                pending_reboot.withdraw(folder, vehicle, boots, difference.name)
            yield Notice("warning", str(kept))
            continue
        yield ParameterSet(written.name, written.old, written.value, restart)
    because = pending_reboot.waiting(folder, vehicle, boots)
    if not because:
        return
    if not may_reboot(because):
        yield Notice("warning", f"{', '.join(because)} will take effect after a reboot")
        return
    yield Rebooting(because)
    reboot(link)
    pending_reboot.forget(folder)


def _boot(link: Link) -> tuple[VehicleIdentity, float]:
    return identify_vehicle(link), read_present(link, ["STAT_BOOTCNT"]).get("STAT_BOOTCNT", 0.0)
