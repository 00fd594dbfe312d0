"""An abort while the vehicle is looked for again: the search goes on."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from rover_sweep.errors import LinkError
from rover_sweep.live import vehicle
from rover_sweep.live.vehicle import VehicleSource


def test_the_search_goes_on_after_an_abort(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = VehicleSource(tmp_path / "session")
    tried, again = list[str](), threading.Event()

    def opened(url: str, *rest: object) -> None:
        tried.append(url)
        if len(tried) == 1:
            source.abort()
            source._tick()  # as whoever waits on the link does; the abort ends that
        again.set()
        raise LinkError("nobody answers")

    monkeypatch.setattr(vehicle.Link, "open", opened)
    source._url, source._lost = "tcp:127.0.0.1:1", True
    source.start(lambda told: None)
    try:
        assert again.wait(5.0), "nobody looks for the vehicle any more"
        assert set(tried) == {"tcp:127.0.0.1:1"}
    finally:
        source.close()
