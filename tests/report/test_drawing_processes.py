"""Pictures drawn by processes are those of one process, in their order."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from rover_sweep.report.pictures import picture as drawing_processes
from rover_sweep.report.pictures.picture import pngs


class Fake:
    def __init__(self, number: int, ends: bool = False) -> None:
        self.number, self.ends, self.parent = number, ends, os.getpid()

    def png(self) -> bytes:
        if self.ends and os.getpid() != self.parent:
            os.kill(os.getpid(), signal.SIGKILL)
        return f"{self.number} {os.getpid() == self.parent}".encode()


def test_the_order_is_kept() -> None:
    found = [data.split() for data in pngs([Fake(k) for k in range(7)])]
    assert [int(number) for number, _ in found] == list(range(7))
    assert all(here == b"False" for _, here in found)


def test_a_thread_draws_by_itself() -> None:
    found: list[bytes] = []
    thread = threading.Thread(target=lambda: found.extend(pngs([Fake(1), Fake(2)])))
    thread.start()
    thread.join()
    assert found == [b"1 True", b"2 True"]


def test_a_process_that_is_ended_costs_no_picture() -> None:
    assert [data.split()[0] for data in pngs([Fake(1), Fake(2, ends=True), Fake(3)])] == [b"1", b"2", b"3"]


def test_an_error_of_a_picture_is_the_callers() -> None:
    class Wrong(Fake):
        def png(self) -> bytes:
            raise ValueError("no data")

    with pytest.raises(ValueError, match="no data"):
        list(pngs([Fake(1), Wrong(2)]))
    assert drawing_processes._given == ()
