"""The multisine and the sweep about a bias: lines, phases, peak, periodicity, fades, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rover_sweep.manoeuvre.multisine import LEFT_OUT, Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Sweep

CASES = [  # each with a low crest factor
    Multisine(),
    Multisine(t_rec=40, periods=2, w_min=1.0, w_max=12.0),
    Multisine(t_rec=20, periods=5, w_max=40.0),
    Multisine(t_rec=30, periods=4, w_min=2.5, w_max=32.0, fade=0, dwell=0, straight=0),
]


@pytest.mark.parametrize("m", CASES)
def test_lines_are_odd_within_the_band_and_apart_from_those_left_out(m: Multisine) -> None:
    assert np.all(m.lines % 2 == 1) and np.all(m.odd_left_out % 2 == 1) and np.all(m.even % 2 == 0)
    assert not set(m.lines) & set(m.odd_left_out)
    assert sorted({*m.lines, *m.odd_left_out}) == list(m.odd)
    assert m.w_min <= m.base * m.odd[0] < m.w_min + 2 * m.base
    assert m.w_max >= m.base * m.odd[-1] > m.w_max - 2 * m.base
    assert m.lines[0] == m.odd[0]
    assert m.odd_left_out.size == pytest.approx(m.odd.size / 4, abs=1)
    assert np.all(np.diff(m.odd_left_out) > 2)  # no two neighbours: no wide gap in the excitation


@pytest.mark.parametrize("m", CASES)
def test_wave_repeats_itself_and_holds_its_lines_alone(m: Multisine) -> None:
    period = m.t_rec / m.periods
    size = 64 * int(m.lines[-1])
    x = m.wave(m.law_start + np.arange(m.periods * size) * period / size)
    np.testing.assert_allclose(x[:size], x[-size:], atol=1e-8)
    np.testing.assert_allclose(x[: size // 2], -x[size // 2 : size], atol=1e-8)
    lines = 2 * np.abs(np.fft.rfft(x[:size])) / size
    np.testing.assert_allclose(lines[m.lines], m.line_amplitude, rtol=1e-9)
    lines[m.lines] = 0
    assert lines.max() < 1e-9
    assert 0.999 * m.amplitude <= np.abs(x).max() <= 1.02 * m.amplitude
    assert m.crest_factor == pytest.approx(np.abs(x).max() / np.sqrt(np.mean(x**2)), rel=0.02)
    slew = np.max(np.abs(np.diff(x))) * size / period
    assert m.peak_slew == pytest.approx(slew, rel=0.03)
    assert 2.25 <= m.crest_factor < 2.45
    assert len(LEFT_OUT) == 16 and set(LEFT_OUT) == {1, 2, 3}  # never the lowest of four


def test_fades_and_straight_parts() -> None:
    m = Multisine(amplitude=100)
    t = np.linspace(0, m.duration, 20001)
    x = m.wave(t)
    assert not x[(t < 3) | (t > m.duration - 3)].any()
    full = Multisine(amplitude=100, fade=0, dwell=4).wave(t)  # its law begins at the same time
    ramp = np.clip(np.minimum(t - 3, m.duration - 3 - t) / 2, 0, 1)
    common = t < m.duration - 5.001
    np.testing.assert_allclose(x[common], (ramp * full)[common], atol=1e-9)
    out = (t > m.duration - 5) & (t < m.duration - 3)
    assert np.all(np.abs(x[out]) <= 1.02 * 100 * ramp[out])
    assert m.duration == 67 and m.law_start == 7


IMPOSSIBLE: list[tuple[dict[str, Any], str]] = [
    ({"periods": 1}, "2, 3 .. whole periods"),
    ({"periods": 2.5}, "2, 3 .. whole periods"),
    ({"t_rec": 5}, "contain 3 odd lines of 3.77 rad/s"),
    ({"t_rec": 600}, "contain 393 odd lines"),
    ({"t_rec": 1e15}, "contain 6.55188e.14 odd lines"),  # more than memory holds
    ({"w_min": 30}, "w_min 30 and w_max 25"),
    ({"t_rec": 0}, "need t_rec > 0"),
    ({"amplitude": -1}, "amplitude > 0"),
    ({"fade": -1}, "must not be negative"),
]


def test_impossible_ones_are_refused() -> None:
    for numbers, said in IMPOSSIBLE:
        with pytest.raises(ValueError, match=said):
            Multisine(**numbers)


def test_bias_sweep_is_the_sweep_and_the_bias_under_one_envelope() -> None:
    sweep, biased = Sweep(amplitude=80), BiasSweep(amplitude=80, bias=-120)
    t = np.linspace(0, sweep.duration, 5001)
    ramp = np.clip(np.minimum(t - 3, sweep.duration - 3 - t) / 2, 0, 1)
    np.testing.assert_allclose(biased.wave(t), sweep.wave(t) - 120 * ramp, atol=1e-9)
    assert (biased.peak, sweep.peak, biased.middle, biased.kind) == (200, 80, -120, "bias_sweep")
    assert biased.duration == sweep.duration and isinstance(biased, Sweep)
