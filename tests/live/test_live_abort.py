"""Abort: at once, from any thread, however often it is pressed; and a link that is lost in mid-sweep."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from asked_source import LIMITS, PLAN, READY, SETTINGS, Asked
from counted_proxy import CountedProxy

from rover_sweep.identify.sweep import Sweep
from rover_sweep.live.snapshot import Snapshot
from rover_sweep.live.source import Drive, Ended, FetchLogs, Judged, Lost, Play
from rover_sweep.logs.tlog import open_tlog
from rover_sweep.session_folder.folder import read
from rover_sweep.vehicle.events import Connected, Interrupted, Notice, RunFinished, StateChanged
from rover_sweep.vehicle.run import RunSettings
from rover_sweep.vehicle.session import PlannedRun
from sitl import launcher

FAST = PlannedRun("sweep1", Sweep(amplitude=200, w_min=5, w_max=20, t_rec=30, straight=1))
TRIM = 1500
_SPEEDUP = 5.0


@pytest.fixture
def rover(tmp_path: Path) -> Iterator[launcher.Running]:
    with launcher.start_embedded(tmp_path / "vehicle", options=READY, speedup=_SPEEDUP) as running:
        yield running


def steering(tlog: Path) -> tuple[np.ndarray, np.ndarray]:
    """(t [s], PWM [us]) of the steering output in a tlog."""
    rows = open_tlog(tlog, frozenset({"SERVO_OUTPUT_RAW"})).messages["SERVO_OUTPUT_RAW"].rows
    return rows["time_usec"] * 1e-6, rows["servo1_raw"].astype(float)


def in_mid_sweep(asked: Asked, planned: PlannedRun, settings: RunSettings) -> float:
    """Drive until the wave is on; the vehicle's time [s]."""
    asked.source.ask(Drive(planned, settings))
    asked.wait(StateChanged, lambda event: event.state == 6)
    return asked.wait(Snapshot).t


def test_an_abort_in_mid_sweep_lets_the_steering_go(rover: launcher.Running, tmp_path: Path) -> None:
    with Asked(tmp_path / "s") as asked:
        asked.connect(rover.connection)
        in_mid_sweep(asked, FAST, SETTINGS)
        asked.source.ask(Drive(PLAN[1], SETTINGS))  # must not be begun after an abort
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
    assert t[-1] > moved[-1] + 0.3  # recorded until the rover was let go, at trim
    (run,) = read(tmp_path / "s").runs
    assert (run.state, run.left_armed) == ("stopped", False)


def test_an_abort_stops_the_pilots_sweep_too(rover: launcher.Running, tmp_path: Path) -> None:
    """The switch is not ours: the applet is told to stop, and who armed disarms."""
    planned, own = FAST, RunSettings(arm=True, throttle_us=1710, trigger="aux", extra=LIMITS)
    with Asked(tmp_path / "s") as asked:
        asked.connect(rover.connection)
        in_mid_sweep(asked, planned, own)
        asked.source.abort()
        assert asked.wait(Interrupted).failures == ()
        asked.wait(Snapshot, lambda snapshot: not snapshot.armed and snapshot.state in (0, 10))


def test_an_abort_while_nothing_is_driven_harms_nothing(rover: launcher.Running, tmp_path: Path) -> None:
    with Asked(tmp_path / "s") as asked:
        asked.source.abort()
        asked.connect(rover.connection)
        asked.source.abort()
        asked.wait(Snapshot)
        assert asked.do(FetchLogs()) == ""
        assert asked.do(Drive(PLAN[1], SETTINGS)) == ""
        assert [run.completed for run in asked.all(RunFinished)] == [True]


def test_closing_in_mid_sweep_lets_the_rover_go(rover: launcher.Running, tmp_path: Path) -> None:
    with Asked(tmp_path / "s") as asked:
        asked.connect(rover.connection)
        in_mid_sweep(asked, FAST, SETTINGS)
    assert asked.all(Interrupted)[0].failures == () and not asked.all(Interrupted)[0].armed


def test_a_lost_link_is_found_again_and_the_rover_let_go(rover: launcher.Running, tmp_path: Path) -> None:
    with CountedProxy(rover.connection) as proxy, Asked(tmp_path / "s") as asked:
        asked.source.session.plan((FAST,))
        asked.connect(proxy.url)
        in_mid_sweep(asked, FAST, SETTINGS)
        proxy.cut()
        assert "ended" in asked.wait(Ended).failure
        assert asked.wait(Lost).reason
        (run,) = read(tmp_path / "s").runs
        assert (run.state, run.left_armed) == ("cut", True)
        proxy.mend()
        asked.wait(Notice, lambda notice: "was disarmed" in notice.text)
        asked.wait(Connected)
        asked.wait(Snapshot, lambda snapshot: not snapshot.armed)
        assert [run.name for run in asked.source.session.to_drive] == ["sweep1"]
        assert (tmp_path / "s" / "sweep1.tlog").stat().st_size > 10_000
