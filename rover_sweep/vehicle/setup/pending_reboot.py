"""Which parameters were set and wait for a reboot: a note in a folder, for the next run of this program.

A parameter reads as set before it takes effect. ArduPilot increments STAT_BOOTCNT at each boot, which shows
whether the reboot has happened since.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from rover_sweep.files.documents import read_json
from rover_sweep.vehicle.identity import VehicleIdentity
from rover_sweep.vehicle.link.recorder import writing

NOTE = "reboot-pending.json"


def waiting(folder: Path, vehicle: VehicleIdentity, boots: float) -> tuple[str, ...]:
    """Names noted for this vehicle in this boot (boots: STAT_BOOTCNT); () if it has rebooted since."""
    try:
        note = read_json((folder / NOTE).read_text(encoding="utf-8"))
        mine = note["vehicle"] == _key(vehicle) and note["boots"] == boots
        return tuple(map(str, note["names"])) if mine else ()
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def note(folder: Path, vehicle: VehicleIdentity, boots: float, names: Iterable[str]) -> None:
    """Add names of parameters that wait for a reboot."""
    _keep(folder, vehicle, boots, dict.fromkeys((*waiting(folder, vehicle, boots), *names)))


def withdraw(folder: Path, vehicle: VehicleIdentity, boots: float, name: str) -> None:
    """Remove a name that was noted but then not set."""
    _keep(folder, vehicle, boots, [n for n in waiting(folder, vehicle, boots) if n != name])


def forget(folder: Path) -> None:
    """Delete the note, after the reboot."""
    (folder / NOTE).unlink(missing_ok=True)


def _keep(folder: Path, vehicle: VehicleIdentity, boots: float, names: Iterable[str]) -> None:
    if not (names := list(names)):
        forget(folder)
        return
    path = folder / NOTE
    partial = path.with_name(NOTE + ".part")
    content = {"vehicle": _key(vehicle), "boots": boots, "names": names}
    with writing(path):
        folder.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        partial.replace(path)


def _key(vehicle: VehicleIdentity) -> str:
    return f"{vehicle.uid} {vehicle.system} {vehicle.firmware} {vehicle.git_hash}"
