"""All runs of a plan as one problem, as a diagnosis of them would see it, without data.

The rover is the nominal one of the vehicle file and the noise that of a small rover. Where recordings are
given, the model is fitted to them and their noise floor counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.plans.evidence import on_blocks, start, typical_floor, with_nuisances
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.problem.least_squares import Fitted, sensitivities
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import Problem, with_floor
from rover_sweep.diagnosis.problem.signatures import Signature, columns, signatures
from rover_sweep.diagnosis.problem.speed_drift import speed_drift
from rover_sweep.diagnosis.search.candidate_fits import tangent
from rover_sweep.diagnosis.search.needed_size import Signals
from rover_sweep.diagnosis.search.threshold import null_distribution
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.structure import Structure


@dataclass(frozen=True, eq=False)
class Joint(Problem):
    """Driven runs and runs on blocks together: their rows one after the other."""

    parts: tuple[Problem, ...] = ()

    def plain_models(self, structure: Structure, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The model's rows (size,) of all parts, without the metric."""
        found = [part.plain_models(structure, xs) for part in self.parts]
        return [np.concatenate(rows) for rows in zip(*found, strict=True)]


@dataclass(frozen=True, eq=False)
class Expected:
    """What a diagnosis of the planned runs would use: signals, and the threshold of each effect."""

    signals: Signals
    thresholds: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Assumed:
    """The noise floor and the coordinates {name: value} of the nominal model that a plan assumes."""

    floor: Floor
    x: Mapping[str, float]


def expected(
    runs: Sequence[Experiment], model: Model, effects: Sequence[Effect], assumed: Assumed
) -> Expected:
    """The signals of all runs and the thresholds, by noise and tolerances."""
    floor, x = assumed.floor, assumed.x
    named = [replace(run, name=f"{k} {run.name}") for k, run in enumerate(runs)]
    moving = [run for run in named if run.kind != "servo_test"]
    blocks = [on_blocks(run) for run in named if run.kind == "servo_test"]
    parts: tuple[Problem, ...] = (*([with_floor(moving, floor)] if moving else []), *blocks)
    joint = _joined(parts, moving or named)
    base = replace(start(model, joint.size), x=x)
    joint = replace(joint, plain_measured=joint.model(model.structure, x))
    joint = replace(joint, measured=joint.plain_measured)
    base = sensitivities(joint, base)
    usual = [*signatures(joint, base, model, effects, tolerances=True), *_own(parts, model, base, joint.size)]
    metric = joint.in_metric(columns(usual, joint.size))
    tolerances = [replace(s, rows=metric.of(s.rows)) for s in usual]
    fitted = replace(base, jacobian=metric.of(base.jacobian))
    found = signatures(metric, fitted, model, effects, forms=True)
    null = null_distribution(found, tolerances, tangent(fitted), 1.0, 1)
    return Expected(Signals(metric, model, fitted), null.thresholds)


def assumed(driven: Sequence[Experiment], model: Model) -> Assumed:
    """The noise floor and the model fitted to the recordings, of a small rover where there are none."""
    usual = start(model, 0).x
    moving = [run for run in driven if run.kind != "servo_test"]
    if not moving:
        return Assumed(typical_floor(), usual)
    problem, fitted = fit_with_floor(moving, model, usual, near=True)
    density = {**_at(typical_floor(), problem.floor.f), **problem.floor.density}
    return Assumed(Floor(problem.floor.f, density), fitted.x)


def _at(floor: Floor, f: Array) -> dict[str, Array]:
    return {channel: floor.at(channel, f) for channel in floor.density}


def _joined(parts: Sequence[Problem], runs: Sequence[Experiment]) -> Joint:
    size = sum(part.size for part in parts)
    first = parts[0]
    nothing = np.zeros(size)
    return Joint(tuple(runs), first.sensors, first.floor, first.rows, nothing, nothing, None, tuple(parts))


def _own(parts: Sequence[Problem], model: Model, base: Fitted, size: int) -> list[Signature]:
    """Errors of the measured speed, and of the measurement on blocks; zero in the other runs' rows."""
    out, begin = [], 0
    for part in parts:
        own = with_nuisances(part, model, base.x)
        if own is None:
            own = speed_drift(part, base)
        for s in own:
            rows = np.zeros(size)
            rows[begin : begin + part.size] = s.rows
            out.append(replace(s, rows=rows))
        begin += part.size
    return out
