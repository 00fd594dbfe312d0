"""Tyre law: slope, limit, symmetry, standstill."""

from __future__ import annotations

from math import atan, radians

import pytest

from sitl.plant.tyre import LOW_SPEED, lateral_force, slip_angle


def test_slope_at_zero_slip_is_the_cornering_stiffness() -> None:
    assert lateral_force(1e-6, 31.0, 11.0, 1.3) == pytest.approx(-31.0e-6, rel=1e-6)


def test_saturates_at_the_peak_and_is_odd() -> None:
    forces = [lateral_force(radians(a), 31.0, 11.0, 1.3) for a in range(0, 91)]
    assert min(forces) >= -11.0
    assert min(forces) == pytest.approx(-11.0, rel=1e-3)
    assert lateral_force(-0.1, 31.0, 11.0, 1.3) == -lateral_force(0.1, 31.0, 11.0, 1.3)


def test_saturation_is_mild_at_small_slip() -> None:
    """At a quarter of the peak the loss is about 2 %."""
    slip = 0.25 * 11.0 / 31.0
    assert 0.97 < -lateral_force(slip, 31.0, 11.0, 1.3) / (31.0 * slip) < 0.985


def test_slip_angle_is_exact_when_rolling_and_zero_at_rest() -> None:
    assert slip_angle(2.0, 0.1) == pytest.approx(atan(0.05))
    assert slip_angle(-2.0, 0.1) == pytest.approx(atan(0.05)), "going back, the force still opposes the slide"
    assert slip_angle(0.0, 0.0) == 0
    assert slip_angle(0.0, 0.03) == pytest.approx(atan(0.03 / LOW_SPEED))
