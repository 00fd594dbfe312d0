"""Responses with several inputs: a throttle that moves with the steering and moves the rover too."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.spectra.response import correlated_inputs, frequency_responses, moving
from rover_sweep.spectra.windowed import (
    MANY,
    EvenExponentials,
    Exponentials,
    Transformer,
    effective_averages,
    even_grid,
    hann,
    hann_correlation,
    independent_averages,
    input_spectra,
    sinc_interpolated,
    window_starts,
)

STEP = 0.005
W = np.geomspace(0.7, 20, 60)
WINDOWS = (5.0, 8.0, 12.0, 18.0, 26.0)
LAG, THROTTLE_LAG = 0.15, 0.4


def truth(w: np.ndarray) -> np.ndarray:
    """r per rad of steering: 6 / (LAG s + 1)."""
    return 6 / (1 + 1j * w * LAG)


def throttle_truth(w: np.ndarray) -> np.ndarray:
    """r per us of throttle: 0.004 / (THROTTLE_LAG s + 1)."""
    return 0.004 / (1 + 1j * w * THROTTLE_LAG)


def lagged(x: np.ndarray, lag: float) -> np.ndarray:
    """A first-order lag by the bilinear transform, on a grid 40 times finer than its shortest period."""
    c = 2 * lag / STEP
    return lfilter([1, 1], [1 + c, 1 - c], x)


def shuffled(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A signal of the same spectrum and random phases."""
    spectrum = np.fft.rfft(x)
    return np.fft.irfft(np.abs(spectrum) * np.exp(2j * np.pi * rng.uniform(size=spectrum.size)), x.size)


def two_input_run(
    seed: int, share: float = 0.5, noise: float = 0.02, amplitude: float = 150.0, t_rec: float = 80.0
) -> Recording:
    """A steering sweep with a throttle of which `share` (of its power) follows the steering."""
    rng = np.random.default_rng(seed)
    sweep = Sweep(amplitude=amplitude, t_rec=t_rec)
    t = np.arange(int(sweep.duration / STEP)) * STEP
    delta = sweep.wave(t) * 1e-3
    throttle = 1000 * (np.sqrt(share) * delta + np.sqrt(1 - share) * shuffled(delta, rng))
    r = 6 * lagged(delta, LAG) + 0.004 * lagged(throttle, THROTTLE_LAG)
    channels = {
        "delta": Signal(t, delta, "rad"),
        "throttle": Signal(t, 1600 + throttle, "us"),
        "r": Signal(t, r + noise * rng.standard_normal(t.size), "rad/s"),
    }
    return Recording(f"two inputs {seed}", channels, (0.0, float(t[-1])))


