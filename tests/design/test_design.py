"""A design's numbers against closed forms, an ODE solution, and facts measured on the firmware."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rover_sweep.data.vehicle_file import load
from rover_sweep.design.advice import with_advice
from rover_sweep.design.demand import (
    DOUBLET_PEAK,
    TRIM_ERROR,
    Design,
    fastest_stream,
    filter_effect,
    make_design,
    simulated_track,
    spectrum_grid,
    wave,
    wave_spectrum,
)
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.sweep import Doublet, Sweep, ThrottleSweep

ROVER = load(Path(__file__).parents[1] / "data" / "rover.toml")
GOOD: dict[str, Any] = {"runs": 3, "loop_rate": 100.0, "gyro_filter": 20.0, "accel_filter": 20.0}


def warnings(design: Design, servo: float | None = None) -> list[str]:
    return [note.text for note in with_advice(design, servo).notes if note.level == "warning"]


def test_the_papers_sweep() -> None:
    design = make_design(Sweep(), ROVER, 2.5)
    assert design.long_periods == pytest.approx(55 * 0.3 / (2 * math.pi))
    assert design.duration == 67.0
    assert design.windows is not None and design.windows.t_min == pytest.approx(20 * 2 * math.pi / 25)
    assert design.windows.t_max == pytest.approx(min(27.5, 2 * 61 / 5))
    assert design.servo.us_s == pytest.approx(150 * 25, rel=0.005)
    assert design.servo.wheel_deg_s == pytest.approx(math.degrees(150 * 25 * 0.00095), rel=0.005)
    assert design.servo.wheel_deg == pytest.approx(math.degrees(0.1425))
    t, x = wave(design.manoeuvre, 5000)
    assert design.servo.us_s == pytest.approx(np.abs(np.diff(x) / np.diff(t)).max(), rel=0.01)


def test_rates() -> None:
    rates = make_design(Sweep()).rates
    assert rates.least == pytest.approx(10 * 25 / (2 * math.pi), rel=0.005)
    assert rates.good == pytest.approx(2 * rates.least)
    assert (rates.stream, rates.loop_needed) == (40, 100)
    assert make_design(Sweep(w_max=200)).rates.loop_needed is None
    measured = {50: 40, 400: 1000 / 3, 100: 1000 / 12}
    assert {loop: fastest_stream(loop) for loop in measured} == pytest.approx(measured)


def test_filter_as_measured_on_the_firmware() -> None:
    """ardupilot.md: at 4 Hz the lag is about 57 ms (low frequency) and the gain 0.78 at 3.5 Hz."""
    assert filter_effect("INS_GYRO_FILTER", 4.0, 2 * math.pi * 3.5).gain == pytest.approx(0.79, abs=0.02)
    assert filter_effect("INS_GYRO_FILTER", 4.0, 5.0).lag_ms == pytest.approx(57, abs=1)
    top = make_design(Sweep()).w_top
    advised = filter_effect("INS_GYRO_FILTER", 4.0, top).advised_hz
    assert advised == 20
    better = filter_effect("INS_GYRO_FILTER", advised, top)
    assert better.lag_deg < 20 and better.gain > 0.99


def test_track_agrees_with_an_ode_solver() -> None:
    sweep, speed = Sweep(t_rec=20, w_min=0.6, w_max=10), 2.0
    path = simulated_track(sweep, ROVER, speed, TRIM_ERROR)

    def motion(t: float, state: np.ndarray) -> list[float]:
        delta = -(float(sweep.wave(t)) + TRIM_ERROR) * 0.00095
        return [speed * math.cos(state[2]), speed * math.sin(state[2]), speed * math.tan(delta) / 0.391]

    end = solve_ivp(motion, (0, path.t[-1]), [0, 0, 0], rtol=1e-8, max_step=0.05).y[:, -1]
    assert [path.x[-1], path.y[-1], path.psi[-1]] == pytest.approx(list(end), abs=0.02)


def test_space_follows_from_the_track() -> None:
    space = make_design(Sweep(), ROVER, 2.5).space
    assert space is not None
    path = simulated_track(Sweep(), ROVER, 2.5)
    assert (space.length, space.width) == pytest.approx((np.ptp(path.x), np.ptp(path.y)))
    assert space.radius == pytest.approx(0.391 / math.tan(0.1425), rel=1e-3)
    assert space.ay == pytest.approx(2.5**2 / space.radius)
    assert space.yaw_rate_deg_s == pytest.approx(math.degrees(2.5 / space.radius))
    assert space.farthest >= np.hypot(path.x, path.y).max()
    needed = make_design(ThrottleSweep(), ROVER, 2.0).space
    assert needed is not None and (needed.length, needed.width) == (2.0 * ThrottleSweep().duration, 4.0)
    # a positive PWM turns right: the first half period at w_min swings the heading by 2 r/w_min to the right
    assert path.psi.min() < -0.8 * 2 * (2.5 / space.radius) / 0.3 and path.psi[-1] < 0


def test_a_left_turning_linkage_mirrors_the_track() -> None:
    assert ROVER.rad_per_us is not None
    mirrored = replace(ROVER, rad_per_us=replace(ROVER.rad_per_us, value=-ROVER.rad_per_us.value))
    one, other = simulated_track(Sweep(), ROVER, 2.0), simulated_track(Sweep(), mirrored, 2.0)
    assert np.allclose(one.y, -other.y) and np.allclose(one.x, other.x)


def test_spectrum_covers_the_band_and_little_more() -> None:
    sweep = Sweep()
    inside, outside = (
        20 * np.log10(wave_spectrum(sweep, w)) for w in (np.geomspace(0.3, 25, 40), np.array([32.0, 37.0]))
    )
    assert np.ptp(inside) < 20 and outside.max() < inside.min() - 20
    w = np.array([7.0])
    t, x = wave(sweep, 200)
    assert wave_spectrum(sweep, w)[0] == pytest.approx(abs(np.trapezoid(x * np.exp(-7j * t), t)), rel=1e-3)


def test_doublet() -> None:
    doublet = Doublet(count=1, pulse=0.5)
    w = spectrum_grid(make_design(doublet), 2000)
    assert w[np.argmax(wave_spectrum(doublet, w))] == pytest.approx(DOUBLET_PEAK / 0.5, rel=0.02)
    design = make_design(doublet, ROVER, 2.0)
    assert design.windows is None and design.servo.us_s is None and design.space is not None
    assert design.space.heading_end_deg == pytest.approx(0, abs=1)
    assert design.w_top == pytest.approx(4 * math.pi)


GOOD_SWEEP = Sweep(amplitude=120, w_min=0.6, w_max=20, t_rec=50)
FAST, TOO_FAST = (replace(GOOD_SWEEP, w_max=w, amplitude=60) for w in (28, 40))
FAULTS: dict[str, tuple[Sweep, float, dict[str, float], str]] = {
    "short": (replace(GOOD_SWEEP, t_rec=18), 2.0, {}, "T_rec 18 s contains 1.7 periods"),
    "one run": (replace(GOOD_SWEEP, w_min=0.55), 2.0, {"runs": 1}, "too short for 0.55 rad/s"),
    "no fade": (replace(GOOD_SWEEP, fade=0), 2.0, {}, "without a fade"),
    "no straight": (replace(GOOD_SWEEP, straight=0), 2.0, {}, "too short to measure biases"),
    "weak": (replace(GOOD_SWEEP, amplitude=20), 5.0, {}, "20 us is small"),
    "at the stops": (replace(GOOD_SWEEP, amplitude=400, w_max=6), 0.5, {}, "end stops"),
    "slow servo": (replace(GOOD_SWEEP, amplitude=200), 1.0, {}, "(0.2 s/60 deg) reaches 300 deg/s"),
    "no servo": (replace(GOOD_SWEEP, amplitude=340, w_max=24), 0.5, {}, "even a fast servo"),
    "sliding": (GOOD_SWEEP, 4.5, {}, "slide on loose or wet ground"),
    "flying": (GOOD_SWEEP, 8.0, {}, "slide on any ground"),
    "creeping": (GOOD_SWEEP, 0.3, {}, "of yaw rate, near the noise"),
    "loop rate": (FAST, 2.0, {"loop_rate": 50.0}, "SCHED_LOOP_RATE 200"),
    "too fast": (TOO_FAST, 2.0, {"loop_rate": 400.0}, "too high for the output"),
    "gyro filter": (GOOD_SWEEP, 2.0, {"gyro_filter": 4.0}, "INS_GYRO_FILTER 4 Hz has a lag"),
    "accel filter": (GOOD_SWEEP, 2.0, {"accel_filter": 5.0}, "INS_ACCEL_FILTER 5 Hz has a lag"),
}


def test_each_fault_is_said_and_a_good_design_has_none() -> None:
    assert warnings(make_design(GOOD_SWEEP, ROVER, 2.0, **GOOD)) == []
    for case, (sweep, speed, options, sentence) in FAULTS.items():
        said = warnings(make_design(sweep, ROVER, speed, **{**GOOD, **options}))
        assert any(sentence in text for text in said), (case, said)


def test_runs_that_are_asked_for_are_enough() -> None:
    """As in the paper, 55 s are 2.6 periods of .3 rad/s, and two runs 5.3."""
    sweep = replace(GOOD_SWEEP, w_min=0.55)
    said = warnings(make_design(sweep, ROVER, 2.0, **{**GOOD, "runs": 1}))
    needed = int(said[0].rsplit("drive ", 1)[1].split()[0])
    assert warnings(make_design(sweep, ROVER, 2.0, **{**GOOD, "runs": needed})) == []
    assert not any("contains" in text or "window" in text for text in warnings(make_design(Sweep())))
    assert any("drive 2 runs" in text for text in warnings(make_design(Sweep(), runs=1)))


@pytest.mark.parametrize("remedy", [r"T_rec (\d+) s or", r"w_min ([\d.]+) rad"])
def test_a_longer_or_faster_sweep_that_is_asked_for_is_enough(remedy: str) -> None:
    sweep = replace(GOOD_SWEEP, t_rec=18)
    (said,) = (text for text in warnings(make_design(sweep, ROVER, 2.0, **GOOD)) if "contains" in text)
    found = re.search(remedy, said.split("use ")[1])
    assert found is not None
    other = replace(sweep, **{"t_rec" if "T_rec" in remedy else "w_min": float(found[1])})
    assert not any("contains" in text for text in warnings(make_design(other, ROVER, 2.0, **GOOD)))


def test_own_servo_replaces_the_typical_one() -> None:
    fast = replace(GOOD_SWEEP, amplitude=200)
    assert warnings(make_design(fast, ROVER, 1.0, **GOOD), servo=0.08) == []
    said = warnings(make_design(fast, ROVER, 1.0, **GOOD), servo=0.25)
    fits = float(said[0].split("reduce the amplitude. ")[1].split(" us")[0])
    assert warnings(make_design(replace(fast, amplitude=fits - 1), ROVER, 1.0, **GOOD), servo=0.25) == []


def test_space_without_steering_is_refused() -> None:
    with pytest.raises(UsageError, match="rad_per_us"):
        make_design(Sweep(), replace(ROVER, rad_per_us=None), 2.0)
    assert make_design(Sweep(), replace(ROVER, rad_per_us=None)).space is None
