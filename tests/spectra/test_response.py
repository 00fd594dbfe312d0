"""Spectra, composite windows and bands."""

import numpy as np
import pytest
from scipy.optimize import minimize

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.spectra.response import composite, frequency_responses, usable_band
from rover_sweep.spectra.windowed import WindowSpectra, input_spectra, window_starts

W = np.geomspace(1.3, 20, 40)


def noise_run(
    seed: int, n: int = 6000, jitter: float = 0.0, gain: float = 2.0, lag: float = 0.03
) -> Recording:
    """White noise below 40 rad/s and its delayed, scaled copy, on (un)even stamps, with output noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * 0.01
    if jitter:
        t = np.sort(t + rng.uniform(-jitter, jitter, n) * 0.01)
    w = np.linspace(0.1, 40, 800)
    phase = rng.uniform(0, 2 * np.pi, w.size)
    amplitude = rng.rayleigh(size=w.size) / 30

    def wave(at: np.ndarray) -> np.ndarray:
        return np.cos(np.outer(at, w) + phase) @ amplitude

    y = gain * wave(t - lag) + 0.05 * rng.standard_normal(n)
    channels = {"delta": Signal(t, wave(t), "rad"), "r": Signal(t, y, "rad/s")}
    return Recording(f"noise {seed}", channels, (t[0], t[-1]))


def test_gain_and_delay_come_back_on_uneven_stamps():
    found = frequency_responses([noise_run(1, jitter=0.45)], ["r"], W, (5, 8, 12))["delta"]["r"]
    assert np.abs(found.h) == pytest.approx(2.0, rel=0.05)
    assert np.angle(found.h * np.exp(1j * W * 0.03)) == pytest.approx(0.0, abs=0.05)


def test_a_staircase_is_taken_as_one():
    """A held PWM delays by half its step; the transform of the staircase knows that."""
    t = np.arange(0, 60, 0.1)
    held = np.sin(0.02 * t**2 + t)
    fine = np.arange(0, 60, 0.005)
    u = held[np.minimum((fine / 0.1 + 1e-9).astype(int), t.size - 1)]
    channels = {"delta": Signal(t, held, "rad", hold=True), "r": Signal(fine, u, "rad/s")}
    w = np.geomspace(1.2, 3.0, 20)
    found = frequency_responses([Recording("stairs", channels, (0, 59.9))], ["r"], w, (6, 10, 15))["delta"][
        "r"
    ]
    assert np.abs(found.h) == pytest.approx(1.0, abs=2e-3)
    assert np.angle(found.h) == pytest.approx(0.0, abs=1e-2)


def test_ten_hertz_samples_keep_their_gain_at_four_hertz():
    """At 4 Hz interpolating a 10 Hz log costs 4.8 dB, holding it 2.4 dB; its own transform costs nothing."""
    fine, coarse = np.arange(0, 60, 0.01), np.arange(0, 60, 0.1)

    def wave(t: np.ndarray) -> np.ndarray:
        return np.sin(12 * t + 0.1 * t**2)

    channels = {"delta": Signal(coarse, wave(coarse), "rad"), "r": Signal(fine, wave(fine), "rad/s")}
    w = np.linspace(20, 23, 8)
    found = frequency_responses([Recording("ten", channels, (0, 59))], ["r"], w, (5, 8))["delta"]["r"]
    assert 20 * np.log10(np.abs(found.h)) == pytest.approx(0.0, abs=0.05)
    assert np.degrees(np.angle(found.h)) == pytest.approx(0.0, abs=0.5)


def test_composite_equals_an_optimiser_at_each_frequency():
    runs = [noise_run(2)]
    channels = [{k: run.manoeuvre(k) for k in ("delta", "r")} for run in runs]
    found = input_spectra(channels, [r.span for r in runs], ["delta"], ["r"], (4, 6, 9, 13), W)
    spectra = [s.conditioned("delta", "r") for s in found]
    gxx, gyy, gxy = composite(spectra)
    for k in (0, 7, 20, 39):
        ours = objective(spectra, k, gxx[k], gyy[k], gxy[k])
        start = [gxx[k], gyy[k], gxy[k].real, gxy[k].imag]
        scale = np.array([gxx[k], gyy[k], abs(gxy[k]), abs(gxy[k])])

        def scaled(z, k=k, scale=scale):
            return objective(spectra, k, z[0] * scale[0], z[1] * scale[1], (z[2] + 1j * z[3]) * scale[2])

        best = minimize(scaled, np.array(start) / scale, method="BFGS", options={"gtol": 1e-12}).fun
        assert ours <= best * (1 + 1e-6) + 1e-12


def objective(spectra: tuple[WindowSpectra, ...], k: int, gxx: float, gyy: float, gxy: complex) -> float:
    """The bracket of Tischler and Remple as `method` states it, written out again."""
    error = np.array([s.random_error[k] for s in spectra])
    weight = (error / np.nanmin(error)) ** -4.0
    weight[~np.isfinite(weight)] = 0.0

    def start(values):
        return np.nansum(weight**2 * np.array(values)) / np.nansum(weight**2)

    xx, yy = start([s.gxx[k] for s in spectra]), start([s.gyy[k] for s in spectra])
    xy = start([s.gxy[k] for s in spectra])
    g2 = abs(xy) ** 2 / (xx * yy)
    total = 0.0
    for s, wt in zip(spectra, weight, strict=True):
        if wt > 0:
            bracket = ((gxx - s.gxx[k]) / xx) ** 2 + ((gyy - s.gyy[k]) / yy) ** 2
            bracket += abs(gxy - s.gxy[k]) ** 2 / abs(xy) ** 2
            bracket += 5 * ((abs(gxy) ** 2 / (gxx * gyy) - s.coherence[k]) / g2) ** 2
            total += wt * bracket
    return total


def test_windows_cover_a_run_without_leaving_it():
    starts = window_starts(3.0, 63.0, 10.0)
    assert starts[0] == 3.0
    assert starts[-1] + 10.0 == pytest.approx(63.0)
    assert np.diff(starts) == pytest.approx(np.diff(starts)[0])
    assert np.diff(starts)[0] <= 0.2 * 10.0 + 1e-9
    assert window_starts(0.0, 9.0, 10.0).size == 0


def test_no_window_crosses_a_seam():
    """Two runs with a step between them: the step shows in neither."""
    a, b = noise_run(3), noise_run(4)
    shifted = {k: Signal(s.t, s.x + 5.0, s.unit) for k, s in b.channels.items()}
    moved = Recording("moved", shifted, b.span)
    h = [frequency_responses([a, x], ["r"], W, (5, 8))["delta"]["r"].h for x in (b, moved)]
    assert h[0] == pytest.approx(h[1], rel=1e-9)


@pytest.mark.parametrize(
    ("poor", "expected"),
    [
        ([], (1.3, 20.0)),
        ([20, 21], (1.3, 20.0)),  # a local drop between good sides
        (list(range(15, 28)), (1.3, 3.5)),  # too wide to be a local drop
        (list(range(40)), None),
    ],
)
def test_usable_band(poor: list[int], expected: tuple[float, float] | None):
    coherence = np.full(40, 0.9)
    coherence[poor] = 0.45
    band = usable_band(W, coherence)
    assert band == (pytest.approx(expected, rel=0.05) if expected else None)
