"""What one planned run would show, as inner products of columns of its whitened rows.

A plan needs no more of a run than the Gram matrix of these columns: the sensitivities to the nominal
coordinates, the signatures of the effects, and what every rover has (tolerances and the model's own error).
What belongs to this run alone, such as the slow error of its measured speed, is eliminated here: with the
columns O at one standard deviation, the Gram matrix G of the others becomes G - G_o (I + O^T O)^-1 G_o^T,
that of rows in the metric of noise and O. Runs of a set are then added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy.fft import rfft

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.posterior.model_fit import (
    COMMON,
    OWN,
    errors_of_coefficients,
    errors_of_responses,
    fit_with_floor,
)
from rover_sweep.diagnosis.problem.least_squares import Fitted, sensitivities
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import Problem, Rows, whitened, with_floor
from rover_sweep.diagnosis.problem.signatures import Signature, columns, signatures, speed_drift
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import wheel_angle
from rover_sweep.diagnosis.simulation.structure import Structure

NOISE = {
    "Hz": (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0),
    "r": (1.3e-4, 1.2e-4, 1.1e-4, 1.1e-4, 7.5e-5, 4.5e-5, 2.2e-5, 1.1e-5, 3.2e-6, 1.2e-6, 5.6e-7, 3.2e-7),
    "ay": (2.0e-3, 2.2e-3, 2.5e-3, 3.2e-3, 4.0e-3, 3.5e-3, 2.6e-3, 1.8e-3, 1.6e-3, 1.2e-3, 8.5e-4, 6e-4),
    "p": (3.5e-6, 5.5e-6, 1.0e-5, 2.2e-5, 7.5e-5, 1.4e-4, 3.0e-4, 2.5e-4, 8.0e-5, 3.0e-5, 1.2e-5, 5.5e-6),
    "vy": (2.0e-4, 1.5e-4, 1.0e-4, 7.0e-5, 4.0e-5, 2.0e-5, 6.0e-6, 3.0e-6, 1.3e-6, 6e-7, 3e-7, 1.5e-7),
}
"""One-sided noise densities, unit^2/Hz: geometric means of the floors of recordings of five rovers of 2.6 kg,
on the official firmware, on two plants of different authors. The road shakes the rover, so the noise has the
shape of its yaw and roll response; single rovers differ by a factor of 3 below 2 Hz."""
TYPICAL = {"ln_C": log(2.5 / 3.0), "ln_b_phi": log(2.0)}
"""{coordinate: difference to the start of a fit}: in recordings of seven small rovers C is 2.1 to 2.7 times
m g/2, and the roll mode has 0.37 to 0.43 of its critical damping. A fit starts from half that damping, with
which roll steer would show twice as much."""

# A camera or a potentiometer at a wheel of a rover on blocks: 0.3 deg rms at 60 Hz.
ANGLE_NOISE = 2 * (0.3 * np.pi / 180.0) ** 2 / 60.0  # rad^2/Hz
ANGLE_BAND = (0.05, 8.0)  # Hz
ANGLE_SCALE, ANGLE_CLOCK = 0.03, 0.005  # standard deviations of the relative scale, and of the offset [s]

Key = tuple[str, str]
"""Of a column: ("nominal", coordinate), ("usual", what every rover has) or (effect, parameter)."""


@dataclass(frozen=True)
class Reach:
    """How far a signature reaches, in its coordinate.

    start: where a nominal coordinate ends, or the effect is absent. distance: from there, with its sign. end:
    of the effect's range.
    """

    start: float
    distance: float
    end: float

    @property
    def most(self) -> float:
        """The largest multiple of the distance."""
        return (self.end - self.start) / self.distance

    def times(self, factor: float) -> Reach:
        """As far as a multiple of this distance."""
        return Reach(self.start, factor * self.distance, self.end)


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """keys: of the k columns. gram (k, k): their inner products; root (k, k): its square root, of noise."""

    keys: tuple[Key, ...]
    gram: Array
    root: Array


@dataclass(frozen=True, eq=False)
class Basis:
    """A run's columns without effects: rows (size, k) by their keys, own (size, m) of this run alone."""

    problem: Problem
    base: Fitted
    keys: tuple[Key, ...]
    rows: Array
    own: Array


@dataclass(frozen=True, eq=False)
class Assumed:
    """What a plan assumes: the noise floor, and the rover in which effects are looked for.

    effects: by their ids. x: {coordinate: value} of the nominal model. reach: of the effects' signatures.
    """

    model: Model
    effects: Mapping[str, Effect]
    floor: Floor
    x: Mapping[str, float]
    reach: Mapping[Key, Reach]

    def first(self, effect: str) -> EffectParameter:
        """The first parameter of an effect that has a size, by which it is judged."""
        return next(p for p in self.effects[effect].parameters if (effect, p.name) in self.reach)

    def sized(self, sizes: Mapping[str, float]) -> Assumed:
        """The same with other sizes {effect: multiple of its own}."""
        return replace(self, reach={k: r.times(sizes.get(k[0], 1.0)) for k, r in self.reach.items()})


