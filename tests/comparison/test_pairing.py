"""Simulated runs find the recorded runs whose steering they repeat."""

from __future__ import annotations

import numpy as np
import pytest

from rover_sweep.comparison.direct import pairs_by_steering
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, tapered
from rover_sweep.errors import DataRefused

N = 4000


def _run(name: str, steer: np.ndarray) -> Experiment:
    t = np.arange(steer.size) / RATE
    level = np.full(steer.size, 2.0)
    return Experiment(name, "sweep", t, steer, level, 0 * t, {"r": steer}, {}, {}, tapered(steer.size))


def _sweep(fast: float, size: int = N) -> np.ndarray:
    t = np.arange(size) / RATE
    return 0.1 * np.sin(2 * np.pi * (0.3 + fast * t) * t)


def test_pairs_in_any_order():
    one, two = _run("one", _sweep(0.05)), _run("two", _sweep(0.09))
    found = pairs_by_steering([one, two], [_run("b", two.steer), _run("a", one.steer)])
    assert [(p.recorded.name, p.simulated.name) for p in found] == [("one", "a"), ("two", "b")]
    assert all(p.late == 0.0 for p in found)


@pytest.mark.parametrize("shift", [-240, -1, 1, 333])
def test_finds_the_shift_of_the_grids(shift):
    whole = np.concatenate((np.zeros(400), _sweep(0.07), np.zeros(400)))
    recorded = _run("one", whole[400 : 400 + N])
    simulated = _run("sim", whole[400 - shift : 400 - shift + N])
    (pair,) = pairs_by_steering([recorded], [simulated])
    assert pair.late == pytest.approx(shift / RATE)


def test_a_loop_of_the_firmware_on_the_way_is_the_same_steering():
    """A first-order lag of 10 ms and a step of a us, as the firmware puts them into what it repeats."""
    recorded = _run("one", _sweep(0.05))
    late = np.interp(recorded.t - 0.01, recorded.t, recorded.steer)
    (pair,) = pairs_by_steering([recorded], [_run("sim", np.round(late / 0.001) * 0.001)])
    assert pair.late == pytest.approx(0.01)


def test_refuses_another_steering():
    with pytest.raises(DataRefused, match="sim does not have the steering of any of the runs"):
        pairs_by_steering([_run("one", _sweep(0.05))], [_run("sim", _sweep(0.11))])


def test_refuses_a_run_that_was_simulated_twice():
    one = _run("one", _sweep(0.05))
    with pytest.raises(DataRefused, match="all of them are taken"):
        pairs_by_steering([one], [_run("a", one.steer), _run("b", one.steer)])
