"""Runs of a plan as experiments, their lateral acceleration, and the runs that may be proposed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.diagnosis.plans.plan_result import Limits, PlannedRun
from rover_sweep.diagnosis.simulation.experiment import RATE, SLOWEST, Experiment, tapered
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Sweep

USUAL_SPEED = 2.4  # m/s, of a plan without given runs
OTHER_SPEEDS = (0.6, 1.4)  # relative to the given speed
NAMES = {
    "sweep": "sweep",
    "doublet": "doublet",
    "bias_sweep": "sweep about a bias",
    "multisine": "odd/even multisine",
    "servo_test": "servo test on blocks",
    "other": "drive",
}


def manoeuvre_for(run: PlannedRun) -> Sweep | Doublet | Multisine:
    """The manoeuvre that the applet drives; a sweep for a run of another kind."""
    if run.kind == "doublet":
        return Doublet(run.amplitude_us)
    if run.kind == "multisine":
        return Multisine(run.amplitude_us)
    if run.kind == "bias_sweep":
        return BiasSweep(run.amplitude_us, bias=run.bias_us)
    return Sweep(run.amplitude_us)


def as_experiment(run: PlannedRun, rover: Geometry, rad_per_us: float, channels: Sequence[str]) -> Experiment:
    """The run as if driven on level ground with the kinematic yaw rate; the measured channels are zero."""
    found = manoeuvre_for(run)
    t = np.arange(int(found.duration * RATE)) / RATE
    steer = -np.asarray(found.wave(t), np.float64) * rad_per_us
    speed = np.full(t.size, max(run.speed, SLOWEST))
    turned = np.cumsum(run.speed * np.tan(steer) / rover.wheelbase) / RATE
    heading = turned - np.radians(run.heading or 0.0)
    return Experiment(
        run_text(run),
        run.kind,
        t,
        steer,
        speed,
        heading,
        dict.fromkeys(channels, np.zeros(t.size)),
        {},
        {},
        tapered(t.size),
        dict.fromkeys(channels, 100.0),  # Hz, of the motion in a log
        True,
        False,
        80.0,  # Hz, of the steering in a log
    )


def run_text(run: PlannedRun) -> str:
    """The run in words, such as "sweep of 120 us at 2.4 m/s"."""
    about = f" about {run.bias_us:+g} us" if run.bias_us else ""
    at = f" at {run.speed:g} m/s" if run.speed else ""
    heading = "" if run.heading is None else f" heading {run.heading:.0f} deg"
    often = {1: "", 2: ", twice"}.get(run.repeat, f", {run.repeat} times")
    return run.name or f"{NAMES[run.kind]} of {run.amplitude_us:g} us{about}{at}{heading}{often}"


def lateral_acceleration(run: PlannedRun, rover: Geometry, rad_per_us: float) -> float:
    """V r at the largest steering angle [m/s^2], kinematic."""
    angle = min((run.amplitude_us + abs(run.bias_us)) * rad_per_us, 1.5)
    return float(run.speed**2 * np.tan(angle) / rover.wheelbase)


def largest_amplitude(speed: float, ay: float, rover: Geometry, rad_per_us: float) -> float:
    """Steering offset [us] at which V r = ay, rounded down to a multiple of 10."""
    return 10.0 * float(np.floor(np.arctan(ay * rover.wheelbase / speed**2) / rad_per_us / 10.0))


def allowed(run: PlannedRun, rover: Geometry, rad_per_us: float, limits: Limits) -> bool:
    """True within the limits of rover and applet."""
    if run.amplitude_us + abs(run.bias_us) > limits.amplitude_us or run.amplitude_us < 20.0:
        return False
    if run.kind == "servo_test":
        return True
    low, high = limits.speed
    return low <= run.speed <= high and lateral_acceleration(run, rover, rad_per_us) <= limits.ay


def usual_run(rover: Geometry, rad_per_us: float, limits: Limits) -> PlannedRun:
    """The largest sweep at the usual speed, or at a lower one where that would be small."""
    most, speed = largest_amplitude(USUAL_SPEED, limits.ay, rover, rad_per_us), USUAL_SPEED
    while most < 60.0 and speed > limits.speed[0] * 1.2:
        speed = round(0.8 * speed, 1)
        most = largest_amplitude(speed, limits.ay, rover, rad_per_us)
    return PlannedRun("sweep", float(max(min(most, limits.amplitude_us), 20.0)), speed)


def candidates(
    base: Sequence[PlannedRun], rover: Geometry, rad_per_us: float, limits: Limits
) -> list[PlannedRun]:
    """Different runs that may be added to a set, all within the limits."""
    kinds = [r for r in base if r.kind != "servo_test"] or [usual_run(rover, rad_per_us, limits)]
    top = max(kinds, key=lambda run: run.amplitude_us)
    a, v = top.amplitude_us, round(top.speed, 1)
    fits = [c for c in _around(a, v, rover, rad_per_us, limits) if allowed(c, rover, rad_per_us, limits)]
    back = replace(top, kind="sweep", heading=((top.heading or 0.0) + 180.0) % 360.0, bias_us=0.0, name="")
    again = [replace(run, repeat=1, name="") for run in base or kinds if run.kind in ("sweep", "doublet")]
    more = [c for c in (back, *again) if allowed(c, rover, rad_per_us, limits)]
    return list(dict.fromkeys((*fits, *more)))


def _around(a: float, v: float, rover: Geometry, rad_per_us: float, limits: Limits) -> Iterator[PlannedRun]:
    """Variations of amplitude, speed and kind around a run of amplitude a [us] at v [m/s]."""
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
