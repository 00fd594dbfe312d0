"""Simulates ArduRover's speed loop around the identified law, for many controllers in parallel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import RatePid
from rover_sweep.gains.speed_chain import SpeedLoop, SpeedSettings
from rover_sweep.gains.speed_identified import SpeedPlant


@dataclass(frozen=True, eq=False)
class SpeedDrive:
    """t (m,) [s]; target (m,) [m/s] after the limit of the acceleration; speed (m, n) [m/s]; throttle (m, n)
    of the controller, -1..1."""

    t: Array
    target: Array
    speed: Array
    throttle: Array


def accelerated(loop: SpeedLoop, accel_max: float, wanted: Array) -> Array:
    """The target (m,) [m/s] for a commanded speed (m,), one value per main loop; starts at the first."""
    out, now = np.empty_like(wanted), float(wanted[0])
    for k, want in enumerate(wanted):
        slower = abs(want) < abs(now) and loop.decel_max > 0
        step = (loop.decel_max if slower else accel_max) * loop.period
        now = out[k] = want if accel_max <= 0 else min(max(want, now - step), now + step)
    return out


def simulate_speed(
    loop: SpeedLoop,
    plant: SpeedPlant,
    settings: SpeedSettings,
    wanted: Array,
    p: Array,
    i: Array,
    push: Array | None = None,
) -> SpeedDrive:
    """The loop from a steady drive at wanted[0] [m/s], for n controllers p, i (n,).

    wanted (m,): commanded speed in each main loop. push (m,): acceleration by a slope [m/s^2].
    """
    dt, n = loop.period, p.size
    ff = np.full(n, loop.base(settings))
    pid = RatePid(replace(loop.filters, d=settings.d), dt, p, i, ff)
    target = accelerated(loop, settings.accel_max, wanted)
    decay = float(np.exp(-dt / plant.lag))
    steps = int(plant.delay / dt)
    start = float(target[0])
    held = loop.from_motor(plant.offset + start / plant.gain)
    pid.integrator = np.where(i > 0, held - ff * start, 0.0)
    # without I, the speed settles where P and the base throttle balance the law
    slope = (1 - loop.least) * plant.gain
    free = (slope * (ff + p) * start + plant.gain * (loop.least - plant.offset)) / (1 + slope * p)
    v = np.where(i > 0, start, free)
    sent = np.full(n, held)
    speed, throttle = np.empty((wanted.size, n)), np.empty((wanted.size, n))
    limit, motor = np.zeros(n, dtype=bool), np.empty((wanted.size, n))
    for k, at in enumerate(target):
        speed[k] = v
        out = pid.update(float(at), v, limit)
        out = out if loop.brakes else np.maximum(out, 0.0)
        most = loop.slew * dt if loop.slew > 0 else np.inf
        slewed = np.clip(np.clip(out, sent - most, sent + most), -1.0, 1.0)
        limit, sent = slewed != out, slewed
        throttle[k] = sent
        motor[k] = np.clip(np.sign(sent) * loop.at_motor(np.abs(sent)), -loop.most, loop.most)
        felt = motor[max(k - steps, 0)]
        drive = np.sign(felt) * np.maximum(np.abs(felt) - plant.dead_zone, 0.0)
        pulled = plant.gain * (drive - (plant.offset - plant.dead_zone) * np.sign(v + 1e-9))
        pulled = pulled + (plant.lag * push[k] if push is not None else 0.0)
        v = np.maximum(decay * v + (1 - decay) * pulled, 0.0)
    return SpeedDrive(np.arange(wanted.size, dtype=np.float64) * dt, target, speed, throttle)
