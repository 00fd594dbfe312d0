"""Runs whose answer is known: a linear model driven by a sweep, sampled and disturbed as asked."""

from dataclasses import replace

import numpy as np
from scipy.signal import cont2discrete, lfilter

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import LowPass, Recording, Signal
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.manoeuvre.sweep import Sweep

GEOMETRY = Geometry(
    mass=2.66, a=0.203, b=0.188, sprung_mass=2.40, h=0.058, roll_inertia=0.0125, imu_x=0.03, imu_z=0.02
)
TRUE = {"C": 32.0, "Izz": 0.071, "k_phi": 10.8, "b_phi": 0.36, "tau": 0.04}
RATE = 1000.0
HOLD = 7  # steps of 1 ms for which the PWM holds; no divisor of the log rate, or samples sit on its edges


def driven(
    structure: ModelStructure,
    sweep: Sweep,
    speed: float = 2.4,
    noise: float = 0.0,
    rad_per_us: float = 0.001,
    log_rate: float = 200.0,
    filters: dict[str, LowPass] | None = None,
    seed: int = 0,
) -> Recording:
    """The model's answer to a sweep held for 7 ms at a time, by a zero-order-hold simulation at 1 kHz.

    noise: sd in rad/s of r and p, ten times that in m/s^2 of ay. Independent of `identify.verify`.
    """
    t = np.arange(int(sweep.duration * RATE)) / RATE
    held = t[np.arange(t.size) // HOLD * HOLD]
    delta = -sweep.wave(held) * rad_per_us
    late = np.interp(t - structure.values["tau"], t, delta, left=0.0)
    outputs = _simulated(structure, speed, late)
    outputs["vy"] = np.cumsum(outputs.pop("vydot")) / RATE
    rng = np.random.default_rng(seed)
    keep = slice(0, None, int(RATE / log_rate))
    channels = {"delta": Signal(t[::HOLD], delta[::HOLD], "rad", "made", hold=True)}
    for name, unit in (("r", "rad/s"), ("p", "rad/s"), ("ay", "m/s^2"), ("vy", "m/s")):
        if name not in outputs:
            continue
        x = _low_passed(outputs[name], (filters or {}).get(name))[keep]
        scale = noise * (10 if name == "ay" else 1)
        channels[name] = Signal(t[keep], x + scale * rng.standard_normal(x.size), unit, "made")
    channels["speed"] = Signal(t[keep], np.full(t[keep].size, speed), "m/s", "made")
    return Recording("made", channels, (0.0, float(t[keep][-1])), "sweep", filters=filters or {})


def _simulated(structure: ModelStructure, speed: float, u: np.ndarray) -> dict[str, np.ndarray]:
    mat = structure.matrices(speed)
    a, b = np.linalg.solve(mat.m, mat.f), np.linalg.solve(mat.m, mat.g.astype(float))
    c, d = mat.h0 + mat.h1 @ a, mat.h1 @ b
    ad, bd, *_ = cont2discrete((a, b[:, None], c, d[:, None]), 1 / RATE)
    x, states = np.zeros(len(a)), np.empty((u.size, len(a)))
    for k in range(u.size):
        states[k] = x
        x = ad @ x + bd[:, 0] * u[k]
    middle = (u + np.concatenate((u[:1], u[:-1]))) / 2  # a sample on the edge of a step sees half of it
    y = states @ c.T + np.outer(middle, d)
    return dict(zip(structure.outputs, y.T, strict=True))


def _low_passed(x: np.ndarray, low_pass: LowPass | None) -> np.ndarray:
    """ArduPilot's LowPassFilter2p as its source has it (biquad with ohm = tan(pi fc/fs))."""
    if low_pass is None:
        return x
    ohm = np.tan(np.pi * low_pass.cutoff_hz / RATE)
    c = 1 + 2 * np.cos(np.pi / 4) * ohm + ohm**2
    b0 = ohm**2 / c
    return lfilter(
        [b0, 2 * b0, b0], [1, 2 * (ohm**2 - 1) / c, (1 - 2 * np.cos(np.pi / 4) * ohm + ohm**2) / c], x
    )


def mirrored(run: Recording) -> Recording:
    """The run with the sign of its steering angle turned round."""
    delta = run["delta"]
    return replace(run, channels={**run.channels, "delta": replace(delta, x=-delta.x)})
