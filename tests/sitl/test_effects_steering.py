"""Effects between command and road wheel, against their definitions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import exp, pi, sin

import numpy as np
import pytest

from sitl.plant.servo import Servo
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")
QUICK = replace(NOMINAL, servo_lag=0.0, servo_delay=0.0, servo_rate_limit=1e6)
DT = 0.0025


def servo(effects: Mapping[str, Mapping[str, float]], quick: bool = True) -> Servo:
    return Servo(replace(QUICK if quick else NOMINAL, effects=effects))


def held(servo: Servo, u: float, seconds: float = 1.0, t: float = 0.0) -> float:
    """Road-wheel angle after u [rad] was commanded for a while."""
    for k in range(round(seconds / DT)):
        servo.command(1500 - u / NOMINAL.rad_per_us, t + k * DT)
        servo.advance(t + k * DT, t + (k + 1) * DT)
    return servo.angle


@pytest.mark.parametrize("u", [-0.3, -0.1, 0.05, 0.2])
def test_static_curves(u: float) -> None:
    assert held(servo({"steering_nonlinearity": {"c3": 2.0}}), u) == pytest.approx(u * (1 + 2 * u * u))
    side = 1.1 if u > 0 else 0.9
    assert held(servo({"steering_asymmetry": {"e": 0.1}}), u) == pytest.approx(side * u)
    assert held(servo({"steering_trim": {"u0": 0.04}}), u) == pytest.approx(u - 0.04)


def test_trim_is_there_before_the_first_pulse() -> None:
    assert held(servo({"steering_trim": {"u0": 0.04}}, quick=False), 0.0, 0.1) == pytest.approx(-0.04)


@pytest.mark.parametrize("quick", [True, False])
def test_backlash_is_the_play_operator(quick: bool) -> None:
    """Against the recursion on the servo's own motion without play."""
    loose, tight = servo({"steering_backlash": {"b": 0.012}}, quick), servo({}, quick)
    wheel, rows = 0.0, []
    for k in range(2000):
        u = 0.1 * sin(6 * k * DT) + 0.05 * sin(17 * k * DT)
        for s in (loose, tight):
            s.command(1500 - u / NOMINAL.rad_per_us, k * DT)
            s.advance(k * DT, (k + 1) * DT)
        wheel = min(max(wheel, tight.angle - 0.012), tight.angle + 0.012)
        rows.append((loose.angle, wheel, tight.angle))
    found, wanted, without = np.array(rows).T
    assert found == pytest.approx(wanted, abs=5e-4 if not quick else 1e-12)
    assert np.max(np.abs(found - without)) == pytest.approx(0.012, rel=1e-6)


def test_deadband_stops_short_of_the_target_from_either_side() -> None:
    s = servo({"steering_deadband": {"w": 0.02}}, quick=False)
    assert held(s, 0.015) == 0.0
    assert held(s, 0.2, t=1.0) == pytest.approx(0.18)
    assert held(s, 0.19, t=2.0) == pytest.approx(0.18)
    assert held(s, 0.1, t=3.0) == pytest.approx(0.12)


def test_deadband_lags_on_what_is_left_of_the_error() -> None:
    s = Servo(
        replace(NOMINAL, servo_delay=0.0, servo_rate_limit=1e6, effects={"steering_deadband": {"w": 0.02}})
    )
    s.command(1500 - 0.2 / NOMINAL.rad_per_us, 0.0)
    assert s.advance(0.0, 0.03) == pytest.approx(0.18 * (1 - exp(-0.03 / NOMINAL.servo_lag)))


def test_backlash_gain_and_phase_of_a_sine() -> None:
    """The describing function of play of half width b: (Gelb, Vander Velde 1968, table of nonlinearities)."""
    amplitude, b, w, n = 0.1, 0.02, 2 * pi, 4000
    s = servo({"steering_backlash": {"b": b}})
    rows = []
    for k in range(3 * n):
        s.command(1500 - amplitude * sin(2 * pi * k / n) / NOMINAL.rad_per_us, k / n)
        rows.append(s.advance(k / n, (k + 1) / n))
    turn = np.exp(-1j * w * np.arange(n) / n)
    found = 2j * np.mean(np.array(rows[-n:]) * turn) / amplitude
    share = 1 - 2 * b / amplitude
    real = (pi / 2 + np.arcsin(share) + share * np.sqrt(1 - share * share)) / pi
    imaginary = -4 * b / (pi * amplitude) * (1 - b / amplitude)
    assert found == pytest.approx(real + 1j * imaginary, abs=2e-3)


def test_full_travel_and_the_quadratic_curve() -> None:
    dead = {"steering_deadband": {"w": 0.02, "of": "command", "form": "full travel"}}
    assert held(servo(dead), 0.019) == 0.0
    assert held(servo(dead), -0.03) == pytest.approx(-0.03)
    bent = {"steering_nonlinearity": {"c3": 2.0, "form": "quadratic"}}
    assert held(servo(bent), -0.1) == pytest.approx(-0.1 * (1 + 2 * 0.3 * 0.1))


@pytest.mark.parametrize(
    ("form", "angles"),
    [
        ("no memory", (0.0, 0.03, 0.03, 0.055, 0.055, 0.02)),
        ("with memory", (0.0, 0.03, 0.04, 0.055, 0.055, 0.02)),
    ],
)
def test_stiction_holds_and_then_goes_all_the_way(form: str, angles: tuple[float, ...]) -> None:
    s = servo({"steering_stiction": {"s": 0.02, "form": form}})
    commanded = (0.015, 0.03, 0.04, 0.055, 0.045, 0.02)
    found = [held(s, u, 0.1, t=0.1 * k) for k, u in enumerate(commanded)]
    assert found == pytest.approx(angles)


def test_smooth_hysteresis_approaches_the_play_it_is_named_after() -> None:
    s = servo({"steering_backlash": {"b": 0.01, "form": "smooth hysteresis"}})
    assert held(s, 0.01) == pytest.approx(0.01 * exp(-1.0))
    assert held(s, 0.2, t=1.0) == pytest.approx(0.19, abs=1e-6)
    assert held(s, -0.2, t=2.0) == pytest.approx(-0.19, abs=1e-6)


def test_a_servo_of_second_order_overshoots_by_its_damping_and_keeps_its_rate_limit() -> None:
    q, lag = 1.5, 0.05
    damping = 1 / (2 * q**0.5)
    effects = {"servo_lag": {"T": lag, "q": q, "form": "second order"}}
    free = Servo(replace(QUICK, servo_lag=lag, effects=effects))
    free.command(1500 - 0.1 / NOMINAL.rad_per_us, 0.0)
    rows = np.array([free.advance(k * DT, (k + 1) * DT) for k in range(800)])
    assert max(rows) == pytest.approx(0.1 * (1 + exp(-pi * damping / (1 - damping**2) ** 0.5)), rel=2e-3)
    assert rows[-1] == pytest.approx(0.1, rel=1e-6)
    slow = Servo(replace(QUICK, servo_lag=lag, servo_rate_limit=0.2, effects=effects))
    slow.command(1500 - 0.1 / NOMINAL.rad_per_us, 0.0)
    rates = np.diff([slow.advance(k * DT, (k + 1) * DT) for k in range(800)]) / DT
    assert max(abs(rates)) == pytest.approx(0.2, rel=1e-6)
