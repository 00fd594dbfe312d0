"""The compiled simulation: when it is compiled, numbers that no rover has, and its tyre."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.diagnosis.simulation import candidates as lumped_baseline
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.simulator import vehicle_numbers
from rover_sweep.diagnosis.simulation.single_track import (
    VehicleNumbers,
    must_compile,
    single_tracks,
    tyre_force,
)
from sitl.plant.effects.tyres import knee
from sitl.plant.tyre import lateral_force

ROVER = Geometry(2.76, 0.196, 0.187, 2.49, 0.058, 0.0146, 0.075)


def test_a_loop_that_is_kept_on_disk_is_not_compiled_again(tmp_path: Path) -> None:
    index = tmp_path / "single_track.nbi"
    loop = SimpleNamespace(_cache=SimpleNamespace(_cache_file=SimpleNamespace(_index_path=str(index))))
    assert must_compile(loop)
    index.write_bytes(b"kept")
    assert not must_compile(loop)
    assert not must_compile(object())  # a numba that does not say


@pytest.mark.parametrize("stiffness", [1e200, float("inf"), float("nan")])
def test_a_trial_that_overflows_is_simulated(stiffness: float) -> None:
    """A fit tries such numbers and rejects them by their rows, which are none."""
    zero = np.zeros(50)
    numbers = VehicleNumbers(
        m=2.6, ms=2.4, h=0.06, Ixx=0.01, Izz=0.07, Ixz=0.0, a=0.2, b=0.2, Cf=stiffness, Cr=30.0, k_phi=10.0,
        b_phi=0.4, g=9.81, bend=0.0, track=0.0
    )  # fmt: skip
    speed = zero + 2.0
    drive = (zero + 0.1, speed, speed, zero, zero, zero, np.array(numbers))
    for y in single_tracks(drive, drive, (False, False), True, 0.01):
        assert y.shape == (7, 50)
    assert not must_compile()  # it is on disk once it ran


@pytest.mark.parametrize("roll", [True, False])
def test_the_first_derivatives_move_as_the_model_that_they_are_made_of_at_any_speed(roll: bool) -> None:
    """Small angles: the linear derivatives against the single track with its own first numbers."""
    t = np.arange(0, 4, 0.005)
    steer, speed, zero = 0.01 * np.sin(2 * t**2), 1.5 + 0.3 * t, np.zeros(t.size)
    about = 0.0146 + 2.49 * 0.058**2
    x = {
        "ln_C": np.log(1.5 * ROVER.mass * 9.81),
        "ln_Izz": np.log(0.075),
        "ln_k_phi": np.log(about * (2 * np.pi * 3.5) ** 2 + 2.49 * 9.81 * 0.058),
        "ln_b_phi": np.log(0.4 * about * 2 * np.pi * 3.5),
    }
    q = np.array(vehicle_numbers(Model("roll-yaw" if roll else "bicycle", ROVER, Tolerances()), x))
    drive = (steer, speed, np.ones(t.size), zero, zero, zero, q)
    whole = single_tracks(drive, drive, (False, False), roll, 0.005)[0]
    first = {c.name: c.start for c in lumped_baseline.derivatives(ROVER, roll)}
    found = lumped_baseline.motion(steer, speed, zero, first, 0.005)
    for k, name in enumerate(("v", "r", "phi", "p", "across")):
        assert np.max(np.abs(found[name] - whole[k])) <= 0.005 * np.max(np.abs(whole[k])) + 1e-12, name


@pytest.mark.parametrize("friction", [0.7, 0.9, 1.2])
def test_the_nominal_tyre_bends_as_a_magic_formula_does(friction: float) -> None:
    """Up to half of the peak force, within 1 % of the force."""
    bend, load = 0.735 / friction**2, 13.0
    for share in (0.1, 0.3, 0.5):
        alpha = share * friction * load / 31.0
        theirs = lateral_force(alpha, 31.0, friction * load, 1.3)
        assert tyre_force(alpha, 31.0, load, 1.0 / load, 0.0, bend, 0.0) == pytest.approx(theirs, rel=0.01)


@pytest.mark.parametrize("share", [0.3, 0.95, 2.0])
def test_the_tyre_with_a_knee_is_the_same_in_the_plant(share: float) -> None:
    """The doublet stays below it, so force by force. share: of the slip at which a linear tyre slides."""
    stiffness, load, mu = 31.0, 13.0, 0.4
    slip = share * mu * load / stiffness
    ours = tyre_force(slip, stiffness, load, 1.0 / load, 1.0 / mu, 0.0, 3.0)
    assert ours == pytest.approx(knee(slip, stiffness, mu * load, 1.3), rel=1e-9)
    assert min(share, 1.0) * 0.85 < -ours / (mu * load) < min(share, 1.0)
