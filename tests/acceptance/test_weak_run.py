"""The verdict right after a run on the embedded rover: a weak sweep is to be repeated."""

import re

import pytest

from rover_sweep.logs.read import read_runs
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.verdict import assess
from rover_sweep.vehicle.events import RunFinished
from tests.vehicle.simulated_drive import drive_simulated


def test_twenty_microseconds_are_too_few(tmp_path):
    events = drive_simulated({"sweep1": Sweep(amplitude=20.0, t_rec=40.0, w_min=0.6)}, tmp_path / "session")
    (finished,) = [event for event in events if isinstance(event, RunFinished)]
    weak = assess(read_runs(str(finished.tlog))[-1])
    assert not weak.keep
    assert weak.amplitude == pytest.approx(20, abs=1)
    asked = float(re.search(r"repeat with (\d+) us in place of 20", weak.sentence)[1])
    assert 30 <= asked <= 150
