"""A run of the virtual rover: axes, rates, filters, the wave, repeatability."""

import numpy as np
import pytest

from rover_sweep.data.recording import Recording
from rover_sweep.manoeuvre.sweep import Doublet
from rover_sweep.study.published import Firmware, virtual_drive
from sitl.plant.variant import load_variant

SHORT = Doublet(amplitude=100.0, pulse=1.0, pause=1.0, count=1, straight=1.0)
ROVER = load_variant("paper_asphalt")


@pytest.fixture(scope="module")
def run() -> Recording:
    return virtual_drive("doublet", ROVER, SHORT, 2.4, seed=3)


def test_a_larger_pwm_turns_right_which_is_negative_in_iso_axes(run: Recording) -> None:
    start, _ = run.span
    first = run["r"].between(start + 1.6, start + 2.0).x  # +100 us
    second = run["r"].between(start + 2.6, start + 3.0).x  # -100 us
    assert first.mean() < -0.3 and second.mean() > 0.3
    assert run["ay"].between(start + 1.6, start + 2.0).x.mean() < -0.5
    assert run["delta"].between(start + 1.6, start + 1.97).x.mean() == pytest.approx(-0.094, rel=0.02)
    assert run["psi"].between(start + 1.0, start + 2.0).x[-1] < run["psi"].between(start, start + 1.0).x[0]


def test_the_wave_is_the_applets_held_between_main_loops(run: Recording) -> None:
    pwm, (start, end) = run["pwm"], run.span
    assert pwm.hold and pwm.rate == pytest.approx(50)
    inside = pwm.between(start, end)
    assert np.max(np.abs(inside.x - 1500 - SHORT.wave(inside.t - start))) <= 0.5
    assert np.all(pwm.between(end + 0.1, end + 3).x == 1500)


def test_speed_comes_from_the_throttle_and_is_lost_in_corners(run: Recording) -> None:
    start, _ = run.span
    assert run["speed"].between(start - 0.5, start + 1.0).x.mean() == pytest.approx(2.4, abs=0.05)
    assert run.mean_speed < 2.4
    assert abs(run.bias("r") or 1.0) < 0.005


def test_the_firmwares_filters_are_in_the_signals_and_in_the_recording(run: Recording) -> None:
    assert {c: f.cutoff_hz for c, f in run.filters.items()} == {"r": 4.0, "p": 4.0, "ay": 10.0}
    open_filters = virtual_drive(
        "open", ROVER, SHORT, 2.4, 3, Firmware(gyro_filter_hz=100.0, accel_filter_hz=100.0)
    )
    assert np.std(np.diff(open_filters["p"].x)) > 2 * np.std(np.diff(run["p"].x))


def test_the_same_seed_drives_the_same_run_and_another_another(run: Recording) -> None:
    again, other = (virtual_drive("doublet", ROVER, SHORT, 2.4, seed) for seed in (3, 4))
    assert all(np.array_equal(run[c].x, again[c].x) for c in run.channels)
    assert not np.array_equal(run["r"].x, other["r"].x)


def test_the_loop_must_divide_the_physics_rate() -> None:
    with pytest.raises(ValueError, match="loop_hz = 60"):
        Firmware(loop_hz=60)


def test_the_asphalt_variant_keeps_table_3_and_its_mean_stiffness() -> None:
    published = load_variant("paper")
    assert (ROVER.front_cornering_stiffness + ROVER.rear_cornering_stiffness) / 2 == pytest.approx(
        published.front_cornering_stiffness, abs=0.02
    )
    assert (ROVER.yaw_inertia, ROVER.roll_stiffness) == (published.yaw_inertia, published.roll_stiffness)
    grass = load_variant("paper_grass")
    assert grass.friction < ROVER.friction and grass.road_force > ROVER.road_force
