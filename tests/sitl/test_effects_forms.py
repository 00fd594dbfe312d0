"""Forms of the plant's effects, and effects in body, road and sensors, by their definitions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import atan, cos, exp, pi, sin

import numpy as np
import pytest

from sitl.plant.axles import Axles
from sitl.plant.effects.axle_effects import EffectAxles
from sitl.plant.effects.imu import Delayed, FirstOrder
from sitl.plant.effects.tyres import Stiffness, brush, peaked, yielding
from sitl.plant.plant import Plant
from sitl.plant.road import Road
from sitl.plant.sensors import Sensors
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")
SMOOTH = replace(NOMINAL, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0)
QUIET = replace(
    SMOOTH, gyro_noise=0.0, accel_noise=0.0, vibration=0.0, attitude_error=0.0, velocity_error=0.0
)
DT = 0.0025
Effects = Mapping[str, Mapping[str, float | str]]
MOTION = (2.0, 0.1, 0.5, 0.04, 0.2, 0.1)  # vx, vy, r, phi, p, delta


def axles(effects: Effects) -> EffectAxles:
    return EffectAxles(replace(SMOOTH, effects=effects), Road(SMOOTH, 1))


@pytest.mark.parametrize("slip", [-0.5, -0.05, 0.0, 0.1, 0.3])
def test_tyre_forms(slip: float) -> None:
    stiffness, peak = 60.0, 8.0
    z = stiffness * abs(slip) / peak
    by_brush = peak * (z - z**2 / 3 + z**3 / 27) if z < 3 else peak
    assert brush(slip, stiffness, peak, 1.3) == pytest.approx(-np.sign(slip) * by_brush)
    assert peaked(slip, stiffness, peak, 1.3) == pytest.approx(
        -np.sign(slip) * peak * sin(1.6 * atan(z / 1.6))
    )


def test_only_the_last_form_falls_beyond_its_peak() -> None:
    assert brush(-3.0, 60.0, 8.0, 1.3) == pytest.approx(8.0)
    assert peaked(-3.0, 60.0, 8.0, 1.3) < 0.9 * 8.0


@pytest.mark.parametrize("law", [brush, peaked])
@pytest.mark.parametrize("slip", [-0.2, 0.02, 0.15])
def test_a_soft_steering_balances_the_force(law: object, slip: float) -> None:
    assert callable(law)
    force = yielding(law, slip, 60.0, 8.0, 1.3, 0.01)
    assert force == pytest.approx(law(slip + 0.01 * force, 60.0, 8.0, 1.3), rel=1e-6)
    assert abs(force) < abs(law(slip, 60.0, 8.0, 1.3))


def test_roll_steer_of_the_rear_axle_pushes_the_tail() -> None:
    plain = Axles(SMOOTH, Road(SMOOTH, 1)).forces(*MOTION)
    steered = axles({"roll_steer": {"e": 0.1, "form": "rear axle"}}).forces(*MOTION)
    side, yaw = steered[1] - plain[1], steered[2] - plain[2]
    assert side == pytest.approx(NOMINAL.rear_cornering_stiffness * 0.1 * MOTION[3], rel=0.1)
    assert yaw == pytest.approx(-NOMINAL.cg_to_rear_axle * side, rel=1e-6)


@pytest.mark.parametrize(("form", "share"), [("over r", 1.0), ("over r/V", 0.5)])
def test_yaw_damping_is_a_moment_against_the_turn(form: str, share: float) -> None:
    plain = Axles(SMOOTH, Road(SMOOTH, 1)).forces(*MOTION)
    damped = axles({"yaw_damping": {"c": 0.3, "form": form}}).forces(*MOTION)
    assert damped[2] - plain[2] == pytest.approx(-0.3 * MOTION[2] * share)
    assert damped[:2] == plain[:2]


def test_side_wind_turns_with_the_heading_and_is_felt() -> None:
    found = axles({"side_wind": {"w": 0.5, "psi0": 0.7, "x": 0.1}})
    plain = Axles(SMOOTH, Road(SMOOTH, 1)).forces(*MOTION)
    for psi in (0.0, 0.7, 3.0):
        found.travel(0.01, 0.0, psi)
        pushed = NOMINAL.mass * 0.5 * cos(psi - 0.7)
        _, side, yaw, roll = (a - b for a, b in zip(found.forces(*MOTION), plain, strict=True))
        assert (side, yaw) == (pytest.approx(pushed), pytest.approx(0.1 * pushed))
        body = NOMINAL.sprung_mass / NOMINAL.mass * pushed
        assert roll == pytest.approx(-body * NOMINAL.cg_height_above_roll_centre)


def test_a_change_of_ground_over_ten_seconds_and_one_all_along() -> None:
    slow = Stiffness({"surface_change": {"ratio": 0.5, "t": 5.0, "form": "over ten seconds"}})
    drift = Stiffness({"surface_change": {"ratio": 0.5, "form": "all along"}})
    found = []
    for t in (4.0, 10.0, 15.0, 300.0):
        slow.travel(0.0, t)
        drift.travel(0.0, t)
        found.append((slow.surface, drift.surface))
    assert [a for a, _ in found] == pytest.approx([1.0, 0.5**0.5, 0.5, 0.5])
    assert [b for _, b in found] == pytest.approx([0.5 ** (t / 300) for t in (4.0, 10.0, 15.0, 300.0)])


def test_first_order_and_delay_by_their_steps() -> None:
    lag, late = FirstOrder(400.0, 5.0), Delayed(400.0, 5.0)
    lag.apply(0.0)
    late.apply(0.0)
    rows = np.array([(lag.apply(1.0), late.apply(k + 1.0)) for k in range(60)])
    assert rows[19, 0] == pytest.approx(1 - exp(-20 / 400 * 2 * pi * 5))
    assert rows[-1, 1] == pytest.approx(60 - 400 / (2 * pi * 5))


def turned(effects: Effects) -> Sensors:
    """Sensors after a steady turn to the left."""
    parameters = replace(QUIET, effects=effects)
    plant, sensors = Plant(parameters), Sensors(parameters)
    for _ in range(3000):
        plant.step(1440, 1690, DT)
        sensors.update(plant.state)
    return sensors


def test_scales_of_the_sensors() -> None:
    plain, scaled = turned({}), turned({"sensor_scale": {"gyro": 0.1, "accel": -0.05}})
    assert scaled.gyro[2] - plain.gyro[2] == pytest.approx(
        0.1 * (plain.gyro[2] - QUIET.gyro_bias[2]), rel=1e-6
    )
    own = plain.accel[1] - QUIET.accel_bias[1]
    assert scaled.accel[1] - plain.accel[1] == pytest.approx(-0.05 * own, rel=1e-6)


@pytest.mark.parametrize(("form", "lag"), [("first order", 1.0), ("second order", 2**0.5)])
def test_a_filter_before_the_estimator_holds_the_heading_back(form: str, lag: float) -> None:
    """In a steady turn by r times the filter's lag at low frequency."""
    own = {"gyro_hz": 4.0}
    behind = turned({"sensor_filter": {**own, "form": form}})
    early = turned({"sensor_filter": {**own, "form": f"{form}, before the estimator"}})
    yaw_rate = -(early.gyro[2] - QUIET.gyro_bias[2])
    assert early.attitude[2] - behind.attitude[2] == pytest.approx(yaw_rate * lag / (2 * pi * 4.0), rel=0.05)
    assert early.gyro == behind.gyro
