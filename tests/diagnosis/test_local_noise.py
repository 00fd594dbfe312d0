"""The noise floor of driving by hand, of smoothed and of resampled data, is not near zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter

from rover_sweep.data.recording import LowPass
from rover_sweep.diagnosis.problem.noise_floor import LEAST, floor_of, has_floor
from rover_sweep.diagnosis.problem.residuals import with_floor
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, tapered

DENSITY = 2e-5  # (rad/s)^2/Hz


def by_hand(
    seed: int, seconds: float = 20.0, smooth: bool = False
) -> tuple[Experiment, dict[str, np.ndarray]]:
    """A run at 50 Hz in which no line below 5 Hz is quiet, and its residual: noise, a wrong gain, a lag."""
    random = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / RATE)
    knots = np.cumsum(random.uniform(0.15, 0.5, 400))
    steer = np.interp(t, knots, 0.2 * random.uniform(-1, 1, knots.size))
    slow = np.arange(0, seconds + 0.1, 0.02)
    noise = np.sqrt(DENSITY * 25) * random.standard_normal(slow.size)
    response = lfilter([0.1], [1, -0.9], 0.6 * np.interp(slow, t, steer))
    r = 3 * np.interp(slow, t, steer) + response + noise
    measured = {"r": np.interp(t, slow, savgol_filter(r, 17, 2) if smooth else r)}
    residual = measured["r"] - 3 * steer
    run = Experiment(
        "by hand", "other", t, steer, np.full(t.size, 2.0), np.zeros(t.size), measured, {}, {},
        tapered(t.size), {"r": 50.0}, steer_rate=50.0,
    )  # fmt: skip
    return run, {"r": residual}


@pytest.mark.parametrize("seconds", [20.0, 3.0])
def test_noise_is_told_from_a_response_without_a_quiet_line(seconds: float) -> None:
    made = [by_hand(k, seconds) for k in range(6 if seconds > 10 else 25)]
    floor = floor_of([run for run, _ in made], [rest for _, rest in made])
    found = np.median(floor.at("r", np.linspace(1.0, 4.0, 20)))
    assert 0.6 * DENSITY < found < 1.5 * DENSITY
    assert has_floor([run for run, _ in made])


def test_smoothing_does_not_take_the_floor_away() -> None:
    made = [by_hand(k, smooth=True) for k in range(6)]
    floor = floor_of([run for run, _ in made], [rest for _, rest in made])
    assert floor.at("r", np.array([9.0]))[0] >= 0.2 * floor.at("r", np.array([2.0]))[0]
    assert 3.0 < floor.top["r"] < 12.0
    used = with_floor([made[0][0]], floor).rows[0].f
    assert np.max(used) <= floor.top["r"]


def test_unsmoothed_noise_limits_no_line() -> None:
    made = [by_hand(k) for k in range(6)]
    assert not floor_of([run for run, _ in made], [rest for _, rest in made]).top


def test_a_known_filter_is_taken_as_it_is() -> None:
    made = [by_hand(k, smooth=True) for k in range(6)]
    runs = [replace(run, filters={"r": LowPass(4.0)}) for run, _ in made]
    assert not floor_of(runs, [rest for _, rest in made]).top


def test_no_floor_is_below_that_of_a_sensor() -> None:
    """A simulator's roll rate of nothing at all gave 1e10 times the noise."""
    run, _ = by_hand(0)
    run = replace(run, measured={**run.measured, "p": np.zeros(run.t.size)})
    still = floor_of([run], [{"r": np.zeros(run.t.size), "p": np.full(run.t.size, 1e-12)}])
    assert np.all(still.density["p"] >= LEAST["p"]) and np.all(still.density["r"] >= LEAST["r"])