@dataclass(frozen=True, eq=False)
class OnBlocks(Problem):
    """The rover is on blocks and its wheel angle is measured; tyres and body have no effect."""

    def plain_models(self, structure: Structure, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The rows (size,) that the model predicts."""
        angles = [{"delta": wheel_angle(self.runs[0], structure, x)} for x in xs]
        return [whitened(self.rows, self.runs, [angle]) for angle in angles]


def assumed(driven: Sequence[Experiment], model: Model, effects: Sequence[Effect]) -> Assumed:
    """The noise floor and the model fitted to the recordings, of a small rover where there are none."""
    x = {c.name: float(np.clip(c.start + TYPICAL.get(c.name, 0.0), c.low, c.high)) for c in model.free}
    floor = Floor(np.array(NOISE["Hz"]), {c: np.array(d) for c, d in NOISE.items() if c != "Hz"})
    if moving := [run for run in driven if run.kind != "servo_test"]:
        problem, fitted = fit_with_floor(moving, model, x, near=True)
        f, x = problem.floor.f, dict(fitted.x)
        floor = Floor(f, {c: floor.at(c, f) for c in floor.density} | dict(problem.floor.density))
    reach = {(e.id, p.name): _reach(model, e, p) for e in effects for p in e.parameters if p.name != "t"}
    return Assumed(
        model, {e.id: e for e in effects}, floor, x, {k: r for k, r in reach.items() if r.distance}
    )


def _reach(model: Model, effect: Effect, p: EffectParameter) -> Reach:
    """To a parameter at its own size, beyond the tolerance of its nominal coordinate."""
    bounds = {c.name: c for c in model.free}
    if p.nominal and p.nominal not in bounds:
        return Reach(0.0, 0.0, 0.0)
    free = next(c for c in model.with_effect(effect.name).free if c.name == effect.coordinate_name(p))
    if not p.nominal:
        return Reach(0.0, p.size, free.high)
    if free.high > bounds[p.nominal].high:
        return Reach(bounds[p.nominal].high, p.size * p.per, free.high)
    return Reach(bounds[p.nominal].low, -p.size * p.per, free.low)


def basis(run: Experiment, given: Assumed) -> Basis:
    """The columns of a run without the effects."""
    blocks, model, effects = run.kind == "servo_test", given.model, list(given.effects.values())
    problem = _on_blocks(run) if blocks else with_floor([run], given.floor)
    nothing = np.zeros(problem.size)
    base = Fitted(model.structure, model.free, given.x, 0.0, nothing, nothing[:, None])
    expected = problem.model(model.structure, given.x)
    problem = replace(problem, measured=expected, plain_measured=expected)
    base = sensitivities(problem, base)
    usual = signatures(problem, base, model, effects, tolerances=True)
    own = [s for s in usual if given.effects[s.effect].in_one_run]
    shared = [s for s in usual if not given.effects[s.effect].in_one_run]
    if blocks:
        own += _measured(problem, given)
    else:
        errors = errors_of_responses(problem, base)
        shared += [*errors_of_coefficients(problem, base), *errors]
        own += [*speed_drift(problem, base), *(replace(s, rows=s.rows * (OWN / COMMON)) for s in errors)]
    keys = [
        *(("nominal", c.name) for c in model.free),
        *(("usual", f"{s.effect} {s.parameter}") for s in shared),
    ]
    rows = np.column_stack((base.jacobian, *(s.rows for s in shared)))
    return Basis(problem, base, tuple(keys), rows, columns(own, problem.size))


def evidence(run: Basis, given: Assumed) -> RunEvidence:
    """The columns of a run with the signatures of effects as far as they reach."""
    found = [s for effect in given.effects.values() for s in _signatures(run, given, effect)]
    every = np.column_stack((run.rows, *(s.rows for s in found)))
    across = every.T @ run.own
    left = np.linalg.solve(np.eye(run.own.shape[1]) + run.own.T @ run.own, across.T)
    gram: Array = np.asarray(every.T @ every - across @ left)
    values, vectors = np.linalg.eigh(gram)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return RunEvidence((*run.keys, *((s.effect, s.parameter) for s in found)), gram, root)


def _signatures(run: Basis, given: Assumed, effect: Effect) -> list[Signature]:
    """The signatures of one effect; two effects may move the same nominal coordinate."""
    out = []
    for p in effect.parameters:
        if one := given.reach.get((effect.id, p.name)):
            at = {effect.coordinate_name(p): one.distance}
            base = replace(run.base, x={**run.base.x, p.nominal: one.start}) if p.nominal else run.base
            law = replace(effect, parameters=(p, *(q for q in effect.parameters if q.name == "t")))
            out += signatures(run.problem, base, given.model, [law], at)
    return out


def _on_blocks(run: Experiment) -> OnBlocks:
    f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
    bins = np.flatnonzero((f >= ANGLE_BAND[0]) & (f <= ANGLE_BAND[1]))
    weight = np.full(bins.size, 1.0 / np.sqrt(ANGLE_NOISE * RATE / 4 * np.sum(run.taper**2)))
    nothing = np.zeros(2 * bins.size)
    none = Floor(np.ones(1), {})  # the noise of the angle is in the weight
    return OnBlocks((run,), (), none, (Rows(0, "delta", bins, f[bins], weight, 0),), nothing, nothing)


def _measured(problem: Problem, given: Assumed) -> list[Signature]:
    """Signatures of scale and clock of the angle measurement, at one standard deviation."""
    row, run = problem.rows[0], problem.runs[0]
    lines = rfft(wheel_angle(run, given.model.structure, given.x) * run.taper)[row.bins] * row.weight
    late = lines * (-2j * np.pi * row.f) * ANGLE_CLOCK
    return [
        Signature("servo_test", name, size, np.concatenate((part.real, part.imag)))
        for name, size, part in (("scale", ANGLE_SCALE, lines * ANGLE_SCALE), ("clock", ANGLE_CLOCK, late))
    ]
