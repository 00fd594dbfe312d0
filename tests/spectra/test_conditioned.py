"""Responses with several inputs: a throttle that moves with the steering and moves the rover too."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.spectra.response import correlated_inputs, frequency_responses, moving
from rover_sweep.spectra.windowed import effective_averages, input_spectra

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


def test_the_random_error_is_the_scatter_of_the_estimates():
    """Over 80 draws; a partial coherence of a half, and few averages."""
    rng, w, h, error = np.random.default_rng(1), np.geomspace(8, 60, 12), [], []
    for _ in range(80):
        channels, span = three_inputs(rng, 1000, noise=0.6)
        (s,) = input_spectra([channels], [span], ("x", "u", "v"), ("y",), [3.0], w)
        part = s.conditioned("x", "y")
        h.append(part.gxy / part.gxx)
        error.append(part.random_error)
    scatter = np.sqrt(np.mean(np.abs(np.array(h) - 1.0) ** 2) / 2)
    assert np.mean(error) == pytest.approx(scatter, rel=0.15)


def test_no_seam_leaks(runs):
    """A run with other means of steering, throttle and yaw rate: the step between runs has no effect."""
    moved = {
        k: replace(s, x=s.x + 7.0 * (100 if k == "throttle" else 1)) for k, s in runs[1].channels.items()
    }
    other = replace(runs[1], channels=moved)
    kept, shifted = (
        frequency_responses([runs[0], r], ["r"], W, (5.0, 12.0), ("delta", "throttle"))
        for r in (runs[1], other)
    )
    for name in ("delta", "throttle"):
        assert shifted[name]["r"].h == pytest.approx(kept[name]["r"].h, rel=1e-8)
        assert shifted[name]["r"].coherence == pytest.approx(kept[name]["r"].coherence, rel=1e-8)


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
