"""Two rovers on one link: one is chosen, and the other counts for nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

import pytest
from air import EVER, Air

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.live.source import Connect, Ended, Several, Update
from rover_sweep.live.vehicle_source import VehicleSource
from rover_sweep.logs.readers.tlog import open_tlog
from rover_sweep.vehicle.link.connection import HEARING, Access, Heard
from rover_sweep.vehicle.link.link import Link

Kind = TypeVar("Kind")
BOTH = {1: (0.1, EVER), 7: (0.9, EVER)}


def opened(air: Air, tmp_path: Path, access: Access | None = None, timeout: float = 15.0) -> Link:
    return Link.open("air:", tmp_path / "a.tlog", timeout, line=air, access=access)


def systems_told(link: Link, seconds: float) -> set[float]:
    """Whose messages the link gives out and tells its listeners within so long."""
    got: set[float] = set()
    link.hear(lambda message: got.add(message.get_srcSystem()))
    until = link.line.monotonic() + seconds
    while link.line.monotonic() < until:
        message = link.receive(0.1)
        if message is not None:
            got.add(message.get_srcSystem())
    return got


def test_one_rover_is_taken_after_a_second_had_its_time(tmp_path: Path) -> None:
    air = Air({3: (0.1, EVER)})
    with opened(air, tmp_path) as link:
        assert link.target == (3, 1) and link.heartbeat is not None and air.settled == 3
        assert 0.1 + HEARING <= air.now <= 0.1 + HEARING + 0.2


def test_a_system_that_is_given_is_not_waited_with(tmp_path: Path) -> None:
    air = Air({3: (0.1, EVER)})
    with opened(air, tmp_path, Access(system=3)):
        assert air.now < 0.3


def test_hearing_takes_the_clock_of_a_rover_that_is_simulated_faster(tmp_path: Path) -> None:
    air = Air({3: (0.1, EVER)}, speed=20.0)
    with opened(air, tmp_path):
        assert air.now < 0.1 + 2 * HEARING / 20 + 0.05


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0])
def test_two_rovers_are_named_and_none_is_taken(tmp_path: Path, late: float) -> None:
    air = Air({1: (0.1, EVER), 7: (0.1 + late, EVER)})
    words = r"^2 vehicles are heard on air:: system 1 \(ground rover\), system 7 \(.*\); .*--system N$"
    with pytest.raises(UsageError, match=words):
        opened(air, tmp_path)


def test_somebody_at_a_terminal_is_asked(tmp_path: Path) -> None:
    asked: list[Heard] = []

    def choose(heard: Sequence[Heard]) -> int:
        asked.extend(heard)
        return 7

    with opened(Air(BOTH), tmp_path, Access(choose=choose)) as link:
        assert link.target == (7, 1)
        assert [str(h) for h in asked] == ["system 1 (ground rover)", "system 7 (ground rover)"]
        assert systems_told(link, 3.0) == {7}


@pytest.mark.parametrize("system", [1, 7])
def test_only_the_chosen_one_counts(tmp_path: Path, system: int) -> None:
    told: list[str] = []
    with opened(Air(BOTH), tmp_path, Access(system, tell=told.append)) as link:
        link.wait_for("HEARTBEAT", 3.0)
        link.record_to(tmp_path / "b.tlog")
        assert systems_told(link, 5.0) == {system}
        assert abs(link.clock.now + BOTH[system][0] - link.line.monotonic()) < 0.5
    attitude = open_tlog(tmp_path / "b.tlog", frozenset({"ATTITUDE"})).messages["ATTITUDE"]
    assert set(attitude.system.tolist()) == {system} and len(attitude) > 20
    assert told == []


def test_a_system_that_is_not_there_is_told_with_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"system 9 was not heard on air: within 2 s, but system 1 .*, .* 7"):
        opened(Air(BOTH), tmp_path, Access(system=9), timeout=2.0)


def test_a_second_rover_that_comes_later_is_told_once_and_not_recorded(tmp_path: Path) -> None:
    told: list[str] = []
    with opened(Air({1: (0.1, EVER), 7: (4.0, EVER)}), tmp_path, Access(tell=told.append)) as link:
        assert systems_told(link, 10.0) == {1}
    assert len(told) == 1
    assert "system 7 (ground rover)" in told[0] and "goes on with system 1" in told[0]
    attitude = open_tlog(tmp_path / "a.tlog", frozenset({"ATTITUDE"})).messages["ATTITUDE"]
    assert attitude.system.tolist().count(7) <= 1


def test_the_chosen_ones_silence_is_told_while_the_other_speaks(tmp_path: Path) -> None:
    air = Air({1: (0.1, 4.0), 7: (0.1, EVER)})
    with (
        opened(air, tmp_path, Access(system=1)) as link,
        pytest.raises(LinkError, match="the vehicle on air: has been silent for 5 s"),
    ):
        while air.now < 30.0:
            link.receive(0.5)
    assert 8.5 < air.now < 9.5


def test_a_screen_is_given_the_list_and_connects_to_one(tmp_path: Path) -> None:
    told: SimpleQueue[Update] = SimpleQueue()
    source = VehicleSource(tmp_path / "session", line=Air(BOTH))
    source.start(told.put)
    try:
        source.ask(Connect("air:"))
        several, ended = until(told, Several), until(told, Ended)
        assert [one.system for one in several.heard] == [1, 7] and "choose one by" in ended.failure
        source.ask(Connect("air:", 7))
        assert "does not report its version" in until(told, Ended).failure  # rovers of the air tell little
        assert source._system == 7
    finally:
        source.close()


def until(told: SimpleQueue[Update], kind: type[Kind]) -> Kind:
    """The next of that kind."""
    while not isinstance(one := told.get(timeout=10.0), kind):
        pass
    return one
