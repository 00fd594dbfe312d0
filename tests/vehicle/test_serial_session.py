"""A session over a serial port, by pyserial, on a pseudo-terminal, whose cable is pulled in mid-sweep."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from serial_cable import SerialCable

from rover_sweep.errors import LinkError
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.session import drive
from rover_sweep.session.simulated_rover import SimulatedRover, simulated_plan
from rover_sweep.vehicle.events import StateChanged
from rover_sweep.vehicle.link.link import Link
from sitl import launcher
from tests.vehicle.simulated_drive import READY


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
