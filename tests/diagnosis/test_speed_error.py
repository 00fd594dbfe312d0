"""An error of the measured speed is no physics, although it multiplies the motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from planted import MODEL, X, sweeps

import rover_sweep as rs
from rover_sweep.diagnosis.simulation.experiment import RATE, SPEED_ERROR, STEADIED
from rover_sweep.diagnosis.simulation.simulator import motion
from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.screening import screened
from rover_sweep.redrive.recorded_course import course_of
from sitl.plant.variant import load_variant
from sitl.redrive.open_loop import redrive
from tests.diagnosis.healthy import exact_vehicle_file

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"


def wavy(height: float):
    """A run of 1.4 m/s with a wave of half a hertz in its speed."""
    run = sweeps(1)[2]
    return replace(run, speed=run.speed + height * np.sin(np.pi * run.t))


def test_only_small_changes_of_the_speed_are_unsure():
    small, large = wavy(SPEED_ERROR), wavy(20 * SPEED_ERROR)
    inner = slice(int(STEADIED * RATE), -int(STEADIED * RATE))
    assert np.std(small.unsure[inner]) == pytest.approx(SPEED_ERROR / np.sqrt(2), rel=0.02)
    assert np.std(large.unsure[inner]) < 0.1 * np.std(large.speed[inner])


def test_what_turns_take_from_the_speed_is_sure():
    """A drive with another lag and drag than any basis function, beside an error of the estimate."""
    run = sweeps(1)[0]
    drag = run.measured["r"] * run.steer
    loss, keep = np.zeros_like(drag), np.exp(-1.0 / (RATE * 0.45))
    for k in range(1, drag.size):
        loss[k] = keep * loss[k - 1] - (1.0 - keep) * drag[k]
    loss *= 1.5 * SPEED_ERROR / np.std(loss)
    error = SPEED_ERROR * np.sin(0.9 * np.pi * run.t)
    found = replace(run, speed=run.speed + loss + error).unsure
    inner = slice(int(STEADIED * RATE), -int(STEADIED * RATE))
    left = [abs(np.corrcoef(x[inner], found[inner])[0, 1]) for x in (loss, error)]
    assert left[0] < 0.2 and left[1] > 0.95


def test_a_model_takes_a_share_of_the_unsure_changes():
    run = wavy(SPEED_ERROR)
    measured = motion(run, MODEL, {**X, "speed_share": 1.0})
    without = motion(run, MODEL, {**X, "speed_share": 0.0})
    half = motion(run, MODEL, {**X, "speed_share": 0.5})
    np.testing.assert_allclose(measured["V"] - without["V"], run.unsure, atol=1e-12)
    np.testing.assert_allclose(half["V"], run.speed - 0.5 * run.unsure)
    np.testing.assert_allclose(half["v_dot_x"], np.gradient(half["V"], 1.0 / RATE), atol=1e-12)
    steady = motion(run.steadied(0.5), MODEL, {**X, "speed_share": 0.5})
    np.testing.assert_allclose(steady["V"], without["V"])


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.5, 0.65])
def test_nothing_is_named_on_a_slow_healthy_rover(tmp_path, share):
    """The speed's error is 1.5 % of such a speed; a law over V r would read it as an effect."""
    rover, logs = load_variant("nominal"), [tmp_path / f"{run}.BIN" for run in ("run1", "run2", "run4")]
    for seed, log in enumerate(logs, 7):
        course = course_of(screened(read_logs(str(NOMINAL / log.name))[0]))
        redrive(replace(course, speed=share * course.speed), rover, log, seed)
    vehicle = tmp_path / "rover.toml"
    vehicle.write_text(exact_vehicle_file(rover))
    runs = rs.read(*map(str, logs[:2]), vehicle=vehicle)
    assert rs.diagnose(runs, rs.read(str(logs[2]), vehicle=vehicle)).verdict == "none"
