"""The plant against closed forms, and every law against its limits."""

from __future__ import annotations

import numpy as np
import pytest

from tests.foreign.chassis import STATES, SURFACE
from tests.foreign.motion import COLUMNS, DT, integrated
from tests.foreign.numbers import Numbers
from tests.foreign.steering import STATES as STEERING_STATES
from tests.foreign.steering import steering_step
from tests.foreign.tyres import dead_zone, load_factor, side_force

PLAIN = Numbers(
    m=12.0,
    ms=10.5,
    a=0.3,
    b=0.32,
    track=0.45,
    Izz=0.9,
    Ixx=0.16,
    h=0.1,
    kphi=80.0,
    bphi=3.0,
    roll_axis=0.08,
    Cf=190.0,
    Cr=200.0,
    ackermann=0.0,
    gain=50.0,
    motor_lag=0.003,
    rate=25.0,
    rate_form=0.0,
    tau_drive=0.3,
    most_drive=3.0,
    rolling=0.0,
)
SPEED = 2.5


def turn(n: Numbers, angle: float, seconds: float = 12.0, speed: float = SPEED) -> dict[str, np.ndarray]:
    """A straight run-up, then a constant command."""
    steps = int(seconds / DT)
    t, around, start = np.arange(steps) * DT, np.zeros((steps, 7)), np.zeros(STATES)
    around[:, SURFACE], start[0] = 1.0, speed
    motion = integrated(np.where(t > 2, angle, 0.0), np.full(steps, speed), around, start, n)
    return dict(zip(COLUMNS, motion.T, strict=True))


def steered(n: Numbers, command: np.ndarray) -> np.ndarray:
    """Road-wheel angle of a rover on blocks."""
    state = np.zeros(STEERING_STATES)
    return np.array([steering_step(state, float(u), SPEED, 0.0, 0.0, n, DT) for u in command])


def sine(amplitude: float, w: float = 4.0, seconds: float = 6.0) -> np.ndarray:
    return amplitude * np.sin(w * np.arange(int(seconds / DT)) * DT)


def test_a_steady_turn_is_that_of_the_single_track_model() -> None:
    """Pacejka 2012, 1.3: r = V delta / (l + K V^2); roll from the balance of moments."""
    found, n = turn(PLAIN, 0.02), PLAIN
    u, base = found["u"][-1], n.a + n.b
    understeer = n.m * (n.b * n.Cr - n.a * n.Cf) / (base * n.Cf * n.Cr)
    r = u * 0.02 / (base + understeer * u * u)
    assert found["r"][-1] == pytest.approx(r, rel=2e-3)
    assert found["phi"][-1] == pytest.approx(n.ms * n.h * u * r / (n.kphi - n.ms * 9.81 * n.h), rel=3e-3)
    assert found["v"][-1] / u == pytest.approx(n.b * r / u - n.a * n.m * u * r / (base * n.Cr), rel=1e-2)


def test_energy_only_falls_without_a_drive() -> None:
    n = PLAIN._replace(tau_drive=1e9)
    found = turn(n, 0.15, 6.0)
    falling = n.ms * 9.81 * n.h * np.cos(found["phi"])
    across = found["v"] - n.h * np.cos(found["phi"]) * found["p"]
    energy = 0.5 * (n.m * found["u"] ** 2 + n.Izz * found["r"] ** 2 + (n.m - n.ms) * found["v"] ** 2)
    energy += 0.5 * (n.ms * across**2 + n.Ixx * found["p"] ** 2 + n.kphi * found["phi"] ** 2) + falling
    assert np.max(np.diff(energy[::100])) < 1e-3 * energy[0]
    assert energy[-1] < 0.95 * energy[0]


@pytest.mark.parametrize("form", range(1, 7))
def test_a_tyre_has_its_stiffness_and_keeps_its_limit(form: int) -> None:
    alpha = np.linspace(-0.8, 0.8, 801)
    force = np.array([side_force(float(x), 100.0, 8.0, float(form)) for x in alpha])
    assert side_force(1e-5, 100.0, 8.0, float(form)) == pytest.approx(-1e-3, rel=1e-3)
    assert np.max(np.abs(force)) <= 8.0 + 1e-9
    assert force == pytest.approx(-force[::-1])
    falls = np.diff(force[alpha > 0.3]) > 0
    assert np.all(falls) if form == 2 else not np.any(falls)  # only the Magic Formula falls past its peak


def test_load_and_dead_zone() -> None:
    for form in (1.0, 2.0, 3.0):
        assert load_factor(10.0, 10.0, 0.6, form) == pytest.approx(1.0)
        assert load_factor(0.0, 10.0, 0.6, form) == pytest.approx(0.0, abs=0.7 if form == 1.0 else 1e-9)
        both = load_factor(13.0, 10.0, 0.6, form) + load_factor(7.0, 10.0, 0.6, form)
        assert both < 2.0  # an axle loses stiffness when load moves across
    assert dead_zone(0.05, 0.02) == pytest.approx(0.03)
    assert dead_zone(-0.01, 0.02) == 0.0


