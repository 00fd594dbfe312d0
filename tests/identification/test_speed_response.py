"""The speed's law is found from sweeps of another simulation, its intervals hold, bad data is an answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from driven_speed import Truth, driven

from rover_sweep.data.recording import Signal
from rover_sweep.identification.identify_speed import SpeedResult, identify_speed
from rover_sweep.identification.speed_fit import SpeedNoise, noise_of

TRUTH = Truth()


def found(**options: float) -> SpeedResult:
    return identify_speed([driven(**options)])  # type: ignore[arg-type]


def test_finds_the_law_without_noise() -> None:
    result = found(noise=0.0005)
    assert result.level == "good" and result.fit is not None and result.coasting is not None
    model = result.fit.model
    assert model.gain == pytest.approx(TRUTH.gain, rel=0.01)
    assert model.lag == pytest.approx(TRUTH.lag, rel=0.01)
    assert model.delay == pytest.approx(TRUTH.delay, abs=0.006)
    assert model.offset == pytest.approx(TRUTH.dead_zone + TRUTH.drag, abs=0.002)
    dragging = (result.coasting.speed + TRUTH.gain * TRUTH.drag) / TRUTH.lag
    assert result.coasting.deceleration == pytest.approx(dragging, rel=0.02)
    assert result.coasting.dead_zone == pytest.approx(TRUTH.dead_zone, abs=0.004)


def test_intervals_hold_the_truth_nine_times_in_ten() -> None:
    held = tried = 0
    for seed in range(10):
        result = found(noise=0.03, seed=seed)
        assert result.fit is not None
        for name, true in (("gain", 5.0), ("lag", 0.7), ("delay", 0.12), ("offset", 0.09)):
            low, high = result.fit.intervals[name]
            held += low <= true <= high
            tried += 1
            assert high > low
    assert held / tried > 0.8
    assert result.fit.intervals["gain"][1] < 1.1 * TRUTH.gain, "wide intervals hold everything"


def test_no_excitation_is_said() -> None:
    result = found(amplitude=5.0)
    assert result.level == "none" and result.fit is None
    assert "no excitation: the throttle was swept by 2.5 % of its travel" in result.reasons[0]


def test_speed_that_hardly_moves_is_said() -> None:
    run = driven()
    flat = replace(run, speed=Signal(run.speed.t, 2.0 + 0.01 * np.sin(run.speed.t), "m/s"))
    result = identify_speed([flat])
    assert result.level == "none" and "the speed changed by 0.02 m/s" in result.reasons[0]


def test_speed_from_elsewhere_has_low_coherence() -> None:
    result = found(other=0.5)
    assert result.level == "poor" and "low coherence" in result.reasons[0]


def test_stopped_sweep_is_acceptable_at_best() -> None:
    result = identify_speed([replace(driven(), stopped="SWP: run 1 stopped: speed 4.1 > 4 m/s")])
    assert result.level == "acceptable" and "stopped early" in result.reasons[0]


def test_without_coasting_there_is_no_drag() -> None:
    run = driven()
    result = identify_speed([replace(run, speed=run.speed.between(0, 62.1), pwm=run.pwm.between(0, 62.1))])
    assert result.level == "good" and result.coasting is None


def test_freewheeling_motor_has_no_dead_zone_to_tell() -> None:
    run = driven(noise=0.002)
    t = run.speed.t
    after = t > 62.0 + TRUTH.delay
    start = float(run.speed.x[after][0])
    rolling = np.where(after, start - 0.4 * (t - t[after][0]), run.speed.x)
    result = identify_speed([replace(run, speed=Signal(t, rolling, "m/s"))])
    assert result.coasting is not None and result.coasting.dead_zone is None
    assert result.coasting.deceleration == pytest.approx(0.4, abs=0.05)


def test_noise_of_a_known_colour_is_found() -> None:
    random, share = np.random.default_rng(3), np.exp(-0.04 / 1.5)
    parts = []
    for _ in range(20):
        white = random.standard_normal(1500) * np.sqrt(1 - share**2)
        x = np.empty(1500)
        x[0] = random.standard_normal()
        for k in range(1, 1500):
            x[k] = share * x[k - 1] + white[k]
        parts.append(0.03 * x + 0.01 * random.standard_normal(1500))
    noise = noise_of(parts, 0.04, 4)
    assert noise.coloured == pytest.approx(0.03, rel=0.1)
    assert noise.white == pytest.approx(0.01, rel=0.3)
    assert noise.time == pytest.approx(1.5, rel=0.25)


def test_covariance_times_a_vector_is_that_of_the_matrix() -> None:
    noise, t = SpeedNoise(0.01, 0.03, 1.5), np.arange(40) * 0.04
    lag = np.abs(t[:, None] - t)
    matrix = 0.03**2 * np.exp(-lag / 1.5) + 0.01**2 * np.eye(40)
    x = np.random.default_rng(1).standard_normal((40, 3))
    assert noise.covariance_times(x, 0.04) == pytest.approx(matrix @ x)
