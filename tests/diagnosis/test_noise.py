"""What counts as noise: the floor of any driving, runs too short for one, an error of the speed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from planted import MODEL, NOISE, X, sweeps
from scipy.signal import lfilter, savgol_filter

from rover_sweep.data.recording import LowPass
from rover_sweep.diagnosis.diagnose import _refuse_without_floor
from rover_sweep.diagnosis.posterior.infer import Options, infer
from rover_sweep.diagnosis.problem.noise_floor import LEAST, Floor, floor_of, has_floor
from rover_sweep.diagnosis.problem.residuals import with_floor
from rover_sweep.diagnosis.simulation.experiment import RATE, SPEED_ERROR, STEADIED, Experiment, tapered
from rover_sweep.diagnosis.simulation.simulator import logged, motion
from rover_sweep.diagnosis.unexplained import left_unexplained
from rover_sweep.errors import DataRefused

DENSITY = 2e-5  # (rad/s)^2/Hz
Made = list[tuple[Experiment, dict[str, np.ndarray]]]


@cache
def by_hand(runs: int, seconds: float = 20.0, smooth: bool = False) -> Made:
    """Runs at 50 Hz in which no line below 5 Hz is quiet, and their residuals: noise, a wrong gain, a lag."""
    found = []
    for seed in range(runs):
        random = np.random.default_rng(seed)
        t = np.arange(0, seconds, 1 / RATE)
        knots = np.cumsum(random.uniform(0.15, 0.5, 400))
        steer = np.interp(t, knots, 0.2 * random.uniform(-1, 1, knots.size))
        slow = np.arange(0, seconds + 0.1, 0.02)
        noise = np.sqrt(DENSITY * 25) * random.standard_normal(slow.size)
        response = lfilter([0.1], [1, -0.9], 0.6 * np.interp(slow, t, steer))
        r = 3 * np.interp(slow, t, steer) + response + noise
        measured = {"r": np.interp(t, slow, savgol_filter(r, 17, 2) if smooth else r)}
        run = Experiment(
            "by hand", "other", t, steer, np.full(t.size, 2.0), np.zeros(t.size), measured, {}, {},
            tapered(t.size), {"r": 50.0}, steer_rate=50.0,
        )  # fmt: skip
        found.append((run, {"r": measured["r"] - 3 * steer}))
    return found


def floor(made: Made) -> Floor:
    return floor_of([run for run, _ in made], [rest for _, rest in made])


@pytest.mark.parametrize(("runs", "seconds"), [(6, 20.0), (25, 3.0)])
def test_noise_is_told_from_a_response_without_a_quiet_line(runs: int, seconds: float) -> None:
    made = by_hand(runs, seconds)
    found = np.median(floor(made).at("r", np.linspace(1.0, 4.0, 20)))
    assert 0.6 * DENSITY < found < 1.5 * DENSITY
    assert has_floor([run for run, _ in made])
    assert not floor(made).top, "unsmoothed noise limits no line"


def test_smoothing_does_not_take_the_floor_away() -> None:
    made = by_hand(6, smooth=True)
    found = floor(made)
    assert found.at("r", np.array([9.0]))[0] >= 0.2 * found.at("r", np.array([2.0]))[0]
    assert 3.0 < found.top["r"] < 12.0
    assert np.max(with_floor([made[0][0]], found).rows[0].f) <= found.top["r"]
    known = [(replace(run, filters={"r": LowPass(4.0)}), rest) for run, rest in made]
    assert not floor(known).top, "a known filter is taken as it is"


def test_no_floor_is_below_that_of_a_sensor() -> None:
    """A simulator's roll rate of nothing at all gave 1e10 times the noise."""
    run, _ = by_hand(1)[0]
    run = replace(run, measured={**run.measured, "p": np.zeros(run.t.size)})
    still = floor([(run, {"r": np.zeros(run.t.size), "p": np.full(run.t.size, 1e-12)})])
    assert np.all(still.density["p"] >= LEAST["p"]) and np.all(still.density["r"] >= LEAST["r"])