def errors(h: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Largest error in dB and in deg."""
    ratio = h / true
    return np.max(np.abs(20 * np.log10(np.abs(ratio)))), np.max(np.abs(np.degrees(np.angle(ratio))))


@pytest.fixture(scope="module")
def runs() -> list[Recording]:
    return [two_input_run(1), two_input_run(2)]


@pytest.fixture(scope="module")
def found(runs):
    return frequency_responses(runs, ["r"], W, WINDOWS, ("delta", "throttle"))


def test_the_conditioned_response_is_true_where_the_plain_one_is_not(runs, found):
    conditioned, plain = found["delta"]["r"], frequency_responses(runs, ["r"], W, WINDOWS)["delta"]["r"]
    assert np.mean(conditioned.input_coherence) == pytest.approx(0.5, abs=0.1)
    db, deg = errors(conditioned.h, truth(W))
    assert db < 0.5 and deg < 5
    db, deg = errors(plain.h, truth(W))
    assert db > 2 and deg > 5


def test_the_other_input_has_its_response_too(found):
    response = found["throttle"]["r"]
    assert response.unit == "rad/s per us" and response.conditioned_on == ("delta",)
    db, deg = errors(response.h, throttle_truth(W))
    assert db < 0.6 and deg < 5


def test_coherences_hang_together(found):
    """1 - multiple = (1 - ordinary with the other input)(1 - partial), which needs Gyy conditioned."""
    response = found["delta"]["r"]
    assert response.conditioned_on == ("throttle",)
    assert np.all(response.multiple_coherence >= response.coherence - 1e-3)
    assert np.min(response.multiple_coherence) > 0.99


def three_inputs(
    rng: np.random.Generator, n: int = 4000, noise: float = 2.0
) -> tuple[dict[str, Signal], tuple[float, float]]:
    """y = x + u/2 - v/1000 + noise of inputs that are correlated in a chain, sampled at 50 Hz."""
    t = np.arange(n) * 0.02
    a, b, c = rng.standard_normal((3, n))
    x = {"x": a, "u": a + b, "v": 1e3 * (b + c)}
    y = x["x"] + 0.5 * x["u"] - 1e-3 * x["v"] + noise * rng.standard_normal(n)
    return {k: Signal(t, s, "") for k, s in {**x, "y": y}.items()}, (0.0, float(t[-1]))


def test_conditioning_is_the_element_of_the_inverse():
    channels, span = three_inputs(np.random.default_rng(0))
    w = np.geomspace(4, 40, 9)
    (s,) = input_spectra([channels], [span], ("x", "u", "v"), ("y",), [4.0], w)
    h = np.array([np.linalg.solve(s.gxx[k], s.gxy["y"][k]) for k in range(w.size)])
    assert s.responses("y") == pytest.approx(h)
    for k, name in enumerate(s.inputs):
        part = s.conditioned(name, "y")
        assert part.gxy / part.gxx == pytest.approx(h[:, k])
        others = tuple(n for n in s.inputs if n != name)
        (rest,) = input_spectra([channels], [span], others, ("y",), [4.0], w)
        unexplained = (1 - rest.multiple_coherence("y")) * (1 - part.coherence)
        assert 1 - s.multiple_coherence("y") == pytest.approx(unexplained)
        assert part.averages == pytest.approx(effective_averages([span], 4.0) - 2 * 0.5)


def test_a_still_throttle_is_no_input(runs):
    still = [replace(r, channels={**r.channels, "throttle": _constant(r["throttle"])}) for r in runs]
    assert moving(runs, "throttle") and not moving(still, "throttle")


def _constant(s: Signal) -> Signal:
    return replace(s, x=np.full(s.x.size, 1600.0))


def test_inputs_that_move_as_one_are_told():
    run = two_input_run(3, share=0.97)
    response = frequency_responses([run], ["r"], W, WINDOWS[:3], ("delta", "throttle"))["delta"]["r"]
    assert "throttle moves with the steering" in (correlated_inputs(response) or "")


def test_each_input_costs_an_average(runs):
    w = np.geomspace(2 * np.pi / 60, 20, 10)
    channels = {k: runs[0].manoeuvre(k) for k in ("delta", "throttle", "r")}
    channels |= dict.fromkeys(("wind", "slope"), channels["throttle"])
    with pytest.raises(ValueError, match="are too short for 4 inputs"):
        input_spectra([channels], [runs[0].span], ("delta", "throttle", "wind", "slope"), ("r",), [60.0], w)


# ---- Spectra at thousands of frequencies equal the direct sums; averages are counted as they are.


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
    """White noise, 200 draws: the variance of a mean power is its square over the number of averages.

    T_F/T_win would count 15 s in 20 s as 2.7 averages (with its constant at 80 % overlap).
    """
    rng, t, lengths = np.random.default_rng(4), np.arange(0, 20, 0.05), (2.0, 10.0, 15.0)
    transform = Transformer(0.0, 20.0, lengths, np.linspace(6, 40, 12))
    noise = [transform(Signal(t, rng.standard_normal(t.size), "")) for _ in range(200)]
    for k, length in enumerate(lengths):
        power = np.array([np.mean(np.abs(parts[k]) ** 2, axis=0) for parts in noise])
        scatter = np.mean(np.mean(power, axis=0) ** 2 / np.var(power, axis=0))
        counted = independent_averages([window_starts(0.0, 20.0, length)], length)
        assert counted == pytest.approx(scatter, rel=0.15)
    two_runs = independent_averages([window_starts(0.0, 20.0, 15.0)] * 2, 15.0)
    assert two_runs == pytest.approx(2 * counted)
