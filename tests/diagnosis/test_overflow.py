"""A trial of a fit may have numbers that no rover has."""

import numpy as np
import pytest

from rover_sweep.diagnosis.simulation.single_track import VehicleNumbers, single_tracks


@pytest.mark.parametrize("stiffness", [1e200, float("inf"), float("nan")])
def test_a_trial_that_overflows_is_simulated(stiffness: float) -> None:
    """A fit tries such numbers and rejects them by their rows, which are none."""
    zero = np.zeros(50)
    numbers = VehicleNumbers(
        m=2.6, ms=2.4, h=0.06, Ixx=0.01, Izz=0.07, Ixz=0.0, a=0.2, b=0.2, Cf=stiffness, Cr=30.0, k_phi=10.0,
        b_phi=0.4, g=9.81, bend=0.0, track=0.0
    )  # fmt: skip
    steer, speed = zero + 0.1, zero + 2.0
    drive = (steer, speed, speed, zero, zero, zero, np.array(numbers))
    for y in single_tracks(drive, drive, (False, False), True, 0.01):
        assert y.shape == (7, 50)
