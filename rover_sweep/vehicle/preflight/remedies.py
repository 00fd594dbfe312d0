"""The remedies of the checks, carried out on the vehicle."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import compare, read, shipped
from rover_sweep.errors import UsageError
from rover_sweep.vehicle.events import Event, Notice, ParameterSet, Rebooting
from rover_sweep.vehicle.identity import identify_vehicle
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.requests import Refused
from rover_sweep.vehicle.parameters.read_write import read_present, write_parameter
from rover_sweep.vehicle.preflight.item import Check
from rover_sweep.vehicle.run.controls import MANUAL
from rover_sweep.vehicle.setup import pending_reboot
from rover_sweep.vehicle.setup.applet_upload import await_applet, reboot, restart_scripts, upload
from rover_sweep.vehicle.setup.install import refuse_armed

Waits = Generator[Event, None, tuple[str, ...]]  # yields events, returns the names that wait for a reboot
_SCRIPTING = ("SCR_ENABLE", "SCR_HEAP_SIZE")
_NEED_REBOOT = frozenset({"SCR_ENABLE", "SCR_HEAP_SIZE", "SCHED_LOOP_RATE"})
_SCRIPTS_START = 20.0  # s after boot within which scripts start


def carry_out(link: Link, check: Check, may_reboot: bool, folder: Path) -> Iterator[Event]:
    """Carry out the remedy of `check`. See `all_checks.remedy`."""
    if check.remedy is None:
        raise UsageError(f"this program has no remedy for {check.name} ({check.seen})")
    if check.remedy.by_hand:
        raise UsageError(f"{check.name} can only be corrected by hand: {check.remedy.words}")
    if check.name == "armed":
        link.require("disarm", "MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
        link.wait_for("HEARTBEAT", 3.0, lambda _: not link.armed)
        yield Notice("info", "disarmed")
        return
    refuse_armed(link)
    vehicle = identify_vehicle(link)
    boots = read_present(link, ["STAT_BOOTCNT"]).get("STAT_BOOTCNT", 0.0)
    sets = check.remedy.sets
    deed = None if sets else _DEEDS.get(check.name)
    waits = (yield from _set(link, dict(sets))) if deed is None else (yield from deed(link))
    if waits:
        pending_reboot.note(folder, vehicle, boots, waits)
    because = pending_reboot.waiting(folder, vehicle, boots)
    if not because or not check.remedy.reboot:
        return
    if not may_reboot:
        yield Notice("warning", f"{', '.join(because)} will take effect after a reboot")
        return
    yield Rebooting(because)
    reboot(link)
    pending_reboot.forget(folder)
    if read_present(link, ["SCR_ENABLE"]).get("SCR_ENABLE") == 1:
        await_applet(link, _SCRIPTS_START)


def _set(link: Link, values: Mapping[str, float]) -> Waits:
    waits = []
    for name, value in values.items():
        written = write_parameter(link, name, value)
        if written.changed:
            yield ParameterSet(written.name, written.old, written.value, name in _NEED_REBOOT)
            waits += [name] if name in _NEED_REBOOT else []
    return tuple(waits)


def _applet(link: Link) -> Waits:
    """Copy the applet and start it; it waits for a reboot if scripting does."""
    wanted = [p for p in read(shipped("identification")) if p.name in _SCRIPTING]
    differences = compare(read_present(link, _SCRIPTING), wanted)
    waits = yield from _set(link, {d.name: d.wanted for d in differences if d.found is not None})
    place = upload(link, applet_path())
    yield Notice("info", f"the applet was copied to {place}")
    try:
        restart_scripts(link)
    except Refused:
        return waits or ("SCR_ENABLE",)
    if "SCR_ENABLE" in waits or not await_applet(link):
        return waits or (applet_path().name,)
    return waits


def _manual(link: Link) -> Waits:
    link.require("switch to MANUAL", "MAV_CMD_DO_SET_MODE", 1.0, float(MANUAL))
    link.wait_for("HEARTBEAT", 3.0, lambda _: link.mode == MANUAL)
    yield Notice("info", "the rover is in MANUAL")
    return ()


_DEEDS: Mapping[str, Callable[[Link], Waits]] = {"applet": _applet, "mode": _manual}
