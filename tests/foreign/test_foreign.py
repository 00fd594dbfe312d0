"""The plant by itself, the sets that are drawn with it, and the marks of answers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rover_sweep.data.vehicle_file import parse
from rover_sweep.quality.verdict import assess
from tests.foreign.grade import PLACES, grade, hidden_ids, line, vehicle_text
from tests.foreign.laws import LISTED
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.plant import (
    COLUMNS,
    DT,
    STATES,
    STEERING_STATES,
    SURFACE,
    Numbers,
    dead_zone,
    integrated,
    load_factor,
    side_force,
    steering_step,
)
from tests.foreign.recorded import driven, drives, filtered, lagged, runs_of, wave
from tests.foreign.rover import SIZES, Rover, draw_rover, vehicle_toml

PLAIN = Numbers(
    m=12.0, ms=10.5, a=0.3, b=0.32, track=0.45, Izz=0.9, Ixx=0.16, h=0.1, kphi=80.0, bphi=3.0, roll_axis=0.08,
    Cf=190.0, Cr=200.0, ackermann=0.0, gain=50.0, motor_lag=0.003, rate=25.0, rate_form=0.0, tau_drive=0.3,
    most_drive=3.0, rolling=0.0,
)  # fmt: skip
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


def sine(amplitude: float, w: float = 4.0, seconds: float = 2.5) -> np.ndarray:
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


SIZED = {"deadband": (3, 0.02), "stiction": (3, 0.02), "play": (4, 0.02)}  # forms, size
SIZED |= {"curve": (4, 3.0), "asymmetry": (2, 0.05)}


@pytest.mark.parametrize("field", SIZED)
def test_steering_laws_vanish_with_their_size(field: str) -> None:
    forms, size = SIZED[field]
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
    plain = steered(PLAIN, command)
    for form in (0.0, 2.0, 3.0):
        gap = plain - steered(PLAIN._replace(play=0.03, play_form=form), command)
        assert (np.max(gap), np.min(gap)) == pytest.approx((0.03, -0.03), rel=0.02)


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
    for change, low, high in (
        ({"yaw_c": 2.0}, 0.5, 0.97),
        ({"diff_c": 60.0}, 0.5, 0.98),
        ({"yaw_c2": 6.0}, 0.5, 0.98),
        ({"roll_steer_front": 0.5}, 1.02, 1.5),
        ({"roll_steer_rear": 0.5}, 0.5, 0.98),
        ({"loose": 0.2, "loose_w": 6.0}, 0.95, 1.05),
    ):
        assert low < turn(PLAIN._replace(**change), 0.05)["r"][-1] / plain["r"][-1] < high, change
    for form in range(3):
        found = turn(PLAIN._replace(friction=0.1, friction_form=float(form)), 0.05)
        assert abs(found["phi"][2100]) < abs(plain["phi"][2100])
    late = turn(PLAIN._replace(sigma=0.4), 0.05)
    assert late["r"][-1] == pytest.approx(plain["r"][-1], rel=1e-3)
    assert late["r"][2100] < 0.9 * plain["r"][2100]


# ---- A drawn set: what the tool reads, its noise, its size, and the run it is told of.


def rover(size: int = 1, seed: int = 3) -> Rover:
    return draw_rover(np.random.default_rng(seed), SIZES[size])


def test_the_tool_reads_a_set_without_a_remark() -> None:
    rng = np.random.default_rng([0, 2])
    drawn = draw_rover(rng, SIZES[int(rng.integers(len(SIZES)))])
    runs, held_out = runs_of(drawn, drives(rng, drawn), 2)
    assert [run.kind for run in (*runs, *held_out)] == ["sweep", "sweep", "sweep", "doublet"]
    assert all(not run.notes for run in (*runs, *held_out))
    assert all(assess(run).keep for run in runs)
    i = drawn.instruments
    assert runs[0]["r"].rate == pytest.approx(i.loop_hz, rel=0.01)
    assert runs[0].filters["ay"].cutoff_hz == i.accel_hz
    assert runs[0].mean_speed == pytest.approx(drawn.speed, rel=0.12)
    assert np.max(np.abs(runs[1].manoeuvre("delta").x)) == pytest.approx(drawn.amplitude, rel=0.05)


@pytest.mark.parametrize("size", [0, 3])
def test_noise_is_that_of_recorded_rovers(size: int) -> None:
    """Straight on the official firmware: r .005 to .02 rad/s, a_y .07 to .2 m/s^2, p .015 to .04 rad/s."""
    some = rover(size)
    last = drives(np.random.default_rng(1), some)[3]
    found, undisturbed = (driven(some, last, np.random.default_rng(5), noise)[2] for noise in (True, False))
    inside = slice(round(last.begin / DT), round(last.end / DT))
    for name, low, high in (("r", 0.004, 0.03), ("ay", 0.07, 0.4), ("p", 0.008, 0.06)):
        assert low < np.std((found[name] - undisturbed[name])[inside]) < high, name


def test_what_the_owner_told_is_off_by_normal_tolerances() -> None:
    for seed in range(30):
        some = rover(seed % 4, seed)
        told, n = some.told, some.numbers
        assert abs(told["cg_to_front_axle"] - n.a) < 0.0101
        assert abs(told["roll_inertia"] / n.Ixx - 1) < 0.151
        assert abs(np.log(n.Cf / n.Cr)) < 0.121
        assert abs(some.instruments.accel_bias) < 0.3
        assert "position" in vehicle_toml(told)


def test_every_law_has_an_end_of_its_range_that_changes_the_runs() -> None:
    """One run of every law in a rover of some size: it stays finite at its smallest size and differs."""
    some = rover()
    plan = drives(np.random.default_rng(2), some)
    plan = tuple(replace(drive, kind="doublet") for drive in plan)  # shorter
    plain = {k: driven(some, plan[k], np.random.default_rng(1), noise=False)[2] for k in (1, 2)}
    for law in (*LISTED, *OUTSIDE_LAWS):
        extras = law.extras(np.random.default_rng(4))
        extras = {**extras, "run": 2.0, "at": 4.0} if "run" in extras else extras
        changed = law.apply(some, (law.low * law.high) ** 0.5, extras)
        assert changed != some
        which = 2 if law.effect in ("outside:speed_steering", "outside:slip_speed") else 1
        found = driven(changed, plan[which], np.random.default_rng(1), noise=False)[2]
        gap = max(float(np.max(np.abs(found[c] - plain[which][c]))) for c in ("r", "ay", "p", "vy"))
        assert np.isfinite(gap) and gap > 1e-3, (law.effect, law.form)


def test_the_sweep_follows_tischler_and_remple() -> None:
    plan = drives(np.random.default_rng(1), rover())
    t = np.arange(0, plan[0].length, DT)
    unit = wave(plan[0], t)
    crossings = t[1:][np.diff(np.sign(unit)) != 0]
    last = crossings[crossings < plan[0].end - 5.5]
    assert np.max(np.abs(unit)) == pytest.approx(1.0, abs=1e-3)
    assert np.pi / np.diff(last)[-1] == pytest.approx(24.5, rel=0.04)
    assert np.all(unit[t < plan[0].begin + 3.0] == 0.0)


def test_low_passes_have_their_gain() -> None:
    t = np.arange(0, 8, DT)
    wave_ = np.sin(2 * np.pi * 4.0 * t)
    assert np.std(filtered(wave_, 4.0)[3000:]) / np.std(wave_) == pytest.approx(0.707, abs=0.01)
    lag = 1 / (2 * np.pi * 4.0)
    assert np.std(lagged(wave_, lag, "first order")[3000:]) / np.std(wave_) == pytest.approx(0.707, abs=0.01)
    assert lagged(wave_, 0.05, "delay")[1050] == wave_[1000]


def test_a_sliding_load_moves_the_cg_away_from_the_imu() -> None:
    """V_y at the IMU, above the same place of the vehicle, hardly changes while the CG moves under it."""
    some = rover()
    plan = drives(np.random.default_rng(2), some)
    law = next(one for one in OUTSIDE_LAWS if one.effect == "outside:sliding_cargo")
    changed = law.apply(some, 0.1, {"sign": 1.0, "run": 1.0, "at": 10.0})
    before, after = (
        driven(one, plan[0], np.random.default_rng(1), noise=False)[2] for one in (some, changed)
    )
    until = round((plan[0].begin + 10.0) / DT)
    assert np.array_equal(before["vy"][:until], after["vy"][:until])
    r, gap = before["r"][until:], (after["vy"] - before["vy"])[until:]
    assert np.max(np.abs(gap)) < np.max(np.abs(r)) * 0.1 * (some.numbers.a + some.numbers.b)
    assert np.max(np.abs(after["r"] - before["r"])[until:]) > 0.01


# ---- Marks for invented answers, and the cases of recorded rovers.


def said(*findings: tuple[str, tuple[str, ...]], verdict: str = "explained", unknown: bool = False) -> Any:
    named = [{"effect": e, "look_alikes": list(alike), "parameters": {}} for e, alike in findings]
    left = {"channel": "r"} if unknown else None
    return {"verdict": verdict, "sentence": "", "findings": named, "unknown": left, "seconds": 3.0}


TWO = ("roll_steer", "tyre_saturation")


@pytest.mark.parametrize(
    ("hidden", "answer", "mark"),
    [
        ((), said(), "none"),
        ((), said(("roll_steer", ())), "wrong"),
        (("roll_steer",), said(("roll_steer", ())), "exact"),
        (("roll_steer",), said(("roll_steer", ()), ("imu_offset", ())), "wrong"),
        (("roll_steer",), said(("tyre_relaxation", ("roll_steer",))), "look-alike"),
        (("roll_steer",), said(("tyre_relaxation", ())), "wrong"),
        (("roll_steer",), said(unknown=True), "unknown"),
        (("roll_steer",), said(), "nothing"),
        (("transport_delay",), said(("servo_lag", ())), "exact"),
        (("tyre_saturation",), said(("load_transfer", ())), "wrong"),
        (("tyre_saturation",), said(("load_transfer", ("tyre_saturation",))), "look-alike"),
        (TWO, said(("tyre_saturation", ()), ("roll_steer", ())), "exact"),
        (TWO, said(("tyre_saturation", ())), "part"),
        (TWO, said(("tyre_saturation", ()), ("load_transfer", ("tyre_saturation",))), "wrong"),
        (TWO, said(("load_transfer", ("tyre_saturation",)), ("roll_steer", ())), "look-alike"),
        (("outside:yaw_drag",), said(unknown=True), "unknown"),
        (("outside:yaw_drag",), said(("roll_steer", ()), unknown=True), "wrong"),
        (("outside:tyre_dead_zone",), said(("steering_deadband", ())), "nearest"),
        (("outside:yaw_drag", "imu_tilt"), said(("imu_tilt", ()), unknown=True), "exact"),
        (("roll_steer",), said(verdict="failed"), "failed"),
    ],
)
def test_marks(hidden: tuple[str, ...], answer: Any, mark: str) -> None:
    assert grade("1", "single", hidden, answer).mark == mark


def test_the_place_of_an_unknown_law_counts_outside_the_list() -> None:
    answer = said(unknown=True)
    assert grade("1", "outside", ("outside:yaw_drag",), answer).placed is False
    answer["unknown"] = {"channel": "r", "law": "yaw moment ~ r^3"}
    graded = grade("1", "outside", ("outside:yaw_drag",), answer)
    assert graded.placed is True
    assert "yaw moment ~ r^3" in line(graded, answer)
    assert grade("1", "single", ("roll_steer",), answer).placed is None
    assert set(PLACES) == {law.effect for law in OUTSIDE_LAWS}


def test_a_name_is_counted_once_for_one_hidden_effect() -> None:
    twice = grade("1", "single", ("roll_steer",), said(("roll_steer", ()), ("imu_tilt", ("roll_steer",))))
    assert (twice.first, twice.wrong, twice.missed) == (("roll_steer",), ("imu_tilt",), ())


def test_cases_of_recorded_rovers() -> None:
    assert hidden_ids({"surface_t": 20.2, "surface_k": 0.7}) == ("surface_change",)
    assert hidden_ids({"cubic": 0.5, "gyro_lp": 4.4}) == ("steering_nonlinearity", "sensor_filter")
    with pytest.raises(KeyError):
        hidden_ids({"moon": 1.0})
    told = {"mass": 2.64, "cg_to_front_axle": 0.2, "cg_to_rear_axle": 0.19, "rad_per_us": 0.00094}
    rover = parse(vehicle_text(told))
    assert rover.steering() == (1500.0, 0.00094)
    assert rover.imu_iso == (0.0, 0.0, -0.06)
