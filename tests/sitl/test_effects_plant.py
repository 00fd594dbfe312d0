"""Effects in tyres, suspension, resistance and road, against their definitions; none of them: as before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import atan, cos, exp, pi, sin, tanh

import numpy as np
import pytest

from sitl.plant.axles import Axles
from sitl.plant.effects.axle_effects import EffectAxles
from sitl.plant.effects.imu import Delayed, FirstOrder
from sitl.plant.effects.tyres import Stiffness, brush, peaked, yielding
from sitl.plant.plant import GRAVITY, Plant
from sitl.plant.road import Road
from sitl.plant.sensors import Sensors
from sitl.plant.variant import PlantParameters, load_variant

NOMINAL = load_variant("nominal")
SMOOTH = replace(
    NOMINAL, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0, friction=50.0, rolling_resistance=0.0
)
DT = 0.0025
Effects = Mapping[str, Mapping[str, float]]

# x, y, psi, r, phi, delta half-way and at the end of `motion`
GOLDEN_MIDDLE = (
    12.457764252549719, -0.4537778908091289, 0.03520653929416928, 0.8846899538214996,
    0.025412745482896994, 0.09779098389517615,
)  # fmt: skip
GOLDEN_END = (
    19.88832291444417, -0.5573719731035037, -0.029469353802528332, 0.12520179122359998,
    0.003593313325199203, 0.1712416682533223,
)  # fmt: skip

ABSENT: Effects = {
    "steering_deadband": {"w": 0.0},
    "steering_backlash": {"b": 0.0},
    "steering_stiction": {"s": 0.0},
    "steering_nonlinearity": {"c3": 0.0},
    "steering_asymmetry": {"e": 0.0},
    "steering_trim": {"u0": 0.0},
    "tyre_relaxation": {"sigma": 0.0},
    "load_transfer": {"k": 0.0},
    "tyre_speed": {"k": 0.0},
    "roll_steer": {"e": 0.0},
    "suspension_friction": {"T": 0.0},
    "speed_variation": {"D": 0.0},
    "steering_compliance": {"k": 0.0},
    "yaw_damping": {"c": 0.0},
    "side_wind": {"w": 0.0, "psi0": 1.0},
    "sensor_scale": {"gyro": 0.0},
    "imu_offset": {"x": 0.0, "z": 0.0},
    "imu_tilt": {"roll": 0.0},
    "surface_change": {"ratio": 1.0, "t": 3.0},
    "cross_slope": {"b": 0.0, "psi0": 1.0},
}


def with_effects(effects: Effects, base: PlantParameters = SMOOTH) -> PlantParameters:
    return replace(base, effects=effects)


def driven(plant: Plant, seconds: float, steer_us: float = 1500, throttle_us: float = 1700) -> Plant:
    for _ in range(round(seconds / DT)):
        plant.step(steer_us, throttle_us, DT)
    return plant


def motion(parameters: PlantParameters) -> list[tuple[float, ...]]:
    plant, sensors = Plant(parameters, 3), Sensors(parameters, 3)
    rows: list[tuple[float, ...]] = []
    for k in range(4000):
        plant.step(1500 + 200 * sin(0.02 * k) * (k > 1000), 1710 if 200 < k < 3500 else 1500, DT)
        sensors.update(plant.state)
        s = plant.state
        rows.append((s.x, s.y, s.psi, s.r, s.phi, s.delta, *sensors.gyro, *sensors.accel, *sensors.velocity))
    return rows


def test_without_effects_the_nominal_rover_moves_as_it_did_before_there_were_any() -> None:
    """Numbers of the plant as it was when it knew of no effects (1e-9: libraries differ in the last bit)."""
    rows = motion(NOMINAL)
    assert rows[2500][:6] == pytest.approx(GOLDEN_MIDDLE, rel=1e-9)
    assert rows[-1][:6] == pytest.approx(GOLDEN_END, rel=1e-9)


@pytest.mark.parametrize("name", [*ABSENT, "all"])
def test_an_effect_of_no_size_changes_not_one_bit(name: str) -> None:
    effects = ABSENT if name == "all" else {name: ABSENT[name]}
    assert motion(with_effects(effects, NOMINAL)) == motion(NOMINAL)


def steady_turn(effects: Effects, steer_us: float = 1440, throttle_us: float = 1690) -> Plant:
    return driven(driven(Plant(with_effects(effects)), 4.0, 1500, throttle_us), 8.0, steer_us, throttle_us)


def axle_slips(plant: Plant) -> tuple[float, float]:
    q, s = plant.parameters, plant.state
    return (
        np.arctan2(s.vy + q.cg_to_front_axle * s.r, s.vx) - s.delta,
        np.arctan2(s.vy - q.cg_to_rear_axle * s.r, s.vx),
    )


def axle_forces(plant: Plant) -> tuple[float, float]:
    """From the balance of a steady turn: F_f cos(delta) + F_r = m V r, a F_f cos(delta) = b F_r."""
    q, s = plant.parameters, plant.state
    total, wheelbase = q.mass * s.vx * s.r, q.cg_to_front_axle + q.cg_to_rear_axle
    return total * q.cg_to_rear_axle / wheelbase / cos(s.delta), total * q.cg_to_front_axle / wheelbase


def test_tyre_saturation_follows_the_hyperbolic_tangent_of_the_static_load() -> None:
    mu = 0.5
    plant = steady_turn({"tyre_saturation": {"mu": mu}}, 1340)
    q = plant.parameters
    wheelbase = q.cg_to_front_axle + q.cg_to_rear_axle
    loads = (
        q.mass * GRAVITY * q.cg_to_rear_axle / wheelbase,
        q.mass * GRAVITY * q.cg_to_front_axle / wheelbase,
    )
    stiffnesses = (q.front_cornering_stiffness, q.rear_cornering_stiffness)
    for force, slip, c, load in zip(axle_forces(plant), axle_slips(plant), stiffnesses, loads, strict=True):
        assert force == pytest.approx(-mu * load * tanh(c * slip / (mu * load)), rel=0.01)
        assert abs(force) < 0.95 * abs(c * slip)


def test_load_transfer_takes_its_share_of_both_axles() -> None:
    plant = steady_turn({"load_transfer": {"k": 2.0}}, 1340)
    q, s = plant.parameters, plant.state
    share = 1 - 2.0 * (s.vx * s.r / GRAVITY) ** 2
    assert share < 0.95
    front, rear = axle_forces(plant)
    alpha_front, alpha_rear = axle_slips(plant)
    assert front == pytest.approx(-share * q.front_cornering_stiffness * alpha_front, rel=0.01)
    assert rear == pytest.approx(-share * q.rear_cornering_stiffness * alpha_rear, rel=0.01)


def test_stiffness_falls_with_the_speed() -> None:
    plant = steady_turn({"tyre_speed": {"k": 0.5}}, 1340)
    share = plant.state.vx**-0.5
    assert share < 0.8
    assert axle_forces(plant)[0] == pytest.approx(
        -share * plant.parameters.front_cornering_stiffness * axle_slips(plant)[0], rel=0.03
    )


@pytest.mark.parametrize("change", [{"t": 8.0}, {"distance": 15.0}])
def test_surface_changes_at_its_instant(change: dict[str, float]) -> None:
    plant = driven(Plant(with_effects({"surface_change": {"ratio": 0.7, **change}})), 4.0)
    driven_m, rows = plant.state.x, []
    while plant.state.t < 12.0:
        plant.step(1450, 1700, DT)
        driven_m += plant.state.vx * DT
        rows.append((plant.state.t, driven_m, axle_forces(plant)[1], axle_slips(plant)[1]))
    t, s, force, slip = np.array(rows)[1000:].T
    stiffness = force / slip
    at = t if "t" in change else s
    limit = next(iter(change.values()))
    before, after = stiffness[at < limit][-1], stiffness[-1]
    assert -before == pytest.approx(NOMINAL.rear_cornering_stiffness, rel=0.02)
    assert after / before == pytest.approx(0.7, rel=0.02)


def response(effects: Effects, w: float, amplitude_us: float = 10.0) -> tuple[np.ndarray, float]:
    """(r, p, phi, vy) per road-wheel angle at w [rad/s], complex, and the mean speed."""
    plant = driven(Plant(with_effects(effects)), 6.0)
    rows, step = [], 2 * pi / w / round(2 * pi / w / DT)
    turns = max(1, round(3.5 * w / (2 * pi)))
    settled, start = round(2 * pi / w / step) * turns, plant.state.t
    for _ in range(2 * settled):
        plant.step(1500 - amplitude_us * sin(w * (plant.state.t - start)), 1700, step)
        s = plant.state
        rows.append((s.r, s.p, s.phi, s.vy, s.delta, s.vx, s.t))
    values = np.array(rows[settled:])
    first = np.mean(values[:, :5] * np.exp(-1j * w * (values[:, 6] - start))[:, None], axis=0)
    return first[:4] / first[4], float(np.mean(values[:, 5]))


def bicycle(sigma: float, roll_steer: float, w: float, speed: float) -> np.ndarray:
    """(r, p, phi, vy) per delta of equation (18) with relaxing axle forces and roll steer, by hand."""
    q, s = NOMINAL, 1j * w
    a, b, sh = q.cg_to_front_axle, q.cg_to_rear_axle, q.sprung_mass * q.cg_height_above_roll_centre
    relaxed = 1 / (1 + s * sigma / speed)
    cf, cr = q.front_cornering_stiffness * relaxed, q.rear_cornering_stiffness * relaxed
    # unknowns vy, r, phi
    matrix = np.array(
        [
            [s * q.mass + (cf + cr) / speed, q.mass * speed + (a * cf - b * cr) / speed, -sh * s * s],
            [(a * cf - b * cr) / speed, s * q.yaw_inertia + (a * a * cf + b * b * cr) / speed, 0],
            [
                -sh * s,
                -sh * speed,
                (q.roll_inertia + sh * q.cg_height_above_roll_centre) * s * s
                + s * q.roll_damping
                + q.roll_stiffness
                - sh * GRAVITY,
            ],
        ],
        dtype=complex,
    )
    matrix[:2, 2] -= roll_steer * np.array([cf, a * cf])
    vy, r, phi = np.linalg.solve(matrix, np.array([cf, a * cf, 0], dtype=complex))
    return np.array([r, s * phi, phi, vy])


@pytest.mark.parametrize("w", [2.0, 8.0, 20.0])
@pytest.mark.parametrize(("sigma", "e"), [(0.0, 0.0), (0.25, 0.0), (0.03, 0.0), (0.0, 0.3), (0.1, -0.2)])
def test_relaxation_and_roll_steer_in_the_frequency_domain(sigma: float, e: float, w: float) -> None:
    effects = {"tyre_relaxation": {"sigma": sigma}, "roll_steer": {"e": e}}
    found, speed = response(effects, w)
    assert found == pytest.approx(bicycle(sigma, e, w, speed), rel=0.012)


def test_suspension_friction_holds_and_then_drags() -> None:
    """While the rover leans further out, its roll angle stays behind by T/(k - S h g)."""
    plant = Plant(with_effects({"suspension_friction": {"T": 0.05}}))
    driven(plant, 4.0)
    free = driven(Plant(with_effects({})), 4.0)
    for k in range(400):
        plant.step(1500 - 0.2 * k, 1700, DT)
        free.step(1500 - 0.2 * k, 1700, DT)
    moment = NOMINAL.sprung_mass * NOMINAL.cg_height_above_roll_centre
    lost = 0.05 / (NOMINAL.roll_stiffness - moment * GRAVITY)
    assert free.state.phi - plant.state.phi == pytest.approx(lost, rel=0.15)


def test_speed_variation_brakes_with_the_square_of_lateral_acceleration() -> None:
    plain, braked = steady_turn({}), steady_turn({"speed_variation": {"D": 0.05}})
    lateral = braked.state.vx * braked.state.r
    lost = 0.05 * lateral**2 * NOMINAL.speed_lag
    # the turned wheels brake less at the lower speed: between the two their share differs
    own = 1 - (braked.state.vx * braked.state.r / (plain.state.vx * plain.state.r)) ** 2
    assert plain.state.vx - braked.state.vx == pytest.approx(lost, rel=own + 0.02)


@pytest.mark.parametrize("heading", [0.0, pi / 2, pi, 4.0])
def test_cross_slope_turns_with_the_heading(heading: float) -> None:
    q = with_effects({"cross_slope": {"b": 0.03, "psi0": 0.5}})
    plant = Plant(q)
    plant.state.psi = heading
    plant.step(1500, 1500, DT)
    assert (plant.state.vx, plant.state.vy) == (0.0, 0.0), "it stands on its brakes"
    assert plant.state.ay == pytest.approx(GRAVITY * (0.03 * cos(heading - 0.5) + plant.state.phi))
    for _ in range(1200):  # held on its heading by hand
        plant.state.psi = heading
        plant.step(1500, 1700, DT)
    s = plant.state
    wanted = GRAVITY * (0.03 * cos(s.psi - 0.5) + s.phi)
    assert s.ay - s.vx * s.r == pytest.approx(wanted, abs=0.01)
    held = -sum(axle_slips(plant)) * 32.25 / NOMINAL.mass + GRAVITY * s.phi
    assert s.ay == pytest.approx(held, abs=0.01), "the tyres hold it"


def test_imu_offset_moves_the_accelerometer() -> None:
    """a_y + x r' - z p'."""
    plants = [Plant(with_effects(e)) for e in ({}, {"imu_offset": {"x": 0.06}}, {"imu_offset": {"z": 0.04}})]
    for k in range(3000):
        for plant in plants:
            plant.step(1500 - 30 * sin(12 * k * DT), 1700, DT)
        nominal, ahead, above = (plant.state for plant in plants)
        assert ahead.ay - nominal.ay == pytest.approx(0.06 * nominal.r_dot, abs=1e-3)
        assert above.ay - nominal.ay == pytest.approx(-0.04 * nominal.p_dot, abs=0.02)
    assert nominal.r == ahead.r == above.r


# ---- Forms of the plant's effects, and effects in body, road and sensors, by their definitions.

EVEN = replace(NOMINAL, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0)
QUIET = replace(EVEN, gyro_noise=0.0, accel_noise=0.0, vibration=0.0, attitude_error=0.0, velocity_error=0.0)
Forms = Mapping[str, Mapping[str, float | str]]
MOTION = (2.0, 0.1, 0.5, 0.04, 0.2, 0.1)  # vx, vy, r, phi, p, delta


def axles(effects: Forms) -> EffectAxles:
    return EffectAxles(replace(EVEN, effects=effects), Road(EVEN, 1))


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
    plain = Axles(EVEN, Road(EVEN, 1)).forces(*MOTION)
    steered = axles({"roll_steer": {"e": 0.1, "form": "rear axle"}}).forces(*MOTION)
    side, yaw = steered[1] - plain[1], steered[2] - plain[2]
    assert side == pytest.approx(NOMINAL.rear_cornering_stiffness * 0.1 * MOTION[3], rel=0.1)
    assert yaw == pytest.approx(-NOMINAL.cg_to_rear_axle * side, rel=1e-6)


@pytest.mark.parametrize(("form", "share"), [("over r", 1.0), ("over r/V", 0.5)])
def test_yaw_damping_is_a_moment_against_the_turn(form: str, share: float) -> None:
    plain = Axles(EVEN, Road(EVEN, 1)).forces(*MOTION)
    damped = axles({"yaw_damping": {"c": 0.3, "form": form}}).forces(*MOTION)
    assert damped[2] - plain[2] == pytest.approx(-0.3 * MOTION[2] * share)
    assert damped[:2] == plain[:2]


def test_side_wind_turns_with_the_heading_and_is_felt() -> None:
    found = axles({"side_wind": {"w": 0.5, "psi0": 0.7, "x": 0.1}})
    plain = Axles(EVEN, Road(EVEN, 1)).forces(*MOTION)
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


def turned(effects: Forms) -> Sensors:
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
