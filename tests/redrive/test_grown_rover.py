"""The nominal rover at another mass keeps its motion: rates and accelerations, frequencies, limits."""

from __future__ import annotations

import numpy as np
import pytest

from rover_sweep.redrive.recorded_course import grown
from sitl.plant.plant import Plant
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")
SIZES = ("mass", "sprung_mass", "cg_height_above_roll_centre", "yaw_inertia", "roll_inertia")


def _size(mass: float) -> dict[str, float]:
    return {name: getattr(NOMINAL, name) for name in SIZES} | {
        name: getattr(NOMINAL, name) * mass for name in ("mass", "sprung_mass", "yaw_inertia", "roll_inertia")
    }


def _yaw_and_roll(rover) -> np.ndarray:
    plant, out = Plant(rover, 1), []
    plant.state.vx = 2.0
    for k in range(600):
        plant.step(1500.0 + (120.0 if k > 200 else 0.0), 1700.0, 0.005)
        out.append((plant.state.r, plant.state.phi))
    return np.array(out)


def test_twenty_times_the_mass_moves_alike():
    heavy = grown(NOMINAL, _size(20.0))
    assert heavy.front_cornering_stiffness == pytest.approx(20.0 * NOMINAL.front_cornering_stiffness)
    one, two = _yaw_and_roll(NOMINAL), _yaw_and_roll(heavy)
    assert np.abs(one).max() > 0.1
    assert np.abs(one - two).max() < 0.02 * np.abs(one).max()


def test_a_rover_of_nearly_the_same_mass_stays():
    assert grown(NOMINAL, _size(1.05)) == NOMINAL
