"""Spectra at thousands of frequencies equal the direct sums; averages are counted as they are."""

import numpy as np
import pytest

from rover_sweep.data.recording import Signal
from rover_sweep.spectra.windowed import (
    MANY,
    EvenExponentials,
    Exponentials,
    Transformer,
    even_grid,
    hann,
    hann_correlation,
    independent_averages,
    input_spectra,
    sinc_interpolated,
    window_starts,
)


def uneven(seed: int = 0, n: int = 2500) -> dict[str, Signal]:
    """60 s of coloured noise and its delayed copy, sampled 5-45 ms apart."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.005, 0.045, n))
    w = rng.uniform(0.1, 40, 300)
    phase = rng.uniform(0, 2 * np.pi, w.size)

    def wave(at: np.ndarray) -> np.ndarray:
        return np.cos(np.outer(at, w) + phase) @ (1 / w)

    return {"delta": Signal(t, wave(t), "rad"), "r": Signal(t, wave(t - 0.05) + 0.01 * wave(2 * t), "rad/s")}


def test_products_of_exponentials_are_the_direct_sum():
    t = np.sort(np.random.default_rng(1).uniform(100, 160, 700))
    w = np.linspace(0.7, 33, 1003)
    x = np.sin(t**1.5)
    direct, even = (kind(t, w).sum(40, 650, x[40:650]) for kind in (Exponentials, EvenExponentials))
    assert direct == pytest.approx(np.exp(-1j * np.outer(w, t[40:650])) @ x[40:650], abs=1e-9)
    assert even == pytest.approx(direct, abs=1e-9)


@pytest.mark.parametrize("spaced", [np.linspace, np.geomspace])
def test_many_frequencies_equal_the_direct_sums(spaced):
    """Each average over windows, written out again at every 50th frequency, to 1e-6."""
    channels = uneven()
    span = (float(channels["r"].t[0]), float(channels["r"].t[-1]))
    lengths, w = (3.0, 8.0, 25.0), spaced(0.8, 35.0, 2 * MANY)
    fast = [
        s.conditioned("delta", "r") for s in input_spectra([channels], [span], ["delta"], ["r"], lengths, w)
    ]
    some = w[np.r_[0 : w.size : 50, w.size - 1]]
    direct = [
        s.conditioned("delta", "r")
        for s in input_spectra([channels], [span], ["delta"], ["r"], lengths, some)
    ]
    assert some.size < MANY <= w.size
    for a, b in zip(fast, direct, strict=True):
        seen = np.isfinite(b.gxx)
        for name in ("gxx", "gyy", "gxy"):
            ours, sums = getattr(a, name)[np.searchsorted(w, some)], getattr(b, name)
            assert np.array_equal(np.isfinite(ours), seen)
            assert ours[seen] == pytest.approx(sums[seen], rel=1e-6)
            assert a.averages == b.averages


def test_between_is_exact_up_to_the_longest_lag():
    """The transform of a correlation that lives within +-T, from the grid of T."""
    length, w = 4.0, np.sort(np.random.default_rng(2).uniform(1, 30, 400))
    grid = even_grid(w, length)
    lags = np.linspace(-length, length, 41)
    r = np.random.default_rng(3).standard_normal(lags.size)

    def exact(at: np.ndarray) -> np.ndarray:
        return np.exp(-1j * np.outer(at, lags)) @ r

    assert sinc_interpolated(grid, exact(grid), w) == pytest.approx(exact(w), abs=1e-6)


def test_correlation_of_moved_windows():
    u = np.linspace(0, 1, 20001)
    for shift in (0.0, 0.2, 0.5, 0.9, 1.5):
        moved = np.mean(hann(u) * hann(u + shift)) / np.mean(hann(u) ** 2)
        assert hann_correlation(np.array([shift, -shift])) == pytest.approx(moved, abs=1e-4)


def test_averages_are_those_of_the_scatter():
    """White noise, 400 draws: the variance of a mean power is its square over the number of averages.

    T_F/T_win would count 15 s in 20 s as 2.7 averages (with its constant at 80 % overlap).
    """
    rng, t, lengths = np.random.default_rng(4), np.arange(0, 20, 0.05), (2.0, 10.0, 15.0)
    transform = Transformer(0.0, 20.0, lengths, np.linspace(6, 40, 12))
    noise = [transform(Signal(t, rng.standard_normal(t.size), "")) for _ in range(400)]
    for k, length in enumerate(lengths):
        power = np.array([np.mean(np.abs(parts[k]) ** 2, axis=0) for parts in noise])
        scatter = np.mean(np.mean(power, axis=0) ** 2 / np.var(power, axis=0))
        counted = independent_averages([window_starts(0.0, 20.0, length)], length)
        assert counted == pytest.approx(scatter, rel=0.12)
    two_runs = independent_averages([window_starts(0.0, 20.0, 15.0)] * 2, 15.0)
    assert two_runs == pytest.approx(2 * counted)
