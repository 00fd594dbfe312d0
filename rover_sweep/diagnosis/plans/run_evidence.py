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
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.problem.least_squares import Fitted, sensitivities
from rover_sweep.diagnosis.problem.model_error import COMMON, OWN, model_error
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import Problem, Rows, whitened, with_floor
from rover_sweep.diagnosis.problem.signatures import Signature, columns, signatures
from rover_sweep.diagnosis.problem.speed_drift import speed_drift
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.structure import Structure
from rover_sweep.diagnosis.simulation.wheel_angle import wheel_angle

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


@dataclass(frozen=True)
class AngleMeasurement:
    """A camera or a potentiometer at a wheel of a rover on blocks: 0.3 deg rms at 60 Hz.

    noise [rad^2/Hz], band [Hz]. scale, clock: standard deviations of the relative scale and of the offset to
    the command [s].
    """

    noise: float = 2 * (0.3 * np.pi / 180.0) ** 2 / 60.0
    band: tuple[float, float] = (0.05, 8.0)
    scale: float = 0.03
    clock: float = 0.005


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
    """The noise floor and the coordinates {name: value} of the nominal model that a plan assumes."""

    floor: Floor
    x: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class OnBlocks(Problem):
    """The rover is on blocks and its wheel angle is measured; tyres and body have no effect."""

    def plain_models(self, structure: Structure, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The rows (size,) that the model predicts."""
        angles = [{"delta": wheel_angle(self.runs[0], structure, x)} for x in xs]
        return [whitened(self.rows, self.runs, [angle]) for angle in angles]


def reaches(effects: Sequence[Effect], model: Model, x: Mapping[str, float]) -> dict[Key, Reach]:
    """{column: from where to where its signature reaches}, to each parameter at its own size."""
    bounds = {c.name: c for c in model.free}
    out: dict[Key, Reach] = {}
    for effect in effects:
        free = {c.name: c for c in model.with_effect(effect.name).free}
        for p in effect.parameters:
            if p.name == "t" or p.size == 0.0 or (p.nominal and p.nominal not in bounds):
                continue
            start, distance = 0.0, p.size * p.per
            released = free[effect.coordinate_name(p)]
            if p.nominal:
                upwards = released.high > bounds[p.nominal].high
                start = bounds[p.nominal].high if upwards else bounds[p.nominal].low
                distance = distance if upwards else -distance
            out[effect.id, p.name] = Reach(start, distance, released.high if distance > 0.0 else released.low)
    return out


def assumed(driven: Sequence[Experiment], model: Model) -> Assumed:
    """The noise floor and the model fitted to the recordings, of a small rover where there are none."""
    usual = {c.name: float(np.clip(c.start + TYPICAL.get(c.name, 0.0), c.low, c.high)) for c in model.free}
    floor = Floor(np.array(NOISE["Hz"]), {c: np.array(d) for c, d in NOISE.items() if c != "Hz"})
    moving = [run for run in driven if run.kind != "servo_test"]
    if not moving:
        return Assumed(floor, usual)
    problem, fitted = fit_with_floor(moving, model, usual, near=True)
    density = {c: floor.at(c, problem.floor.f) for c in floor.density} | dict(problem.floor.density)
    return Assumed(Floor(problem.floor.f, density), fitted.x)


def basis(run: Experiment, model: Model, effects: Sequence[Effect], given: Assumed) -> Basis:
    """The columns of a run without the effects."""
    blocks = run.kind == "servo_test"
    problem = _on_blocks(run) if blocks else with_floor([run], given.floor)
    nothing = np.zeros(problem.size)
    base = Fitted(model.structure, model.free, given.x, 0.0, nothing, nothing[:, None])
    problem = replace(problem, measured=problem.model(model.structure, given.x))
    base = sensitivities(problem, base)
    alone = {e.id for e in effects if e.in_one_run}
    usual = signatures(problem, base, model, effects, tolerances=True)
    shared, own = [s for s in usual if s.effect not in alone], [s for s in usual if s.effect in alone]
    if blocks:
        own += _measured(problem, model, given.x)
    else:
        errors = model_error(problem, base)
        shared += errors
        own += [*speed_drift(problem, base), *(replace(s, rows=s.rows * (OWN / COMMON)) for s in errors)]
    keys = [("nominal", c.name) for c in model.free] + [
        ("usual", f"{s.effect} {s.parameter}") for s in shared
    ]
    rows = np.column_stack((base.jacobian, *(s.rows for s in shared)))
    return Basis(problem, base, tuple(keys), rows, columns(own, problem.size))


def evidence(run: Basis, model: Model, effects: Sequence[Effect], reach: Mapping[Key, Reach]) -> RunEvidence:
    """The columns of a run with the signatures of effects as far as they reach."""
    found = [s for e in effects for s in _signatures(run, model, e, reach)]
    every = np.column_stack((run.rows, *(s.rows for s in found)))
    across = every.T @ run.own
    left = np.linalg.solve(np.eye(run.own.shape[1]) + run.own.T @ run.own, across.T)
    gram: Array = np.asarray(every.T @ every - across @ left)
    values, vectors = np.linalg.eigh(gram)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return RunEvidence((*run.keys, *((s.effect, s.parameter) for s in found)), gram, root)


def _signatures(run: Basis, model: Model, effect: Effect, reach: Mapping[Key, Reach]) -> list[Signature]:
    """The signatures of one effect; two effects may move the same nominal coordinate."""
    out = []
    for p in effect.parameters:
        if one := reach.get((effect.id, p.name)):
            at = {effect.coordinate_name(p): one.distance}
            base = replace(run.base, x={**run.base.x, p.nominal: one.start}) if p.nominal else run.base
            law = replace(effect, parameters=(p, *(q for q in effect.parameters if q.name == "t")))
            out += signatures(run.problem, base, model, [law], at)
    return out


def _on_blocks(run: Experiment) -> OnBlocks:
    angle = AngleMeasurement()
    f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
    bins = np.flatnonzero((f >= angle.band[0]) & (f <= angle.band[1]))
    weight = np.full(bins.size, 1.0 / np.sqrt(angle.noise * RATE / 4 * np.sum(run.taper**2)))
    nothing = np.zeros(2 * bins.size)
    none = Floor(np.ones(1), {})  # the noise of the angle is in the weight
    return OnBlocks((run,), (), none, (Rows(0, "delta", bins, f[bins], weight, 0),), nothing, nothing)


def _measured(problem: Problem, model: Model, x: Mapping[str, float]) -> list[Signature]:
    """Signatures of scale and clock of the angle measurement, at one standard deviation."""
    angle, row, run = AngleMeasurement(), problem.rows[0], problem.runs[0]
    lines = rfft(wheel_angle(run, model.structure, x) * run.taper)[row.bins] * row.weight
    late = lines * (-2j * np.pi * row.f) * angle.clock
    return [
        Signature("servo_test", name, size, True, np.concatenate((part.real, part.imag)))
        for name, size, part in (("scale", angle.scale, lines * angle.scale), ("clock", angle.clock, late))
    ]
