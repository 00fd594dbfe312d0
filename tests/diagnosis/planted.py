"""Sweeps of a roll-yaw model with noise, and with signals added to the measurements ("planted")."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import log

import numpy as np

from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate import mismatches
from rover_sweep.diagnosis.problem.residuals import Problem, problem
from rover_sweep.diagnosis.result import Mismatch
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, tapered
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.manoeuvre.sweep import Sweep

ROVER = Geometry(2.7, 0.20, 0.20, sprung_mass=2.4, h=0.05, roll_inertia=0.012, yaw_inertia=0.08)
MODEL = Model("roll-yaw", ROVER, Tolerances())
X = {c.name: c.start for c in MODEL.free} | {
    "ln_C": log(35.0),
    "ln_Izz": log(0.08),
    "ln_k_phi": log(10.0),
    "ln_b_phi": log(0.4),
}
NOISE = {"r": 0.01, "ay": 0.15, "p": 0.03, "vy": 0.01}
PART = slice(3000, 8400)  # 27 s in the middle of a sweep
PLAN = ((0.10, 2.2), (0.20, 2.2), (0.12, 1.4))  # rad of steering, m/s
Planted = Callable[[Experiment], Mapping[str, Array]]


@cache
def sweeps(plan: Sequence[tuple[float, float]] = PLAN) -> tuple[Experiment, ...]:
    """A sweep for each (amplitude [rad], speed [m/s]), simulated by the model without noise."""
    out = []
    for k, (amplitude, speed) in enumerate(plan):
        law = Sweep()
        t = np.arange(int(68.0 * RATE)) / RATE
        steer = amplitude * law.wave(t) / law.amplitude
        taper = np.clip(np.minimum(t, t[-1] - t), 0.0, 1.0)
        run = Experiment(
            f"run{k + 1}",
            "sweep",
            t,
            steer,
            np.full(t.size, speed),
            np.zeros(t.size),
            dict.fromkeys(NOISE, t),
            {},
            {},
            0.5 - 0.5 * np.cos(np.pi * taper),
            dict.fromkeys(NOISE, 100.0),
            has_heading=True,
            steer_rate=50.0,
        )
        measured = logged(run, MODEL, X)
        heading = 0.3 + np.cumsum(measured["r"]) / RATE
        out.append(replace(run, measured=measured, heading=heading))
    return tuple(out)


def shortened(run: Experiment) -> Experiment:
    """The middle of a sweep."""
    t = run.t[PART] - run.t[PART][0]
    middle = {"steer": run.steer[PART], "speed": run.speed[PART], "heading": run.heading[PART]}
    measured = {c: x[PART] for c, x in run.measured.items()}
    return replace(run, t=t, commanded=None, measured=measured, taper=tapered(t.size), **middle)


def driven(
    runs: Sequence[Experiment], model: Model, x: Mapping[str, float], random: np.random.Generator
) -> list[Experiment]:
    """The runs as a rover of this model drives them, with noise."""
    out = []
    for run in runs:
        mess = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        out.append(replace(run, measured={c: y + mess[c] for c, y in logged(run, model, dict(x)).items()}))
    return out


def compared(planted: Planted, seed: int = 1) -> tuple[Problem, Array]:
    """(problem with the true noise floor, residual rows of the model) with noise and the planted signals."""
    random = np.random.default_rng(seed)
    runs, noise = [], []
    for run in sweeps():
        extra = planted(run)
        mess = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        measured = {c: y + mess[c] + extra.get(c, 0.0) for c, y in run.measured.items()}
        runs.append(replace(run, measured=measured))
        noise.append(mess)
    found = problem(runs, noise)
    return found, found.measured - found.model(MODEL, X)


def located(planted: Planted, seed: int = 1) -> tuple[Mismatch, ...]:
    """The places reported for the planted signals."""
    return mismatches(*compared(planted, seed))


def over(found: Sequence[Mismatch], quantity: str) -> list[Mismatch]:
    """The places over one quantity."""
    return [m for m in found if m.profile and m.profile.over == quantity]
