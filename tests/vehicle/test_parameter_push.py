"""A parameter file onto a rover: interrupted anywhere and gone on with, what the rover keeps, reboots."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle

from firmware_params.param_files import Difference, compare, parse
from rover_sweep.errors import LinkError
from rover_sweep.vehicle import parameters as read_write
from rover_sweep.vehicle.events import Event, Notice, ParameterSet, Rebooting
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.logs import parameter_source
from rover_sweep.vehicle.preflight.read_rover import Check, Remedy
from rover_sweep.vehicle.preflight.readiness import remedy
from rover_sweep.vehicle.setup import NOTE, awaiting_reboot, install, needs_reboot, push

WANTED = parse("INS_GYRO_FILTER 20\nSCHED_LOOP_RATE 400 # [reboot]\nSWP_WMIN 0.1\nSCR_ENABLE 0\nNOT_THERE 1")


@pytest.fixture(autouse=True)
def booted(vehicle: FakeVehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read_write, "_TIMEOUT", 0.15)
    vehicle.parameters["STAT_BOOTCNT"] = 7.0


def differing(vehicle: FakeVehicle) -> Sequence[Difference]:
    return compare(vehicle.parameters, WANTED)


def pushed(link: Link, vehicle: FakeVehicle, folder: Path, reboot: bool = True) -> list[Event]:
    source = parameter_source(link, "mavlink")
    return list(push(link, source, differing(vehicle), lambda _: reboot, folder))


def names(events: Sequence[Event]) -> list[str]:
    return [event.name for event in events if isinstance(event, ParameterSet)]


def reboots(events: Sequence[Event]) -> list[tuple[str, ...]]:
    return [event.because for event in events if isinstance(event, Rebooting)]


def test_what_differs_is_set_read_back_and_booted(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    events = pushed(link, vehicle, tmp_path)
    assert names(events) == ["INS_GYRO_FILTER", "SCHED_LOOP_RATE", "SWP_WMIN", "SCR_ENABLE"]
    assert reboots(events) == [("SCHED_LOOP_RATE", "SCR_ENABLE")]  # one by its file, one as is known
    assert vehicle.parameters["STAT_BOOTCNT"] == 8 and not (tmp_path / NOTE).exists()
    told = [event.text for event in events if isinstance(event, Notice)]
    assert len(told) == 1 and told[0].startswith("NOT_THERE does not exist")
    assert [d.name for d in differing(vehicle)] == ["NOT_THERE"]  # 0.1 as float32 is no difference


@pytest.mark.parametrize("after", range(5))
def test_interrupted_anywhere_it_goes_on(link, vehicle, tmp_path, after):
    begun = push(link, parameter_source(link, "mavlink"), differing(vehicle), lambda _: True, tmp_path)
    for _ in range(after):
        next(begun)
    begun.close()  # type: ignore[attr-defined]
    was_set = {d.name for d in compare(vehicle.parameters, WANTED)} ^ {p.name for p in WANTED}
    assert len(was_set) == min(after, 4)
    due = awaiting_reboot(link, tmp_path)
    assert set(due) == was_set & {"SCHED_LOOP_RATE", "SCR_ENABLE"}
    events = pushed(link, vehicle, tmp_path)
    assert set(names(events)) == {p.name for p in WANTED} - was_set - {"NOT_THERE"}
    assert reboots(events) == [("SCHED_LOOP_RATE", "SCR_ENABLE")]
    assert awaiting_reboot(link, tmp_path) == ()


def test_the_reboot_is_asked_for_again_where_it_was_not_allowed(link, vehicle, tmp_path):
    events = pushed(link, vehicle, tmp_path, reboot=False)
    assert reboots(events) == [] and vehicle.parameters["STAT_BOOTCNT"] == 7
    assert Notice("warning", "SCHED_LOOP_RATE, SCR_ENABLE will take effect after a reboot") in events
    assert json.loads((tmp_path / NOTE).read_text())["names"] == ["SCHED_LOOP_RATE", "SCR_ENABLE"]
    again = pushed(link, vehicle, tmp_path)
    assert names(again) == [] and reboots(again) == [("SCHED_LOOP_RATE", "SCR_ENABLE")]


def test_one_who_booted_by_hand_is_not_asked(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    pushed(link, vehicle, tmp_path, reboot=False)
    vehicle.parameters["STAT_BOOTCNT"] += 1
    assert awaiting_reboot(link, tmp_path) == () and reboots(pushed(link, vehicle, tmp_path)) == []


def test_what_the_rover_keeps_is_told_and_the_others_are_set(link, vehicle, tmp_path):
    vehicle.fixed = frozenset({"SCHED_LOOP_RATE", "INS_GYRO_FILTER"})
    events = pushed(link, vehicle, tmp_path)
    told = [event.text for event in events if isinstance(event, Notice)]
    assert "INS_GYRO_FILTER was set to 20 but the vehicle has 4; it may be read-only" in told[0]
    assert names(events) == ["SWP_WMIN", "SCR_ENABLE"] and reboots(events) == [("SCR_ENABLE",)]
    vehicle.fixed = frozenset({"SCHED_LOOP_RATE"})
    assert reboots(pushed(link, vehicle, tmp_path)) == []  # nothing that needs one was set
    assert not (tmp_path / NOTE).exists()


def test_an_armed_rover_is_left_alone(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    vehicle.armed = True
    link.wait_for("HEARTBEAT", 5.0, lambda _: link.armed)
    with pytest.raises(LinkError, match="the rover is armed.*preflight --connect URL --fix armed.*resume"):
        pushed(link, vehicle, tmp_path)
    with pytest.raises(LinkError, match="the rover is armed.*preflight --connect URL --fix armed.*resume"):
        list(install(link, WANTED, None))
    check = Check("parameters", "bad", "", remedy=Remedy("set", sets=(("SWP_WMIN", 0.1),)))
    with pytest.raises(LinkError, match="the rover is armed.*preflight --connect URL --fix armed.*resume"):
        list(remedy(link, check, False, tmp_path))
    assert vehicle.of_kind("PARAM_SET") == []


def test_which_parameters_count_after_a_reboot_only() -> None:
    assert needs_reboot("SERIAL2_PROTOCOL") and needs_reboot("SCR_HEAP_SIZE") and needs_reboot("X", True)
    assert not needs_reboot("ATC_STR_RAT_FF") and not needs_reboot("SERIAL2_BAUD")
