"""The dry run on the embedded rover, over a real socket, with the real applet."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

from rover_sweep.logs.read import read_runs
from rover_sweep.manoeuvre.sweep import Doublet, Sweep
from rover_sweep.vehicle.events import LogSaved, Notice, RunFinished, SessionFinished
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.streams import stream_fault
from rover_sweep.vehicle.run.controls import pump
from sitl import launcher
from tests.vehicle.simulated_drive import drive_simulated

SHORT = {
    "sweep1": Sweep(amplitude=120, w_min=2, w_max=20, t_rec=10),
    "sweep2": Sweep(amplitude=240, w_min=2, w_max=20, t_rec=10),
    "doublet": Doublet(count=1),
}


def test_two_sweeps_and_a_doublet(tmp_path: Path) -> None:
    began = time.monotonic()
    events = list(drive_simulated(SHORT, tmp_path))
    assert time.monotonic() - began < 40
    assert not [event for event in events if isinstance(event, Notice) and event.level == "warning"]
    finished = [event for event in events if isinstance(event, RunFinished)]
    assert [(run.name, run.completed, run.number) for run in finished] == [
        ("sweep1", True, 1),
        ("sweep2", True, 2),
        ("doublet", True, 3),
    ]
    for run in finished:
        assert all(
            quality.hz == pytest.approx(50) and not stream_fault(quality, 50) for quality in run.quality
        )
        (recording,) = read_runs(str(run.tlog))
        assert recording.kind == ("doublet" if run.name == "doublet" else "sweep")
        assert run.span[0] < recording.span[0] < recording.span[1] < run.span[1]
        assert recording.standstill
        assert recording.filters["r"].cutoff_hz == 20
    (saved,) = [event for event in events if isinstance(event, LogSaved)]
    assert [run.kind for run in read_runs(str(saved.path))] == ["sweep", "sweep", "doublet"]
    amplitudes = [abs(run.manoeuvre("pwm").x - 1500).max() for run in read_runs(str(saved.path))]
    assert amplitudes == pytest.approx([120, 240, 150], abs=2)
    assert isinstance(events[-1], SessionFinished)
    told = json.loads((tmp_path / "session.json").read_text())
    assert [run["tlog"] for run in told["runs"]] == ["sweep1.tlog", "sweep2.tlog", "doublet.tlog"]
    assert [(log["file"], log["runs"]) for log in told["logs"]] == [
        (saved.path.name, ["sweep1", "sweep2", "doublet"])
    ]


# a shell leaves SIGINT ignored in what it starts in the background
_STATION = """
import sys, pathlib, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.session import drive
from rover_sweep.session.simulated_rover import SimulatedRover, simulated_plan
from rover_sweep.vehicle.events import StateChanged
plan = simulated_plan((SessionRun("sweep1", Sweep()),), SimulatedRover())
for event in drive(sys.argv[1], pathlib.Path(sys.argv[2]), plan):
    if isinstance(event, StateChanged): print(event.state, flush=True)
"""


def _end_station_in_mid_sweep(connection: str, folder: Path, how: signal.Signals) -> None:
    """Drive a dry run in another process and send it a signal while the sweep is on."""
    command = [sys.executable, "-c", _STATION, connection, str(folder)]
    station = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert station.stdout is not None
    with station.stdout:
        for line in station.stdout:
            if line.strip() == "6":
                break
        station.send_signal(how)
        station.wait(20)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_station_that_ends_leaves_a_readable_tlog_and_a_rover_that_stops(
    tmp_path: Path, how: signal.Signals
) -> None:
    options = ("--applet", "--parameter", "SCR_ENABLE=1")
    with launcher.start_embedded(tmp_path / "vehicle", options=options, speedup=10) as rover:
        _end_station_in_mid_sweep(rover.connection, tmp_path / "station", how)
        with Link.open(rover.connection, tmp_path / "after.tlog") as link:
            states: list[float] = []

            def look(message: Any) -> None:
                if message.get_type() == "NAMED_VALUE_FLOAT" and message.name == "SWP_ST":
                    states.append(message.value)

            with link.listening(look):
                end = time.monotonic() + 15
                while (not states or states[-1] not in (0, 10)) and time.monotonic() < end:
                    link.receive(0.2)
            assert states[-1] in (0, 10)  # idle or stopped, steering is the pilot's
            assert how == signal.SIGKILL or not link.armed  # who armed disarms, when it still can
            pump(link, 3.0)  # the throttle's slew rate
            outputs = link.request_message("SERVO_OUTPUT_RAW")
            assert outputs is not None
            assert (outputs.servo1_raw, outputs.servo3_raw) == (1500, 1500)
    log = mavutil.mavlink_connection(str(tmp_path / "station" / "sweep1.tlog"))
    kinds = set()
    while (message := log.recv_msg()) is not None:
        kinds.add(message.get_type())
    assert {"SERVO_OUTPUT_RAW", "ATTITUDE", "NAMED_VALUE_FLOAT"} <= kinds
    assert "BAD_DATA" not in kinds