@pytest.mark.parametrize(
    ("field", "forms", "size"),
    [
        ("deadband", 3, 0.02),
        ("stiction", 3, 0.02),
        ("play", 4, 0.02),
        ("curve", 4, 3.0),
        ("asymmetry", 2, 0.05),
    ],
)
def test_steering_laws_vanish_with_their_size(field: str, forms: int, size: float) -> None:
    command = sine(0.2)
    plain = steered(PLAIN, command)
    for form in range(forms):
        gaps = []
        for share in (1e-3, 1.0):
            n = PLAIN._replace(**{field: share * size, f"{field}_form": float(form)})
            gaps.append(np.max(np.abs(steered(n, command) - plain)))
        assert gaps[0] < 1e-3 < 2e-3 < gaps[1] < 0.08, form


def test_play_is_crossed_at_every_reversal() -> None:
    command = sine(0.2)
    for form in (0.0, 2.0, 3.0):
        gap = steered(PLAIN, command) - steered(PLAIN._replace(play=0.03, play_form=form), command)
        assert np.max(gap) == pytest.approx(0.03, rel=0.02)
        assert np.min(gap) == pytest.approx(-0.03, rel=0.02)


def test_a_stuck_servo_waits_and_then_arrives() -> None:
    steps = np.repeat([0.0, 0.015, 0.05], 1500)
    for form, arrives in ((0.0, True), (1.0, True), (2.0, False)):
        found = steered(PLAIN._replace(stiction=0.02, stiction_form=form), steps)
        assert abs(found[2900]) < 1e-6  # an error of .015 does not start it
        assert (abs(found[-1] - 0.05) < 0.004) == arrives


def test_rate_limit_resonance_and_compliance() -> None:
    for form in (0.0, 1.0):
        found = steered(PLAIN._replace(rate=0.5, rate_form=form), np.full(2000, 0.3))
        assert np.max(np.diff(found)) / DT == pytest.approx(0.5, rel=0.02)
    found = steered(PLAIN._replace(resonance_w=30.0, resonance_z=0.1), np.full(3000, 0.1))
    assert np.max(found) > 0.13 and found[-1] == pytest.approx(0.1, rel=0.01)
    yielding = turn(PLAIN._replace(compliance=2e-3), 0.05)["delta"][-1]
    assert yielding < 0.05 * 0.97


def test_gravity_on_a_slope_is_not_felt_as_a_turn() -> None:
    """Straight along a slope: a steady crab angle, whose tyre forces carry the weight."""
    n = PLAIN._replace(slope=0.05, slope_heading=float(np.pi / 2))
    found = turn(n, 0.0, 2.0)
    assert found["gy"][0] == pytest.approx(9.81 * np.sin(0.05))
    assert found["v"][500:1000].mean() > 0  # downhill, to the left
    for still in (n, n._replace(sigma=0.3), n._replace(tyre_form=2.0, mu=0.5)):
        parked = turn(still, 0.0, 4.0, speed=0.0)
        assert np.max(np.abs(parked["v"])) < 0.03 and np.max(np.abs(parked["r"])) < 0.03
        assert abs(parked["v_dot"][-1]) < 0.01  # so that an accelerometer reads the slope


def test_yaw_damping_wind_and_friction_act_as_they_should() -> None:
    plain = turn(PLAIN, 0.05)
    assert turn(PLAIN._replace(yaw_c=2.0), 0.05)["r"][-1] < 0.97 * plain["r"][-1]
    assert turn(PLAIN._replace(diff_c=60.0), 0.05)["r"][-1] < 0.98 * plain["r"][-1]
    assert turn(PLAIN._replace(yaw_c2=6.0), 0.05)["r"][-1] < 0.98 * plain["r"][-1]
    for form in range(3):
        found = turn(PLAIN._replace(friction=0.1, friction_form=float(form)), 0.05)
        assert abs(found["phi"][2100]) < abs(plain["phi"][2100])
    assert turn(PLAIN._replace(roll_steer_front=0.5), 0.05)["r"][-1] > 1.02 * plain["r"][-1]
    assert turn(PLAIN._replace(roll_steer_rear=0.5), 0.05)["r"][-1] < 0.98 * plain["r"][-1]
    late = turn(PLAIN._replace(sigma=0.4), 0.05)
    assert late["r"][-1] == pytest.approx(plain["r"][-1], rel=1e-3)
    assert late["r"][2100] < 0.9 * plain["r"][2100]
    sloshing = turn(PLAIN._replace(loose=0.2, loose_w=6.0), 0.05)
    assert sloshing["r"][-1] == pytest.approx(plain["r"][-1], rel=0.05)
