"""Runs of a plan as experiments, what they ask of the rover, and which ones may be proposed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.diagnosis.plans.plan_result import Limits, PlannedRun
from rover_sweep.diagnosis.simulation.experiment import RATE, SLOWEST, Experiment, tapered
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Sweep

LOGGED = 100.0  # Hz, rate at which a log has the motion
STEERED = 80.0  # Hz, and the steering
USUAL_SPEED, USUAL_AMPLITUDE = 2.4, 240.0  # m/s, us: where a plan begins for which nothing was driven
COMFORT = 0.75  # of the lateral acceleration allowed, for a first set
OTHER_SPEEDS = (0.6, 1.4)  # of the speed that is driven
NAMES = {
    "sweep": "sweep",
    "doublet": "doublet",
    "bias_sweep": "sweep about a bias",
    "multisine": "odd/even multisine",
    "servo_test": "servo test on blocks",
    "other": "drive",
}


def law(run: PlannedRun) -> Sweep | Doublet | Multisine:
    """The steering that the applet drives; for another drive that of a sweep stands in."""
    if run.kind == "doublet":
        return Doublet(run.amplitude_us)
    if run.kind == "multisine":
        return Multisine(run.amplitude_us)
    if run.kind == "bias_sweep":
        return BiasSweep(run.amplitude_us, bias=run.bias_us)
    return Sweep(run.amplitude_us)


def as_experiment(run: PlannedRun, rover: Geometry, rad_per_us: float, channels: Sequence[str]) -> Experiment:
    """The run as if it had been driven on level ground, with the kinematic yaw rate; nothing measured yet."""
    found = law(run)
    t = np.arange(int(found.duration * RATE)) / RATE
    steer = -np.asarray(found.wave(t), np.float64) * rad_per_us
    speed = np.full(t.size, max(run.speed, SLOWEST))
    turned = np.cumsum(run.speed * np.tan(steer) / rover.wheelbase) / RATE
    heading = turned - np.radians(run.heading or 0.0)
    return Experiment(
        words(run),
        run.kind,
        t,
        steer,
        speed,
        heading,
        dict.fromkeys(channels, np.zeros(t.size)),
        {},
        {},
        tapered(t.size),
        dict.fromkeys(channels, LOGGED),
        True,
        False,
        STEERED,
    )


def words(run: PlannedRun) -> str:
    """Such as "sweep of 120 us at 2.4 m/s"."""
    about = f" about {run.bias_us:+g} us" if run.bias_us else ""
    at = f" at {run.speed:g} m/s" if run.speed else ""
    towards = "" if run.heading is None else f" heading {run.heading:.0f} deg"
    often = {1: "", 2: ", twice"}.get(run.repeat, f", {run.repeat} times")
    return run.name or f"{NAMES[run.kind]} of {run.amplitude_us:g} us{about}{at}{towards}{often}"


def lateral_acceleration(run: PlannedRun, rover: Geometry, rad_per_us: float) -> float:
    """V r at the largest steering angle, kinematic, m/s^2: more than tyres that slip make of it."""
    angle = min((run.amplitude_us + abs(run.bias_us)) * rad_per_us, 1.5)
    return float(run.speed**2 * np.tan(angle) / rover.wheelbase)


def largest_amplitude(speed: float, ay: float, rover: Geometry, rad_per_us: float) -> float:
    """Offset [us] that makes V r = ay, down to a multiple of 10."""
    return 10.0 * float(np.floor(np.arctan(ay * rover.wheelbase / speed**2) / rad_per_us / 10.0))


def allowed(run: PlannedRun, rover: Geometry, rad_per_us: float, limits: Limits) -> bool:
    """Within the limits of rover and applet."""
    if run.amplitude_us + abs(run.bias_us) > limits.amplitude_us or run.amplitude_us < 20.0:
        return False
    if run.kind == "servo_test":
        return True
    low, high = limits.speed
    return low <= run.speed <= high and lateral_acceleration(run, rover, rad_per_us) <= limits.ay


def first_set(rover: Geometry, rad_per_us: float, limits: Limits) -> tuple[PlannedRun, ...]:
    """Two amplitudes at one speed, the larger one well within the limits."""
    most = largest_amplitude(USUAL_SPEED, COMFORT * limits.ay, rover, rad_per_us)
    speed = USUAL_SPEED
    while most < 60.0 and speed > limits.speed[0] * 1.2:
        speed = round(0.8 * speed, 1)
        most = largest_amplitude(speed, COMFORT * limits.ay, rover, rad_per_us)
    top = float(max(min(most, USUAL_AMPLITUDE, limits.amplitude_us), 20.0))
    return PlannedRun("sweep", 10.0 * round(top / 20.0), speed), PlannedRun("sweep", top, speed)


def candidates(
    base: Sequence[PlannedRun], rover: Geometry, rad_per_us: float, limits: Limits
) -> list[PlannedRun]:
    """Runs that may be added to a set, safe ones only, without those whose like is there."""
    kinds = [r for r in base if r.kind != "servo_test"] or list(first_set(rover, rad_per_us, limits))
    top = max(kinds, key=lambda run: run.amplitude_us)
    a, v = top.amplitude_us, round(top.speed, 1)
    fits = [c for c in _around(a, v, rover, rad_per_us, limits) if allowed(c, rover, rad_per_us, limits)]
    back = replace(top, kind="sweep", heading=((top.heading or 0.0) + 180.0) % 360.0, bias_us=0.0, name="")
    again = [replace(run, repeat=1, name="") for run in base if run.kind in ("sweep", "doublet")]
    more = [c for c in (back, *again) if allowed(c, rover, rad_per_us, limits)]
    return list(dict.fromkeys((*fits, *more)))


def _around(a: float, v: float, rover: Geometry, rad_per_us: float, limits: Limits) -> Iterator[PlannedRun]:
    """Amplitudes, speeds and kinds about a run of amplitude a [us] at v [m/s]."""
    half = float(round(a / 2))
    yield PlannedRun("sweep", half, v)
    yield PlannedRun(
        "sweep", min(largest_amplitude(v, limits.ay, rover, rad_per_us), 10.0 * round(0.16 * a)), v
    )
    for share in OTHER_SPEEDS:
        speed = round(share * v, 1)
        most = min(largest_amplitude(speed, limits.ay, rover, rad_per_us), a)
        yield PlannedRun("sweep", most, speed)
        yield PlannedRun("doublet", most, speed)
    yield PlannedRun("doublet", a, v)
    for speed in (v, round(OTHER_SPEEDS[0] * v, 1)):
        yield PlannedRun("bias_sweep", half, speed, bias_us=half)
        yield PlannedRun("multisine", a, speed)
    yield PlannedRun("servo_test", a, 0.0)
