"""Abort: at once, from any thread, however often it is pressed; and a link that is lost in mid-sweep."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from asked_source import PLAN, SETTINGS, Asked
from counted_proxy import CountedProxy

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.live import vehicle_source
from rover_sweep.live.source import DriveRequest, Ended, FetchLogs, Judged, Lost, Play, Snapshot, Update
from rover_sweep.live.vehicle_source import VehicleSource
from rover_sweep.logs.readers.tlog import open_tlog
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.folder import read_folder
from rover_sweep.session.session import SessionRun
from rover_sweep.vehicle.events import Connected, Interrupted, Notice, StateChanged
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import MAY_BE_ARMED, RunSettings
from sitl import launcher
from tests.vehicle.simulated_drive import READY

FAST = SessionRun("sweep1", Sweep(amplitude=200, w_min=5, w_max=20, t_rec=30, straight=1))
TRIM = 1500


@pytest.fixture
def rover(tmp_path: Path) -> Iterator[launcher.Running]:
    with launcher.start_embedded(tmp_path / "vehicle", options=READY, speedup=4) as running:
        yield running


def steering(tlog: Path) -> tuple[np.ndarray, np.ndarray]:
    """(t [s], PWM [us]) of the steering output in a tlog."""
    rows = open_tlog(tlog, frozenset({"SERVO_OUTPUT_RAW"})).messages["SERVO_OUTPUT_RAW"].rows
    return rows["time_usec"] * 1e-6, rows["servo1_raw"].astype(float)


def in_mid_sweep(asked: Asked, planned: SessionRun, settings: RunSettings) -> float:
    """Drive until the wave is on; the vehicle's time [s]."""
    asked.source.ask(DriveRequest(planned, settings))
    asked.wait(StateChanged, lambda event: event.state == 6)
    return asked.wait(Snapshot).t


def test_an_abort_in_mid_sweep_lets_the_steering_go(rover: launcher.Running, tmp_path: Path) -> None:
    with Asked(tmp_path / "s") as asked:
        for harmless in (lambda: asked.connect(rover.connection), lambda: asked.wait(Snapshot)):
            asked.source.abort()  # while nothing is driven
            while asked.source._stop.is_set():
                time.sleep(0.01)
            harmless()
        in_mid_sweep(asked, FAST, SETTINGS)
        asked.source.ask(DriveRequest(PLAN[1], SETTINGS))  # must not be begun after an abort
        pressed_at = asked.all(Snapshot)[-1].t
        for _ in range(50):  # somebody hammers on the key
            asked.source.abort()
        stopped = asked.wait(Interrupted)
        assert (stopped.name, stopped.failures, stopped.armed) == ("sweep1", (), False)
        assert asked.wait(Ended).failure == "aborted before it began"
        assert asked.wait(Ended).failure == "aborted"
        assert asked.wait(Judged).verdict.advice == "repeat"
        asked.wait(Snapshot, lambda snapshot: not snapshot.armed)
        assert asked.do(Play()) == "a vehicle is driven, not played"  # the thread lives
    t, pwm = steering(tmp_path / "s" / "sweep1.tlog")
    moved = t[np.abs(pwm - TRIM) > 2]
    # 0.1 s of vehicle time per snapshot, and what the applet needs to see the switch: 0.34 s.
    assert 0 < moved[-1] - pressed_at < 1.0
    assert t[-1] > moved[-1] + 0.2  # recorded until the rover was let go, at trim
    (run,) = read_folder(tmp_path / "s").runs
    assert (run.state, run.left_armed) == ("stopped", False)


class Pilot:
    """The person with the radio, as another ground station: arms, drives, holds the switch high."""

    def __init__(self, url: str, tlog: Path) -> None:
        self._link, self._end = Link.open(url, tlog), threading.Event()
        self._thread = threading.Thread(target=self._drive, daemon=True)
        self._thread.start()

    def _drive(self) -> None:
        self._link.require("arm", "MAV_CMD_COMPONENT_ARM_DISARM", 1.0)
        self._link.every(0.2, self._hold)
        while not self._end.is_set():
            self._link.receive(0.05)

    def _hold(self) -> None:
        sticks = {f"chan{n}_raw": {3: 1710, 6: 1900}.get(n, 65535) for n in range(1, 17)}
        self._link.to_vehicle("RC_CHANNELS_OVERRIDE", **sticks, chan17_raw=0, chan18_raw=0)

    def __enter__(self) -> Pilot:
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join(5)
        self._link.close()


def test_an_abort_stops_the_applet_while_the_pilot_holds_the_switch(rover, tmp_path):
    with Asked(tmp_path / "s") as asked:
        asked.connect(rover.connection)
        asked.source.ask(DriveRequest(FAST, RunSettings(extra={"v_max": 5.0, "still": 0.0}, patience=60)))
        asked.wait(Notice, lambda notice: "waiting for the pilot to arm" in notice.text)
        with Pilot(rover.connection, tmp_path / "pilot.tlog"):
            asked.wait(StateChanged, lambda event: event.state == 6)
            asked.source.abort()
            stopped = asked.wait(Interrupted)
            assert (stopped.failures, stopped.armed) == ((), True)  # who armed disarms
            asked.wait(Snapshot, lambda now: now.state in (0, 10) and now.pwm == TRIM and now.armed)
            assert asked.wait(Snapshot).switch == 1900
    (run,) = read_folder(tmp_path / "s").runs
    assert (run.state, run.left_armed) == ("stopped", False)


def test_closing_in_mid_sweep_lets_the_rover_go(rover: launcher.Running, tmp_path: Path) -> None:
    with Asked(tmp_path / "s") as asked:
        asked.connect(rover.connection)
        in_mid_sweep(asked, FAST, SETTINGS)
        assert asked.source.close() == ""
    assert asked.all(Interrupted)[0].failures == () and not asked.all(Interrupted)[0].armed


def test_closing_over_a_dead_link_says_that_the_rover_may_be_armed(rover, tmp_path, monkeypatch):
    """Its views are gone then: whoever closed them reads it on the terminal."""
    monkeypatch.setattr(vehicle_source, "_GOODBYE", 1.0)
    with CountedProxy(rover.connection) as proxy, Asked(tmp_path / "s") as asked:
        asked.connect(proxy.url)
        in_mid_sweep(asked, FAST, SETTINGS)
        proxy.cut()
        assert asked.source.close() == MAY_BE_ARMED
    (run,) = read_folder(tmp_path / "s").runs
    assert run.left_armed


def test_a_lost_link_is_found_again_and_the_rover_let_go(rover: launcher.Running, tmp_path: Path) -> None:
    with CountedProxy(rover.connection) as proxy, Asked(tmp_path / "s") as asked:
        asked.source.session.plan((FAST,))
        asked.connect(proxy.url)
        in_mid_sweep(asked, FAST, SETTINGS)
        proxy.cut()
        failure = asked.wait(Ended, seconds=60.0).failure
        assert "ended" in failure or "cannot send" in failure
        assert asked.wait(Lost).reason
        (run,) = read_folder(tmp_path / "s").runs
        assert (run.state, run.left_armed) == ("cut", True)
        proxy.mend()
        asked.wait(Notice, lambda notice: "was disarmed" in notice.text)
        asked.wait(Connected)
        asked.wait(Snapshot, lambda snapshot: not snapshot.armed)
        assert [run.name for run in asked.source.session.to_drive] == ["sweep1"]
        assert (tmp_path / "s" / "sweep1.tlog").stat().st_size > 10_000


# ---- The search for a vehicle that was lost: an abort does not end it, what trying cannot mend does.


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
    may_be_armed = False
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
