"""A link over UDP on whose port a stranger speaks too."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from greeted import heartbeat

from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.link import Link


@contextmanager
def speaking(to: int, data: bytes) -> Iterator[socket.socket]:
    """A UDP socket that sends `data` twenty times a second to the port."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as speaker:
        speaker.bind(("127.0.0.1", 0))
        speaker.setblocking(False)
        end = threading.Event()

        def speak() -> None:
            while not end.wait(0.05):
                speaker.sendto(data, ("127.0.0.1", to))

        thread = threading.Thread(target=speak)
        thread.start()
        try:
            yield speaker
        finally:
            end.set()
            thread.join()


def heard(speaker: socket.socket) -> int:
    """How many datagrams came to a speaker."""
    count = 0
    while True:
        try:
            speaker.recv(1000)
        except BlockingIOError:
            return count
        count += 1


def test_a_stranger_is_told_once_and_never_answered(tmp_path: Path) -> None:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    told: list[str] = []
    with (
        speaking(port, heartbeat(1)) as rover,
        speaking(port, b"<13>syslog: hello") as stranger,
        Link.open(f"udp:127.0.0.1:{port}", tmp_path / "a.tlog", access=Access(tell=told.append)) as link,
    ):
        count = sum(link.receive(0.1) is not None for _ in range(30))
        assert count > 5 and heard(rover) > 0 and heard(stranger) == 0
        where = stranger.getsockname()[1]
    assert [words for words in told if f"127.0.0.1:{where} are ignored" in words] == told
    assert len(told) == 1
