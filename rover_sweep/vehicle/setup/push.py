"""A .param file onto a rover: what differs is set, read back, and given the reboot that it needs.

It can be interrupted anywhere and begun again: what was set does not differ any more, and what waits for
a reboot is noted in a folder before the reboot is asked for (`vehicle.pending`).
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

# Those that count after a restart only, beside what a file itself marks with [reboot]
# (@RebootRequired in the sources of Rover-4.6.3).
NEED_REBOOT = frozenset(
    {
        *("SCR_ENABLE", "SCR_HEAP_SIZE", "SCHED_LOOP_RATE", "LOG_BACKEND_TYPE", "LOG_FILE_BUFSIZE"),
        *("AHRS_ORIENTATION", "EK3_ENABLE", "BATT_MONITOR", "INS_GYRO_RATE", "CAN_P1_DRIVER", "RC_PROTOCOLS"),
        *("GPS1_TYPE", "GPS_TYPE", "COMPASS_ENABLE", "FRAME_CLASS"),
    }
)


def needs_reboot(name: str, marked: bool = False) -> bool:
    """Whether a parameter counts after a restart only, as far as is known. marked: by its file."""
    return marked or name in NEED_REBOOT or (name.startswith("SERIAL") and name.endswith("_PROTOCOL"))


def waiting(link: Link, folder: Path) -> tuple[str, ...]:
    """What an earlier push or remedy noted in `folder` and no reboot has followed yet."""
    return pending_reboot.waiting(folder, *_boot(link))


def push(
    link: Link, source: ParameterSource, differences: Sequence[Difference], may_reboot: Consent, folder: Path
) -> Iterator[Event]:
    """Set what differs and exists, and reboot where that is needed and allowed. LinkError while armed.

    Yields ParameterSet for each, Rebooting, and a Notice for what is not there, does not stay as it was set
    (read-only, of whole numbers, out of range) or does not count yet.
    """
    refuse_armed(link)
    vehicle, boots = _boot(link)
    noted = pending_reboot.waiting(folder, vehicle, boots)
    for difference in differences:
        if difference.found is None:
            yield Notice("warning", difference.sentence)
            continue
        restart = needs_reboot(difference.name, difference.needs_reboot)
        if restart:  # before it is set: an interruption in between must not hide the reboot
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
        yield Notice("warning", f"{', '.join(because)} will count after a reboot")
        return
    yield Rebooting(because)
    reboot(link)
    pending_reboot.forget(folder)


def _boot(link: Link) -> tuple[VehicleIdentity, float]:
    return identify_vehicle(link), read_present(link, ["STAT_BOOTCNT"]).get("STAT_BOOTCNT", 0.0)
