"""Parameters over the link: read back, compared as float32, lost echoes, wrong ones."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle import parameters as read_write
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import (
    await_booted,
    float32,
    read_all,
    read_parameter,
    read_present,
    write_parameter,
)


@pytest.fixture(autouse=True)
def short_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read_write, "_TIMEOUT", 0.15)
    monkeypatch.setattr(read_write, "LONGEST", 1.0)


def _lose(count: int) -> object:
    """Loses every parameter's first `count` answers."""
    seen: dict[str, int] = {}

    def drop(message: m.MAVLink_message) -> bool:
        if message.get_type() != "PARAM_VALUE":
            return False
        seen[message.param_id] = seen.get(message.param_id, 0) + 1
        return seen[message.param_id] <= count

    return drop


def test_a_number_that_float32_cannot_hold_is_written_and_found_right(link, vehicle):
    written = write_parameter(link, "SWP_WMIN", 0.1)
    assert (written.old, written.value) == (pytest.approx(0.3), float32(0.1))
    assert written.value != 0.1
    assert vehicle.parameters["SWP_WMIN"] == float32(0.1)
    assert not write_parameter(link, "SWP_WMIN", 0.1).changed


def test_lost_answers_are_asked_for_again(link: Link, vehicle: FakeVehicle) -> None:
    vehicle.drop = _lose(2)  # type: ignore[assignment]
    assert write_parameter(link, "SWP_AMP", 200).value == 200
    vehicle.drop = _lose(1)  # type: ignore[assignment]
    everything = read_all(link)
    assert everything.keys() == vehicle.parameters.keys()
    assert read_present(link, ["SWP_AMP", "NOT_THERE"]) == {"SWP_AMP": 200}


def test_a_vehicle_that_has_just_booted_is_waited_for(link: Link, vehicle: FakeVehicle) -> None:
    vehicle.now = 1.0
    told: list[float] = []
    await_booted(link, told.append)
    assert vehicle.now >= 20 and len(told) == 1 and 0 < told[0] <= 20
    await_booted(link, told.append)
    assert len(told) == 1


def test_a_list_that_changes_while_it_comes_is_asked_for_anew(link: Link, vehicle: FakeVehicle) -> None:
    """As seen on 4.6.3 just after a boot: a parameter appears in the middle and moves the others."""
    sent: list[str] = []

    def appears(message: m.MAVLink_message) -> bool:
        sent.append(message.get_type())
        if sent.count("PARAM_VALUE") == 20 and "APPEARS" not in vehicle.parameters:
            vehicle.parameters = {"APPEARS": 1.0, **vehicle.parameters}
        return False

    vehicle.drop = appears  # type: ignore[assignment]
    found = read_all(link)
    assert found == {name: pytest.approx(value) for name, value in vehicle.parameters.items()}
    assert "APPEARS" in found


def test_what_is_not_there_and_what_stays_other_are_told(link: Link, vehicle: FakeVehicle) -> None:
    with pytest.raises(LinkError, match="no parameter SWP_NONE"):
        read_parameter(link, "SWP_NONE")
    with pytest.raises(UsageError, match="at most 16 characters"):
        read_parameter(link, "A_NAME_THAT_IS_TOO_LONG")
    vehicle.fixed = frozenset({"SWP_AMP"})
    with pytest.raises(LinkError, match="SWP_AMP was set to 99 but the vehicle has 150"):
        write_parameter(link, "SWP_AMP", 99)


class FrankVehicle(FakeVehicle):
    """Says what it lacks, as ArduPilot after 4.6 does (GCS_Param.cpp)."""

    refusal = 5  # MAV_PARAM_ERROR_READ_ONLY, to a change of a parameter that stays as it is

    def _on_param_request_read(self, message: m.MAVLink_message) -> None:
        if message.param_id in self.parameters:
            self._send_parameter(message.param_id)
        else:
            self._send_error(message, m.MAV_PARAM_ERROR_DOES_NOT_EXIST)

    def _on_param_set(self, message: m.MAVLink_message) -> None:
        if message.param_id in self.fixed:
            self._send_error(message, self.refusal)
        else:
            super()._on_param_set(message)

    def _send_error(self, message: m.MAVLink_message, error: int) -> None:
        to = message.get_srcSystem(), message.get_srcComponent()
        self._send(m.MAVLink_param_error_message(*to, message.param_id.encode(), -1, error))


def test_a_vehicle_that_says_what_it_lacks_is_believed_at_once(tmp_path: Path) -> None:
    with FrankVehicle() as vehicle, Link.open(vehicle.url, tmp_path / "a.tlog") as link:
        with pytest.raises(
            read_write.ParameterMissing, match="the vehicle reports that it has no parameter NOT_THERE"
        ):
            read_parameter(link, "NOT_THERE")
        assert read_present(link, ["SWP_AMP", "NOT_THERE", "NOR_THIS"]) == {"SWP_AMP": 150}
        asked = [request.param_id for request in vehicle.of_kind("PARAM_REQUEST_READ")]
        assert asked.count("NOT_THERE") == 2 and asked.count("NOR_THIS") == 1


@pytest.mark.parametrize(("refusal", "why"), [(5, "it is read-only"), (2, "the value is out of its range")])
def test_why_a_parameter_stays_is_told(tmp_path: Path, refusal: int, why: str) -> None:
    with (
        FrankVehicle(fixed=frozenset({"SWP_AMP"})) as vehicle,
        Link.open(vehicle.url, tmp_path / "a.tlog") as link,
    ):
        vehicle.refusal = refusal
        with pytest.raises(
            read_write.ParameterKept, match=f"SWP_AMP was set to 99 but the vehicle has 150; {why}$"
        ):
            write_parameter(link, "SWP_AMP", 99)
        assert len(vehicle.of_kind("PARAM_SET")) == 1
