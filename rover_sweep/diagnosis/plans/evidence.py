"""Sensitivities and signatures of one planned run, compressed to few rows.

A plan needs only inner products of columns: what the nominal model absorbs, the length of a signature, the
cosine of two. A run is therefore simulated once, and a QR decomposition reduces its thousands of rows to as
many as there are columns, with the same inner products. Sets of runs are then cheap to stack.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy.fft import rfft

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.problem.least_squares import Fitted, sensitivities
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import Problem, Rows, whitened, with_floor
from rover_sweep.diagnosis.problem.signatures import Signature, signatures
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.structure import Structure
from rover_sweep.diagnosis.simulation.wheel_angle import wheel_angle

NOISE_AT = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0)  # Hz
NOISE = {
    "r": (1.3e-4, 1.2e-4, 1.1e-4, 1.1e-4, 7.5e-5, 4.5e-5, 2.2e-5, 1.1e-5, 3.2e-6, 1.2e-6, 5.6e-7, 3.2e-7),
    "ay": (2.0e-3, 2.2e-3, 2.5e-3, 3.2e-3, 4.0e-3, 3.5e-3, 2.6e-3, 1.8e-3, 1.6e-3, 1.2e-3, 8.5e-4, 6e-4),
    "p": (3.5e-6, 5.5e-6, 1.0e-5, 2.2e-5, 7.5e-5, 1.4e-4, 3.0e-4, 2.5e-4, 8.0e-5, 3.0e-5, 1.2e-5, 5.5e-6),
    "vy": (2.0e-4, 1.5e-4, 1.0e-4, 7.0e-5, 4.0e-5, 2.0e-5, 6.0e-6, 3.0e-6, 1.3e-6, 6e-7, 3e-7, 1.5e-7),
}
"""One-sided noise densities at `NOISE_AT`, unit^2/Hz: geometric means of the floors of recordings of five
rovers of 2.6 kg, on the official firmware, on two plants of different authors. The road shakes the rover, so
the noise has the shape of its yaw and roll response; single rovers differ by a factor of 3 below 2 Hz."""
TYPICAL = {"ln_C": log(2.5 / 3.0), "ln_b_phi": log(2.0)}
"""{coordinate: difference to the start of a fit}: in recordings of seven small rovers C is 2.1 to 2.7 times
m g/2, and the roll mode has 0.37 to 0.43 of its critical damping. A fit starts from half that damping, with
which roll steer would show twice as much."""
ANGLE_NOISE = 2 * np.radians(0.3) ** 2 / 60.0
"""rad^2/Hz: wheel angle with 0.3 deg rms at 60 Hz, by a camera or a potentiometer."""
ANGLE_BAND = (0.05, 8.0)  # Hz
ANGLE_SCALE, ANGLE_CLOCK = 0.03, 0.005
"""Standard deviations of the measurement on blocks: relative scale, and clock offset to the command [s]."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Columns of one run, compressed to k rows.

    nominal (k, m): sensitivities to the m nominal coordinates, in their scales. effects: signatures (k,) at
    a plain size. tolerances: signatures (k,) at one standard deviation of a normal rover. own_effects,
    own_tolerances: the same for what belongs to this run alone.
    """

    nominal: Array
    effects: tuple[Signature, ...]
    tolerances: tuple[Signature, ...]
    own_effects: tuple[Signature, ...]
    own_tolerances: tuple[Signature, ...]

    @property
    def size(self) -> int:
        """Number of rows."""
        return int(self.nominal.shape[0])


@dataclass(frozen=True, eq=False)
class OnBlocks(Problem):
    """The rover is on blocks and its wheel angle is measured; tyres and body have no effect."""

    def plain_models(self, structure: Structure, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The rows (size,) that the model predicts."""
        angles = [{"delta": wheel_angle(self.runs[0], structure, x)} for x in xs]
        return [whitened(self.rows, self.runs, [angle]) for angle in angles]


def evidence(
    run: Experiment,
    model: Model,
    effects: Sequence[Effect],
    at: Mapping[str, float] | None = None,
    floor: Floor | None = None,
) -> Evidence:
    """Columns of a run, the nominal model at its start values.

    at: {coordinate: size of the signature}, the plain size where a coordinate is not named. floor: noise of
    the driven runs, None for that of a small rover.
    """
    problem = on_blocks(run) if run.kind == "servo_test" else with_floor([run], floor or typical_floor())
    base = start(model, problem.size)
    problem = replace(problem, measured=problem.model(model.structure, base.x))
    nominal = sensitivities(problem, base).jacobian
    found = signatures(problem, base, model, effects, at)
    tolerances = signatures(problem, base, model, effects, tolerances=True)
    tolerances += with_nuisances(problem, model, base.x) or []
    return _few_rows(nominal, found, tolerances, {e.id for e in effects if e.in_one_run} | {"servo_test"})


def start(model: Model, rows: int) -> Fitted:
    """The nominal model of a typical rover, as a fit without residual."""
    x = {c.name: float(np.clip(c.start + TYPICAL.get(c.name, 0.0), c.low, c.high)) for c in model.free}
    return Fitted(model.structure, model.free, x, 0.0, np.zeros(rows), np.zeros((rows, 0)))


def typical_floor() -> Floor:
    """The noise floor of a small rover."""
    return Floor(np.array(NOISE_AT), {c: np.array(density) for c, density in NOISE.items()})


def on_blocks(run: Experiment) -> OnBlocks:
    f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
    bins = np.flatnonzero((f >= ANGLE_BAND[0]) & (f <= ANGLE_BAND[1]))
    weight = np.full(bins.size, 1.0 / np.sqrt(ANGLE_NOISE * RATE / 4 * np.sum(run.taper**2)))
    nothing = np.zeros(2 * bins.size)
    none = Floor(np.ones(1), {})  # the noise of the angle is in the weight
    return OnBlocks((run,), (), none, (Rows(0, "delta", bins, f[bins], weight, 0),), nothing, nothing)


def with_nuisances(problem: Problem, model: Model, x: Mapping[str, float]) -> list[Signature] | None:
    """Signatures of scale and clock of the angle measurement, at one standard deviation; None if driven."""
    if not isinstance(problem, OnBlocks):
        return None
    row, run = problem.rows[0], problem.runs[0]
    lines = rfft(wheel_angle(run, model.structure, x) * run.taper)[row.bins] * row.weight
    late = lines * (-2j * np.pi * row.f) * ANGLE_CLOCK
    return [
        Signature("servo_test", name, size, True, np.concatenate((part.real, part.imag)))
        for name, size, part in (("scale", ANGLE_SCALE, lines * ANGLE_SCALE), ("clock", ANGLE_CLOCK, late))
    ]


def _few_rows(
    nominal: Array, effects: Sequence[Signature], tolerances: Sequence[Signature], own: set[str]
) -> Evidence:
    both = (*effects, *tolerances)
    few: Array = np.asarray(np.linalg.qr(np.column_stack((nominal, *(s.rows for s in both))), mode="r"))
    turned = [replace(s, rows=few[:, nominal.shape[1] + k]) for k, s in enumerate(both)]
    found, small = turned[: len(effects)], turned[len(effects) :]
    return Evidence(
        few[:, : nominal.shape[1]],
        tuple(s for s in found if s.effect not in own),
        tuple(s for s in small if s.effect not in own),
        tuple(s for s in found if s.effect in own),
        tuple(s for s in small if s.effect in own),
    )