def test_a_run_of_three_seconds_is_refused() -> None:
    whole, few = sweeps()[0], int(3 * RATE)
    _refuse_without_floor([whole])
    short = replace(whole, t=whole.t[:few], steer=whole.steer[:few], commanded=None)
    with pytest.raises(DataRefused, match="too short to find their noise floor: the longest has 3.0 s"):
        _refuse_without_floor([short])


@pytest.mark.slow
def test_a_finding_is_not_withdrawn_for_noise_that_grows_with_the_motion() -> None:
    """Dry friction holds the body still where the steering is quiet."""
    effect, torque = "suspension_friction", 0.02
    random, rubbed, runs = np.random.default_rng(4), replace(MODEL, effects=(effect,)), []
    for run in sweeps():
        driven = logged(run, rubbed, {**X, f"{effect}.T": torque})
        rolling = np.convolve(np.abs(driven["p"]), np.full(200, 0.005), "same")
        noise = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        noise["p"] *= np.where(rolling > 0.3 * rolling.max(), 2.0, 1.0)
        runs.append(replace(run, measured={c: y + noise[c] for c, y in driven.items()}))
    found = infer(runs, MODEL, X, Options((effect,), (), lambda what, share: None, lambda: False))
    assert [n.law.id for n in found.named] == [effect]
    assert found.last.fitted.x[f"{effect}.T"] == pytest.approx(torque, rel=0.15)
    assert 1.45 < found.last.misfit["p"] < 1.8
    assert left_unexplained(found, True) is not None  # more than the noise where the body is still


# ---- An error of the measured speed is no physics, although it multiplies the motion.


def wavy(height: float) -> Experiment:
    """A run of 1.4 m/s with a wave of half a hertz in its speed."""
    run = sweeps()[2]
    return replace(run, speed=run.speed + height * np.sin(np.pi * run.t))


INNER = slice(int(STEADIED * RATE), -int(STEADIED * RATE))


def test_only_small_changes_of_the_speed_are_unsure() -> None:
    small, large = wavy(SPEED_ERROR), wavy(20 * SPEED_ERROR)
    assert np.std(small.unsure[INNER]) == pytest.approx(SPEED_ERROR / np.sqrt(2), rel=0.02)
    assert np.std(large.unsure[INNER]) < 0.1 * np.std(large.speed[INNER])


def test_what_turns_take_from_the_speed_is_sure() -> None:
    """A drive with another lag and drag than any basis function, beside an error of the estimate."""
    run = sweeps()[0]
    drag, keep = run.measured["r"] * run.steer, np.exp(-1.0 / (RATE * 0.45))
    loss = -lfilter([1.0 - keep], [1.0, -keep], drag)
    loss *= 1.5 * SPEED_ERROR / np.std(loss)
    error = SPEED_ERROR * np.sin(0.9 * np.pi * run.t)
    found = replace(run, speed=run.speed + loss + error).unsure
    left = [abs(np.corrcoef(x[INNER], found[INNER])[0, 1]) for x in (loss, error)]
    assert left[0] < 0.2 and left[1] > 0.95


def test_a_model_takes_a_share_of_the_unsure_changes() -> None:
    run = wavy(SPEED_ERROR)
    measured, without, half = (motion(run, MODEL, {**X, "speed_share": s}) for s in (1.0, 0.0, 0.5))
    np.testing.assert_allclose(measured["V"] - without["V"], run.unsure, atol=1e-12)
    np.testing.assert_allclose(half["V"], run.speed - 0.5 * run.unsure)
    np.testing.assert_allclose(half["v_dot_x"], np.gradient(half["V"], 1.0 / RATE), atol=1e-12)
    steady = motion(run.steadied(0.5), MODEL, {**X, "speed_share": 0.5})
    np.testing.assert_allclose(steady["V"], without["V"])
