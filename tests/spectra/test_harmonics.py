"""Levels at even and left-out odd lines: exact on a known distortion, silent without one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.spectra.harmonics import Harmonics, harmonics, law_start

M = Multisine(amplitude=200, t_rec=40, periods=4, w_min=0.5, w_max=16)
BEGIN = 12.34  # s at which the override begins
T, TAU = np.arange(0.0, 80.0, 0.005), 0.1


def plain(x: Array) -> Array:
    return x


def square(x: Array) -> Array:
    return np.asarray(x + 0.1 * x**2)


def cube(x: Array) -> Array:
    return np.asarray(x + 0.1 * x**3)


def lagged(x: Array) -> Array:
    """First-order lag of TAU s on the clock T."""
    y, keep = np.empty_like(x), np.exp(-(T[1] - T[0]) / TAU)
    y[0] = x[0]
    for k in range(1, x.size):
        y[k] = keep * y[k - 1] + (1 - keep) * x[k]
    return y


def recorded(
    distort: Callable[[Array], Array],
    noise: float = 0.002,
    seed: int = 1,
    rate: float = 50.0,
    drift: float = 0.0,
) -> Recording:
    """A lag behind (or before) a static distortion of the wave over its amplitude, on uneven time stamps."""
    rng = np.random.default_rng(seed)
    y = lagged(distort(M.wave(T - BEGIN) / M.amplitude)) + drift * T
    t = np.arange(1.0, 79.0, 1 / rate)
    t = t + rng.uniform(-0.2, 0.2, t.size) / rate
    coloured = np.convolve(rng.standard_normal(t.size + 9), 0.8 ** np.arange(10), "valid")
    steps = np.arange(0.5, 79.5, 1 / 85)
    channels = {
        "pwm": Signal(steps, np.round(1500 + M.wave(steps - BEGIN)), "us", "RCOU.C1", hold=True),
        "r": Signal(t, np.interp(t, T, y) + noise * coloured, "rad/s", "IMU.GyrZ"),
    }
    return Recording("made", channels, (BEGIN, BEGIN + M.duration), kind="multisine")


def true_levels(distort: Callable[[Array], Array]) -> tuple[float, float]:
    """(even, odd) over excited [dB] of one period of the distorted wave behind the lag, without noise."""
    size = 64 * int(M.lines[-1])
    x = M.wave(M.law_start + np.arange(size) * M.t_rec / M.periods / size) / M.amplitude
    k = np.arange(size // 2 + 1)
    power = np.abs(np.fft.rfft(distort(x)) / (1 + 1j * k * M.base * TAU)) ** 2
    excited, even, odd = (np.mean(power[lines]) for lines in (M.lines, M.even, M.odd_left_out))
    return 10 * np.log10(even / excited), 10 * np.log10(odd / excited)


def found(run: Recording) -> Harmonics:
    return harmonics(run, M)


def test_square_shows_at_even_lines_alone() -> None:
    r = found(recorded(square))["r"]
    assert r.second == pytest.approx(true_levels(square)[0], abs=0.5) and r.second_detected
    assert not r.third_detected and r.third < r.second - 10


def test_cube_shows_at_odd_lines_left_out_alone() -> None:
    r = found(recorded(cube))["r"]
    assert r.third == pytest.approx(true_levels(cube)[1], abs=0.5) and r.third_detected
    assert not r.second_detected and r.second < r.third - 6


@pytest.mark.parametrize("rate", [10.0, 50.0, 400.0])
def test_levels_do_not_depend_on_the_rate(rate: float) -> None:
    """At 10 Hz up to .7 of the Nyquist frequency, 22 rad/s, so the whole band."""
    run = found(recorded(square, noise=0.0005, rate=rate))
    assert run["r"].second == pytest.approx(true_levels(square)[0], abs=0.7)
    assert run.start == pytest.approx(BEGIN + M.law_start, abs=0.02)


def test_linear_rover_shows_neither_and_the_noise_is_the_noise() -> None:
    seen, noise = [], []
    for seed in range(20):
        r = found(recorded(plain, noise=0.02, seed=seed, drift=0.01))["r"]  # nor is a drift a harmonic
        seen += [r.even_chance < 0.05, r.odd_chance < 0.05]
        noise.append(r.db(r.even) - r.db(r.between))
    assert np.mean(seen) < 0.15  # 5 % of 40, and 6 of them by chance 3 times in 100
    assert abs(np.mean(noise)) < 0.5


def test_steering_itself_holds_hardly_any() -> None:
    pwm = found(recorded(plain))["pwm"]
    assert pwm.second < -40 and pwm.third < -40 and pwm.noise < -40
    assert pwm.db(pwm.excited) == pytest.approx(20 * np.log10(M.line_amplitude / np.sqrt(2)), abs=0.3)


def test_table_stars_what_is_seen() -> None:
    table = found(recorded(square)).table()
    (row,) = [row for row in table.rows if row[0] == "r"]
    assert row[2].endswith("*") and not row[3].endswith("*")


def test_other_steering_and_part_of_a_run_are_refused() -> None:
    with pytest.raises(DataRefused, match="the steering is not this multisine"):
        law_start(recorded(plain), Multisine(amplitude=200, t_rec=40, periods=2, w_min=0.5, w_max=16))
    run = recorded(plain)
    short = {"pwm": run["pwm"], "r": run["r"].between(0.0, 40.0)}
    with pytest.raises(DataRefused, match="r was not recorded over the whole"):
        harmonics(Recording("cut", short, run.span), M)
