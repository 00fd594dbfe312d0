"""The search for a vehicle that was lost: an abort does not end it, what trying cannot mend does."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.live import vehicle_source
from rover_sweep.live.source import Ended, FetchLogs, Update
from rover_sweep.live.vehicle_source import VehicleSource
from rover_sweep.vehicle.events import Notice


def lost(folder: Path) -> VehicleSource:
    """It looks for its vehicle."""
    source = VehicleSource(folder / "session")
    source._url, source._lost = "tcp:127.0.0.1:1", True
    return source


def test_the_search_goes_on_after_an_abort(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = lost(tmp_path)
    tried, again = list[str](), threading.Event()

    def opened(url: str, *rest: object) -> None:
        tried.append(url)
        if len(tried) == 1:
            source.abort()
            source._tick()  # as whoever waits on the link does; the abort ends that
        again.set()
        raise LinkError("nobody answers")

    monkeypatch.setattr(vehicle_source.Link, "open", opened)
    source.start(lambda told: None)
    try:
        assert again.wait(5.0), "nobody looks for the vehicle any more"
        assert set(tried) == {"tcp:127.0.0.1:1"}
    finally:
        source.close()


class Found:
    """A link to a rover that still drives."""

    armed = True
    target = (1, 1)

    def hear(self, listener: Callable[[object], None]) -> None:
        """Nothing is heard."""

    def receive(self, timeout: float) -> None:
        time.sleep(timeout)

    def close(self) -> None:
        """Nothing to close."""


def test_an_abort_while_the_found_one_is_greeted_stops_it_and_greets_it_again(tmp_path, monkeypatch):
    source = lost(tmp_path)
    links, done, greeted = list[object](), list[tuple[str, object]](), threading.Event()
    refused = list[str]()

    def opened(*rest: object) -> Found:
        links.append(Found())
        return links[-1]

    def greet(work: object, link: object) -> Iterator[Update]:
        done.append(("greeted", link))
        if len(links) == 1:
            source.abort()
            source.ask(FetchLogs())  # no vehicle is there for it before it was greeted
            source._tick()
        greeted.set()
        yield from ()

    def stop_and_disarm(link: object, disarm: bool) -> Iterator[Update]:
        done.append(("stopped", link))
        yield from ()

    monkeypatch.setattr(vehicle_source.Link, "open", opened)
    monkeypatch.setattr(vehicle_source.VehicleWork, "greet", greet)
    monkeypatch.setattr(vehicle_source, "stop_and_disarm", stop_and_disarm)
    source.start(lambda told: refused.append(told.failure) if isinstance(told, Ended) else None)
    try:
        assert greeted.wait(5.0), "the vehicle was found and never greeted"
        assert done == [("greeted", links[0]), ("stopped", links[0]), ("greeted", links[1])]
        assert refused == ["no vehicle is connected"]
    finally:
        source.close()


def test_a_full_disk_ends_the_search_and_is_told_once(tmp_path, monkeypatch):
    source = lost(tmp_path)
    warned = list[str]()

    def opened(*rest: object) -> None:
        raise UsageError("the disk is full")

    monkeypatch.setattr(vehicle_source.Link, "open", opened)
    source.start(lambda told: warned.append(told.text) if isinstance(told, Notice) else None)
    try:
        time.sleep(0.5)  # ten turns
        assert warned == ["the disk is full"]
    finally:
        source.close()
