"""The verdict right after a run on the embedded rover: a weak sweep is to be repeated, a good one kept."""

import re

import pytest

from rover_sweep.logs.read import read_runs
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.verdict import assess
from rover_sweep.vehicle.events import RunFinished
from tests.vehicle.simulated_drive import drive_simulated


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory):
    runs = {"sweep1": Sweep(amplitude=20.0), "sweep2": Sweep(amplitude=150.0)}
    folder = tmp_path_factory.mktemp("weak") / "session"
    return [
        assess(read_runs(str(event.tlog))[-1])
        for event in drive_simulated(runs, folder)
        if isinstance(event, RunFinished)
    ]


def test_twenty_microseconds_are_too_few(verdicts):
    weak = verdicts[0]
    assert not weak.keep
    assert weak.amplitude == pytest.approx(20, abs=1)
    asked = float(re.search(r"repeat with (\d+) us in place of 20", weak.sentence)[1])
    assert 30 <= asked <= 150


def test_a_good_sweep_is_kept(verdicts):
    assert verdicts[1].keep
    assert verdicts[1].sentence.startswith("keep")
