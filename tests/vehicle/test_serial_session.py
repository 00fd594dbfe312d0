"""Sessions over a serial port, by pyserial, on a pseudo-terminal: loss and damage, and a pulled cable."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import pytest
from serial_cable import SerialCable

from rover_sweep.errors import LinkError
from rover_sweep.logs.read import read_runs
from rover_sweep.manoeuvre.sweep import Doublet, Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.session import drive
from rover_sweep.session.simulated_rover import SimulatedRover, simulated_plan
from rover_sweep.vehicle.events import LogSaved, Notice, RunFinished, SessionFinished, StateChanged
from rover_sweep.vehicle.link.link import Link
from sitl import launcher
from tests.vehicle.simulated_drive import READY


@pytest.mark.slow
def test_a_session_over_a_serial_line_that_loses_and_damages(tmp_path: Path) -> None:
    sweep = Sweep(amplitude=120, w_min=2, w_max=20, t_rec=10)
    plan = simulated_plan(
        (SessionRun("sweep1", sweep), SessionRun("doublet", Doublet(count=1))), SimulatedRover()
    )
    with (
        launcher.start_embedded(tmp_path / "vehicle", options=READY) as rover,
        SerialCable(rover.connection, drop=0.015, corrupt=0.015) as cable,
    ):
        events = []
        for event in drive(cable.device, tmp_path / "station", plan):
            events.append(event)
            if isinstance(event, RunFinished) and event.name == "doublet":
                cable.drop = cable.corrupt = 0.001  # each gap in the log takes a while
    assert cable.lost > 20 and cable.damaged > 20 and cable.passed > 25 * cable.lost
    finished = [event for event in events if isinstance(event, RunFinished)]
    assert [(run.name, run.completed) for run in finished] == [("sweep1", True), ("doublet", True)]
    warned = [event.text for event in events if isinstance(event, Notice) and event.level == "warning"]
    assert warned and all(re.search(r"the link loses [2-5]% of the frames", text) for text in warned)
    (saved,) = [event for event in events if isinstance(event, LogSaved)]
    assert [run.kind for run in read_runs(str(saved.path))] == ["sweep", "doublet"]
    assert isinstance(events[-1], SessionFinished)


def test_a_pulled_cable_ends_the_session_and_the_rover_stops(tmp_path: Path) -> None:
    plan = simulated_plan((SessionRun("sweep1", Sweep(amplitude=120, straight=1)),), SimulatedRover())
    with launcher.start_embedded(tmp_path / "vehicle", options=READY, speedup=10) as rover:
        with SerialCable(rover.connection) as cable:
            again = threading.Timer(1.5, cable.plug)
            with pytest.raises(LinkError, match="ended .the serial device went away."):
                for event in drive(f"{cable.device},57600", tmp_path / "station", plan):
                    if isinstance(event, StateChanged) and event.name == "manoeuvre":
                        cable.pull()
                        again.start()
            again.join()
        with Link.open(rover.connection, tmp_path / "after.tlog") as link:
            assert not link.armed  # who armed disarms, when the cable is back
            outputs = link.request_message("SERVO_OUTPUT_RAW")
            assert outputs is not None
            assert (outputs.servo1_raw, outputs.servo3_raw) == (1500, 1500)
