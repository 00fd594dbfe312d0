"""The search for the fewest quantities that explain a difference."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rover_sweep.comparison import compare
from rover_sweep.comparison.common_model import PENALTY, Subsets, fewest
from rover_sweep.comparison.direct import pairs_by_steering
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, tapered
from rover_sweep.errors import DataRefused

K = 12


def _correlated(seed: int) -> np.ndarray:
    """A covariance (K, K) whose coordinates depend strongly on each other."""
    a = np.random.default_rng(seed).standard_normal((K, K))
    return a @ a.T / K + 0.02 * np.eye(K)


def _columns() -> list[np.ndarray]:
    return [np.eye(K)[:, [k]] for k in range(K)]


@pytest.mark.parametrize("seed", range(4))
def test_names_the_two_that_differ(seed):
    covariance = _correlated(seed)
    noise = np.random.default_rng(100 + seed).multivariate_normal(np.zeros(K), covariance)
    size = 12.0 * np.sqrt(np.diag(covariance))
    difference = noise + np.eye(K)[3] * size[3] - np.eye(K)[8] * size[8]
    assert fewest(Subsets(difference, covariance, _columns())) == (3, 8)


def test_names_nothing_where_only_noise_differs():
    wrong = 0
    for seed in range(30):
        covariance = _correlated(seed)
        noise = np.random.default_rng(500 + seed).multivariate_normal(np.zeros(K), covariance)
        wrong += bool(fewest(Subsets(noise, covariance, _columns())))
    assert wrong <= 1


def test_one_direction_instead_of_two_coordinates_and_its_amount():
    """A number that moves two coordinates is preferred to both of them."""
    both = np.zeros((K, 1))
    both[2], both[5] = 0.5, -1.0
    assert fewest(Subsets(9.0 * both[:, 0], 0.05 * np.eye(K), [*_columns(), both])) == (K,)
    subsets = Subsets(4.0 * np.eye(K)[6], 0.25 * np.eye(K), _columns())
    assert subsets.amount(6, (6,)) == (pytest.approx(4.0), pytest.approx(0.5))
    assert subsets.left(()) == pytest.approx(64.0)
    assert subsets.score((6,)) == pytest.approx(PENALTY)


@pytest.mark.parametrize("small, kept", [(60.0, (3, 8)), (5.0, (3,))])
def test_what_a_large_difference_leaves_beside_it_is_not_named(small, kept):
    """Sizes in standard deviations: 200 gains 40 000, of which a wrong law may leave 25 but not 3600."""
    difference = np.zeros(K)
    difference[3], difference[8] = 200.0, small
    subsets = Subsets(difference, np.eye(K), _columns())
    assert fewest(subsets, {3}) == kept
    assert fewest(subsets, {8}) == fewest(subsets) == (3, 8)  # numbers are the same in both models


def test_bounds_stand_in_the_order_of_the_parameters(monkeypatch):
    """Not in that of a set, which is another one in each process."""
    names = [f"p{k}" for k in range(12)]
    p = library()["steering_trim"].parameters[0]
    amounts = {("sensor_scale", name): (p, 0.1, 1.0) for name in names}
    monkeypatch.setattr(compare, "_amounts", lambda side: amounts)
    found = SimpleNamespace(candidates=(), chosen=())
    assert list(compare.could_differ(found, None, None)["sensor_scale"]) == names


# ---- Simulated runs find the recorded runs whose steering they repeat.

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


def test_refuses_another_steering_and_a_run_that_was_simulated_twice():
    one = _run("one", _sweep(0.05))
    with pytest.raises(DataRefused, match="sim does not have the steering of any of the runs"):
        pairs_by_steering([one], [_run("sim", _sweep(0.11))])
    with pytest.raises(DataRefused, match="all of them are taken"):
        pairs_by_steering([one], [_run("a", one.steer), _run("b", one.steer)])
