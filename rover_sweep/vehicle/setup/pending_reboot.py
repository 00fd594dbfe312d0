"""Which parameters were set and wait for a reboot: a note in a folder, so that whoever comes back knows.

A parameter reads as set before it counts. ArduPilot's STAT_BOOTCNT, which each boot raises, tells
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
    """Names noted for this vehicle in this boot (boots: STAT_BOOTCNT); none where it booted since."""
    try:
        note = read_json((folder / NOTE).read_text(encoding="utf-8"))
        mine = note["vehicle"] == _key(vehicle) and note["boots"] == boots
        return tuple(map(str, note["names"])) if mine else ()
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def note(folder: Path, vehicle: VehicleIdentity, boots: float, names: Iterable[str]) -> None:
    """Add names to those that wait."""
    _keep(folder, vehicle, boots, dict.fromkeys((*waiting(folder, vehicle, boots), *names)))


def withdraw(folder: Path, vehicle: VehicleIdentity, boots: float, name: str) -> None:
    """Take a name away that was noted and then not set after all."""
    _keep(folder, vehicle, boots, [n for n in waiting(folder, vehicle, boots) if n != name])


def forget(folder: Path) -> None:
    """After the reboot."""
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
