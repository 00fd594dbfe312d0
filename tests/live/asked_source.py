"""Asks a `VehicleSource` and waits, as a screen does; what a test of it shares with the others."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from rover_sweep.live.source import Connect, Ended, Request, Update
from rover_sweep.live.vehicle_source import VehicleSource
from rover_sweep.manoeuvre.sweep import Doublet, Sweep
from rover_sweep.session.session import SessionRun
from rover_sweep.vehicle.run.controls import RunSettings

Kind = TypeVar("Kind")

LIMITS = {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0, "still": 1.0}
SETTINGS = RunSettings(arm=True, throttle_us=1710, trigger="override", extra=LIMITS)
PLAN = (
    SessionRun("sweep1", Sweep(amplitude=120, w_min=2, w_max=20, t_rec=10, straight=1)),
    SessionRun("doublet", Doublet(count=1, straight=1)),
)


class Asked:
    """told: everything so far with the time it was told, [(monotonic s, value)]."""

    def __init__(self, folder: Path, vehicle_file: Path | None = None) -> None:
        self.told: list[tuple[float, Update]] = []
        self._new: SimpleQueue[Update] = SimpleQueue()
        self.source = VehicleSource(folder, vehicle_file)
        self.source.start(self._tell)

    def _tell(self, told: Update) -> None:
        self.told.append((time.monotonic(), told))
        self._new.put(told)

    def __enter__(self) -> Asked:
        return self

    def __exit__(self, *_: object) -> None:
        self.source.close()

    def all(self, kind: type[Kind]) -> list[Kind]:
        return [told for _, told in self.told if isinstance(told, kind)]

    def when(self, kind: type[Any]) -> list[float]:
        return [t for t, told in self.told if isinstance(told, kind)]

    def wait(
        self, kind: type[Kind], where: Callable[[Any], bool] = lambda _: True, seconds: float = 30.0
    ) -> Kind:
        """The next of that kind from now on that was not waited for before."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            try:
                told = self._new.get(timeout=left)
            except Empty:
                break
            if isinstance(told, kind) and where(told):
                return told
        raise AssertionError(f"no {kind.__name__} within {seconds} s; the last was {self.told[-3:]}")

    def do(self, request: Request) -> str:
        """Ask, wait for the end; the failure in words."""
        self.source.ask(request)
        return self.wait(Ended, lambda ended: ended.request == request).failure

    def connect(self, url: str) -> None:
        assert self.do(Connect(url)) == ""
