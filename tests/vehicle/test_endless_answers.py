"""A vehicle whose answers never end: lists, listings and names end here."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from rover_sweep.errors import LinkError
from rover_sweep.live.source import Telemetry
from rover_sweep.vehicle.link.link import remote_sizes
from rover_sweep.vehicle.link.mavlink import make
from rover_sweep.vehicle.logs import MavlinkLogs
from rover_sweep.vehicle.parameters import read_all

LIMIT = 200_000  # messages that nobody needs


class GoodLink:
    """As `Link.quality` of a link that loses nothing."""

    words = ""

    def tries(self, count: int) -> int:
        return count

    def wait(self, seconds: float) -> float:
        return seconds


@dataclass
class Endless:
    """A link on its own clock whose vehicle answers every wait within 5 ms."""

    answer: Callable[[int], Any]
    armed: bool = False
    quality: GoodLink = field(default_factory=GoodLink)
    now: float = 0.0
    count: int = 0
    asked: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    @property
    def line(self) -> Endless:
        return self

    def monotonic(self) -> float:
        return self.now

    def to_vehicle(self, name: str, **fields: Any) -> None:
        self.asked.append((name, fields))

    def wait_for(self, kinds: object, timeout: float, where: Any = None) -> Any:
        self.now += 0.005
        self.count += 1
        assert self.count < LIMIT, "this never ends"
        return self.answer(self.count)


def listing(link_of: list[Endless]) -> Callable[[int], Any]:
    def answer(count: int) -> Any:
        request = bytes(link_of[0].asked[-1][1]["payload"])
        sequence, _, opcode = struct.unpack_from("<HBB", request)
        data = b"".join(f"F{count}-{k}.BIN\t{'²' if k else 7}\0".encode() for k in range(10))
        head = struct.pack("<HBBBBBxI", sequence + 1, 0, 128, len(data), opcode, 0, 0)
        payload = list((head + data).ljust(251, b"\0"))
        return make(
            "FILE_TRANSFER_PROTOCOL", target_network=0, target_system=0, target_component=0, payload=payload
        )

    return answer


def test_a_directory_listing_ends() -> None:
    links: list[Endless] = []
    links.append(Endless(listing(links)))
    found = remote_sizes(links[0], "/APM/LOGS")  # type: ignore[arg-type]
    assert 400 < len(found) <= 5000 and set(found.values()) == {7}


def parameter(index: int, count: int) -> Any:
    return make(
        "PARAM_VALUE", param_id=b"A", param_value=1.0, param_type=9, param_count=count, param_index=index
    )


@pytest.mark.parametrize(
    "answer",
    [lambda n: parameter(65535, 900), lambda n: parameter(3, 900), lambda n: parameter(n % 7, 900 + n % 2)],
    ids=["set by others", "one again and again", "another length each time"],
)
def test_a_list_of_parameters_ends(answer: Callable[[int], Any]) -> None:
    with pytest.raises(LinkError, match="parameters arrived|changed during its transfer"):
        read_all(Endless(answer))  # type: ignore[arg-type]


def test_a_list_of_logs_ends() -> None:
    entry = make("LOG_ENTRY", id=3, num_logs=9, last_log_num=9, time_utc=0, size=100)
    logs = MavlinkLogs(Endless(lambda n: entry)).logs()  # type: ignore[arg-type]
    assert [log.number for log in logs] == [3]


def test_what_a_screen_knows_of_a_vehicle_stays_bounded() -> None:
    shown = Telemetry()
    for k in range(30_000):  # a clock that stands still, and never the same name
        name = f"P{k}".encode()
        shown.message(
            make("PARAM_VALUE", param_id=name, param_value=1.0, param_type=9, param_count=1, param_index=0),
            1.0,
        )
    assert len(shown.parameters) == 5000 and shown.snapshot().received == 20_000
