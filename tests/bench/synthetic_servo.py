"""Benches with a known truth: the simulation's servo and linkage, noise, and outputs seen at 50 Hz."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.bench.by_wheel import Command, Wheel
from rover_sweep.bench.drive import Movement, path, ramp, staircase, steps
from rover_sweep.bench.evaluate import Readings
from sitl.plant.effects.steering_effects import Linkage
from sitl.plant.servo import Servo
from sitl.plant.variant import PlantParameters, load_variant

VARIANT = """base = "nominal"
servo_rate_limit = 3.0
servo_lag = 0.035
[effects]
steering_backlash = { b = 0.012 }
steering_asymmetry = { e = 0.05 }
"""
"""What is hidden in a rover on blocks, as a variant of the simulation."""
SEEN, SAMPLE = 0.02, 0.005  # s between two SERVO_OUTPUT_RAW, between two samples of the wheel
FINE = 5  # steps of the servo in a sample


def rover(
    b: float = 0.0, e: float = 0.0, c3: float = 0.0, w: float = 0.0, lag: float = 0.022, rate: float = 8.0,
    trim: float = 1500.0,
) -> PlantParameters:  # fmt: skip
    """The nominal rover with these effects of the steering."""
    effects = {
        "steering_backlash": {"b": b},
        "steering_asymmetry": {"e": e},
        "steering_nonlinearity": {"c3": c3},
        "steering_deadband": {"w": w, "of": "command"},
    }
    return replace(
        load_variant("nominal"), effects=effects, servo_lag=lag, servo_rate_limit=rate, steering_trim_us=trim
    )


def read_by_hand(
    parameters: PlantParameters, levels: tuple[float, ...], rng: np.random.Generator
) -> Readings:
    """A staircase, each angle read to half a degree."""
    linkage = Linkage(parameters.effects)
    pwm = 1500.0 + np.array([target.offset for target in staircase(levels).targets if target.read])
    angle = []
    for us in (1500.0, *pwm):
        u = -(us - parameters.steering_trim_us) * parameters.rad_per_us
        angle.append(linkage.played(linkage.wanted(u)))
    return Readings(pwm, np.array(angle[1:]) + np.radians(0.5) * rng.standard_normal(pwm.size), 1500.0)


def slope_by_hand(parameters: PlantParameters, reach: float) -> float:
    """True mean slope over +-reach us of the trim, rad/us."""
    linkage = Linkage({k: v for k, v in parameters.effects.items() if k != "steering_backlash"})
    u = parameters.rad_per_us * reach
    return (linkage.wanted(u) - linkage.wanted(-u)) / (2 * reach)


def seen_by_imu(
    parameters: PlantParameters,
    levels: tuple[float, ...],
    rng: np.random.Generator,
    as_rate: bool = False,
    clock: float = 0.0,
    ahead: float = 0.0,
) -> tuple[Command, Wheel]:
    """A ramp and steps; the wheel's clock `ahead` s before the rover's, known to `clock` s."""
    t, pwm, end = _outputs((ramp(levels[-1], 1), steps(levels)), rng)
    servo, now, j = Servo(parameters), 0.0, 0
    times = np.arange(1, int(end / SAMPLE) * FINE + 1) * (SAMPLE / FINE)
    angle = np.empty(times.size)
    for k, time in enumerate(times.tolist()):
        while j < t.size and t[j] <= time:
            servo.command(pwm[j], t[j])
            j += 1
        angle[k], now = servo.advance(now, time), time
    seen = np.arange(0.004, end, SEEN)
    last = np.searchsorted(t, seen, "right") - 1
    command = Command(seen, np.where(last >= 0, pwm[np.maximum(last, 0)], 1500.0), 1500.0)
    if as_rate:
        even = angle[::FINE]  # a gyro gives the mean of its sample, stamped in the middle
        rate = np.diff(even) / SAMPLE + 0.002 + 0.01 * rng.standard_normal(even.size - 1)
        return command, Wheel(times[::FINE][1:] - SAMPLE / 2 + ahead, rate, True, clock)
    drifting = angle + 0.3 + 2e-4 * times
    noisy = drifting[::FINE] + 0.002 * rng.standard_normal(times[::FINE].size)
    return command, Wheel(times[::FINE] + ahead, noisy, False, clock)


def _outputs(movements: Sequence[Movement], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """(when each PWM [us] was put out, at any moment of a 20 ms loop; the PWM; the end)."""
    t, pwm, base = [], [], 1.0
    for movement in movements:
        last = 0.0
        for until, offset, _ in path(movement, 0.0, 0.05):
            t.append(base + last + rng.uniform(0.0, 0.02))
            pwm.append(1500.0 + round(offset))
            last = until
        base += last + 0.5
    return np.array(t), np.array(pwm), base + 0.5
