"""The answer as curves: tyres, steering, roll damper and yaw moment of the fitted model with 90 % bands.

Each curve is the law at rest over the range that the runs visited: lags, delays and changes of ground are no
part of it. The bands come from the same draws as the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import exp

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.kinds import CommandEffect, LinkageEffect
from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.posterior.parameter_intervals import LEVEL
from rover_sweep.diagnosis.result import LawCurve
from rover_sweep.diagnosis.simulation.simulator import motion, vehicle_numbers
from rover_sweep.diagnosis.simulation.single_track import SGN_WIDTH, VehicleNumbers, tyre_force
from rover_sweep.diagnosis.simulation.structure import Structure, Values

EVERY = 10  # of the draws
POINTS = 25
VISITED = (1.0, 99.0)  # percent of the samples
SLOWLY = 40  # samples of the steering between two points of its curve
Law = Callable[[Values, Array], Array]


def answer_curves(last: ModelFit, drawn: Sequence[Mapping[str, float]]) -> tuple[LawCurve, ...]:
    """The curves of both tyres, and of steering, damper and yaw moment where an effect acts on them.

    () of a lumped model.
    """
    structure, x = last.model.structure, last.fitted.x
    if structure.lumped:
        return ()
    some = (x, *drawn[::EVERY])
    found = []
    if any((structure.of(CommandEffect), structure.of(LinkageEffect))):
        found.append(_curve("steering", ("command", "rad"), "rad", _loop(last), _wheel(structure), some))
    if structure.slip:
        visited = _visited(last)
        q = vehicle_numbers(structure, x)
        laws: list[tuple[str, tuple[str, str], str, Law]] = [
            ("side force front", ("slip angle front", "rad"), "N", _tyre(structure, front=True)),
            ("side force rear", ("slip angle rear", "rad"), "N", _tyre(structure, front=False)),
        ]
        if q.T_roll:
            laws.append(("roll damper", ("roll rate", "rad/s"), "N m", _damper(structure)))
        if q.yaw_damp or q.yaw_damp_v:
            speed = float(np.mean([run.mean_speed for run in last.problem.runs]))
            laws.append(("yaw moment", ("yaw rate", "rad/s"), "N m", _against_turning(structure, speed)))
        found += [
            _curve(place, over, unit, np.linspace(*visited[over[0]], POINTS), law, some)
            for place, over, unit, law in laws
        ]
    return tuple(found)


def _curve(
    place: str, over: tuple[str, str], unit: str, at: Array, law: Law, some: Sequence[Values]
) -> LawCurve:
    """The law at the fit, the first of `some`, with its band over the others."""
    values = np.array([law(x, at) for x in some])
    low, high = np.percentile(values[1:], LEVEL, axis=0) if len(values) > 1 else (values[0], values[0])
    low, high = np.minimum(low, values[0]), np.maximum(high, values[0])
    x, y, below, above = (tuple(map(float, some)) for some in (at, values[0], low, high))
    return LawCurve(place, (), *over, unit, x, y, below, above, 0.0)


def _visited(last: ModelFit) -> dict[str, tuple[float, float]]:
    """{quantity: range} that the fitted model visits in the runs."""
    structure, x = last.model.structure, last.fitted.x
    q = vehicle_numbers(structure, x)
    seen: dict[str, list[Array]] = {}
    for run in last.problem.runs:
        y = motion(run, structure, x)
        slips = y["v"] + q.a * y["r"], y["v"] - q.b * y["r"]
        front, rear = (np.arctan(across / y["V"]) for across in slips)
        parts = {"slip angle front": front - y["delta"], "slip angle rear": rear}
        for name, values in (parts | {"roll rate": y["p"], "yaw rate": y["r"]}).items():
            seen.setdefault(name, []).append(values)
    ends = {name: np.percentile(np.concatenate(parts), VISITED) for name, parts in seen.items()}
    return {name: (float(low), float(high)) for name, (low, high) in ends.items()}


def _loop(last: ModelFit) -> Array:
    """Commanded angles from the least to the largest of the runs and back [rad]."""
    every = np.concatenate([run.steer for run in last.problem.runs])
    low, high = np.percentile(every, VISITED)
    up = np.linspace(low, high, POINTS)
    return np.concatenate((up, up[::-1]))


def _wheel(structure: Structure) -> Law:
    """Road-wheel angle after a slow turn to each commanded angle, in their order."""

    def law(x: Values, at: Array) -> Array:
        twice = np.concatenate((at, at))  # so that play and friction begin as a turn leaves them
        steps = np.arange(SLOWLY * (twice.size - 1) + 1) / SLOWLY
        d = np.interp(steps, np.arange(twice.size), twice) * (1.0 + x.get("scale", 0.0))
        for effect in (*structure.of(CommandEffect), *structure.of(LinkageEffect)):
            d = effect.act(d, effect.coordinates(x))
        return np.asarray(d[::SLOWLY][at.size :] - x.get("trim", 0.0))

    return law


def _tyre(structure: Structure, front: bool) -> Law:
    """Side force of an axle over its slip angle, without the shift of load."""

    def law(x: Values, at: Array) -> Array:
        q: VehicleNumbers = vehicle_numbers(structure, x)
        stiffness, share = (q.Cf, q.b) if front else (q.Cr, q.a)
        load = q.m * q.g * share / (q.a + q.b)
        known = load, 1.0 / load, q.inv_mu, q.bend, q.tyre_form
        return np.array([tyre_force(slip, stiffness, *known) for slip in at])

    return law


def _damper(structure: Structure) -> Law:
    """Roll moment of damper and dry friction over the roll rate."""

    def law(x: Values, at: Array) -> Array:
        q = vehicle_numbers(structure, x)
        return np.asarray(q.b_phi * at + q.T_roll * np.tanh(at / (SGN_WIDTH * exp(q.ln_width))))

    return law


def _against_turning(structure: Structure, speed: float) -> Law:
    """Yaw moment over the yaw rate at a speed [m/s]."""

    def law(x: Values, at: Array) -> Array:
        q = vehicle_numbers(structure, x)
        return -(q.yaw_damp + q.yaw_damp_v / speed) * at

    return law
