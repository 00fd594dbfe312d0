"""Both sides fitted with one model: the recordings' model and the effects that only the simulation has.

What the equations of the model lack biases both fits alike, so their difference shows what differs between
the sides (indirect inference: Gourieroux, Monfort and Renault 1993, J. Applied Econometrics 8).

The tolerances of a vehicle file are widened here by about five: a simulation may have any numbers. Small
effects that every rover has are not allowed for: a compliant steering, for one, would hide a wrong Cf.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, rfft

from rover_sweep.data.recording import Array
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import form_named
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.problem.signatures import columns
from rover_sweep.diagnosis.problem.speed_drift import speed_drift
from rover_sweep.diagnosis.search.bounds import cost_of
from rover_sweep.diagnosis.search.parameter_intervals import fit_covariance
from rover_sweep.diagnosis.search.rounds import fit_with_floor
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.candidates import Model, added_coordinates
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.nominal import Coordinate

WIDE = Tolerances(
    lag=0.25,
    delay=0.25,
    ratio=1.0,
    bias_ay=1.5,
    trim=0.06,
    scale=0.10,
    speed=0.01,
    cg=0.02,
    h=0.20,
    roll_inertia=0.30,
    imu=0.03,
    sensor_lag=0.010,
    velocity_gain=0.10,
    velocity_lag=0.30,
    heading=0.05,
    together=0.20,
)
ABSENT, STEP = 0.3, 0.5  # of an effect's usual size: absent below, and step of its difference quotient
QUIET = 0.5  # share of the recordings' noise density below which a simulation has its noise added
SEED = 5


@dataclass(frozen=True, eq=False)
class FittedSide:
    """One side fitted with the common model.

    plain: the problem without tolerances. problem: in their metric, in which the model is `fitted`, with its
    Jacobian there. covariance (k, k): of the coordinates over their scales.
    """

    model: Model
    plain: Problem
    problem: Problem
    fitted: Fitted
    covariance: Array

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The k fitted coordinates."""
        return self.fitted.free

    @property
    def values(self) -> Array:
        """The coordinates (k,) over their scales."""
        return np.array([self.fitted.x[c.name] / c.scale for c in self.fitted.free])


def common_model(recordings: AugmentedModel, effects: Sequence[str]) -> Model:
    """The model of the recordings with wide tolerances, and the simulation's effects, by name."""
    own = {form_named(name).id for name in recordings.effects}
    more = tuple(name for name in effects if form_named(name).id not in own)
    return Model(
        recordings.baseline,
        recordings.rover,
        WIDE,
        (*recordings.effects, *more),
        recordings.happened_in,
        happened_order=recordings.happened_order,
    )


def side_of(runs: Sequence[Experiment], model: Model, *starts: Mapping[str, float]) -> FittedSide:
    """The model fitted to one side. starts: {coordinate: value} to begin from; the best fit counts.

    A simulation without an effect of the recordings, fitted from its size there, may end in a false minimum.
    """
    fits = [fit_with_floor(runs, model, start, near=True) for start in starts]
    problem = fits[0][0]  # one floor for all, since a bad fit raises its own
    plain, closest = min(fits, key=lambda one: cost_of(problem, one[1]))
    metric = plain.in_metric(columns(speed_drift(plain, closest), plain.size))
    fitted = _seen(metric, fit(metric, model.structure, model.free, closest.x), model)
    return FittedSide(model, plain, metric, fitted, fit_covariance(metric, fitted))


def without_effects(model: Model, x: Mapping[str, float], kept: Sequence[str] = ()) -> dict[str, float]:
    """The coordinates with the added ones of the effects at 0, but for those that are kept, by their ids."""
    gone = {
        c.name
        for name in model.effects
        if form_named(name).id not in kept
        for c in added_coordinates(model.law(name))
    }
    return {name: 0.0 if name in gone else value for name, value in x.items()}


def _seen(problem: Problem, fitted: Fitted, model: Model) -> Fitted:
    """The fit with its Jacobian; of an absent effect by a step of half its usual size.

    The first small part of many laws changes nothing.
    """
    added = {c.name for name in model.effects for c in added_coordinates(model.law(name))}

    def absent(c: Coordinate) -> bool:
        return c.name in added and abs(fitted.x[c.name]) < ABSENT * c.scale

    stepped = tuple(replace(c, step=STEP) if absent(c) else c for c in fitted.free)
    return replace(sensitivities(problem, replace(fitted, free=stepped)), free=fitted.free)


def as_noisy(runs: Sequence[Experiment], own: Floor, floor: Floor) -> list[Experiment]:
    """Simulated runs with the recordings' noise added in channels that have less than half of it.

    own, floor: of the simulation, of the recordings. Without noise every small term of a law would count.
    """
    random = np.random.default_rng(SEED)
    return [_with_noise(run, own, floor, random) for run in runs]


def _with_noise(run: Experiment, own: Floor, floor: Floor, random: np.random.Generator) -> Experiment:
    measured = dict(run.measured)
    f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
    for channel, y in run.measured.items():
        if channel in own.density and channel in floor.density and _quieter(channel, own, floor):
            white = rfft(random.standard_normal(y.size))
            measured[channel] = y + irfft(white * np.sqrt(0.5 * RATE * floor.at(channel, f)), y.size)
    return replace(run, measured=measured)


def _quieter(channel: str, own: Floor, floor: Floor) -> bool:
    return own.rms(channel, 0.5, 8.0) ** 2 < QUIET * floor.rms(channel, 0.5, 8.0) ** 2
