"""Runs that are too short for a noise floor are refused in a sentence."""

from __future__ import annotations

from dataclasses import replace

import pytest
from planted import sweeps

from rover_sweep.diagnosis.diagnose import _refuse_without_floor
from rover_sweep.diagnosis.simulation.experiment import RATE
from rover_sweep.errors import DataRefused


def test_a_run_of_three_seconds_is_refused() -> None:
    whole = sweeps(1)[0]
    _refuse_without_floor([whole])
    few = int(3 * RATE)
    short = replace(whole, t=whole.t[:few], steer=whole.steer[:few], commanded=None)
    with pytest.raises(DataRefused, match="too short to find their noise floor: the longest has 3.0 s"):
        _refuse_without_floor([short])
