"""Both sides fitted with one model: the recordings' model and the effects that only the simulation has.

Missing terms of the model's equations bias both fits alike, so their difference shows how the sides differ
(indirect inference: Gourieroux, Monfort and Renault 1993, J. Applied Econometrics 8).

The tolerances of a vehicle file are widened here by about five: a simulation may have any numbers. Small
effects that every rover has get no tolerance: a compliant steering, for one, would hide a wrong Cf.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from types import MappingProxyType

import numpy as np
from scipy.fft import irfft, rfft

from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import form_named
from rover_sweep.diagnosis.posterior.model_fit import with_floor_of
from rover_sweep.diagnosis.posterior.parameter_intervals import fit_covariance
from rover_sweep.diagnosis.problem.least_squares import Fitted, cost_of, fit, sensitivities, with_speed_drift
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.candidates import Coordinate, Model, added_coordinates
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

# The fewest quantities whose difference explains the difference of two fits.
#
# With the difference d (k,) of the coordinates of both fits and its covariance S, and the candidates'
# columns B, the set T of candidates leaves
#
#     Q(T) = min over c of (d - B_T c)^T S^-1 (d - B_T c)
#
# The set with the least Q(T) + PENALTY |T| is searched by adding, removing and exchanging one at a time,
# from the full set and from the best of all sets of up to three (Miller 2002, Subset Selection in
# Regression). Under no difference, one of 30 candidates gains more than PENALTY in less than 1 % of cases.
# The law of an effect is never quite the true one, so a large effect leaves small false differences beside
# it: a candidate that gains less than SPILL of the largest effect is left out.


PENALTY = 14.0
SPILL = 0.01  # a true difference of 374 and a false one of 44 stood beside an effect of 32 000
ALL_OF = 3  # candidates of the sets that are all tried
MOST = 14  # candidates of one set
UNLIKELY = 0.02  # of the best set's probability
Chosen = tuple[int, ...]


class Subsets:
    """The costs of sets of candidates. whitened: d (k,) and each candidate's columns (k, m) in S^(-1/2).

    known: {candidate of one column: (its amount known beforehand, standard deviation)}.
    """

    def __init__(
        self,
        difference: Array,
        covariance: Array,
        candidates: Sequence[Array],
        known: Mapping[int, tuple[float, float]] = MappingProxyType({}),
    ) -> None:
        values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
        root = axes / np.sqrt(np.maximum(values, 1e-12 * values[-1]))
        before = [amount / sd for amount, sd in known.values()]
        rows = {k: [[float(k == j) / sd] for j, (_, sd) in known.items()] for k in known}
        absent = [np.zeros((len(known), c.shape[1])) for c in candidates]
        self.difference = np.concatenate((difference @ root, before))
        self.columns = [np.vstack((root.T @ c, rows.get(k, absent[k]))) for k, c in enumerate(candidates)]
        self._known: dict[frozenset[int], float] = {}

    def left(self, chosen: Sequence[int]) -> float:
        """Q of a set."""
        key = frozenset(chosen)
        if key not in self._known:
            self._known[key] = self._left(sorted(key))
        return self._known[key]

    def _left(self, chosen: Sequence[int]) -> float:
        if not chosen:
            return float(self.difference @ self.difference)
        b = np.column_stack([self.columns[k] for k in chosen])
        q, r = np.linalg.qr(b)
        size = np.abs(np.diag(r))
        seen = q[:, size > 1e-9 * max(float(size.max()), 1e-300)].T @ self.difference
        return float(self.difference @ self.difference - seen @ seen)

    def amount(self, k: int, chosen: Sequence[int]) -> tuple[float, float]:
        """(amount of a candidate's first column with a set, its standard deviation)."""
        others = [c for c in chosen if c != k]
        b = np.column_stack([self.columns[k], *(self.columns[c] for c in others)])
        inverse = np.linalg.pinv(b.T @ b, rcond=1e-12)
        return float((inverse @ b.T @ self.difference)[0]), float(np.sqrt(max(inverse[0, 0], 0.0)))

    def score(self, chosen: Sequence[int]) -> float:
        """Q plus the penalty of its parameters."""
        return self.left(chosen) + PENALTY * sum(self.columns[k].shape[1] for k in chosen)

    def likely(self, best: Chosen) -> dict[Chosen, float]:
        """{set: probability} of a set and those that differ from it in one candidate, if above `UNLIKELY`.

        The score is -2 ln of a probability plus a constant.
        """
        near = dict.fromkeys((best, *_neighbours(self, best)))
        weights = {s: float(np.exp(0.5 * (self.score(best) - self.score(s)))) for s in near}
        whole = sum(w for w in weights.values() if w > UNLIKELY)
        return {s: w / whole for s, w in weights.items() if w > UNLIKELY}


def fewest(subsets: Subsets, effects: Collection[int] = ()) -> Chosen:
    """The best set that the search finds, in order of the candidates. effects: those that are effects."""
    every = range(len(subsets.columns))
    full = tuple(every)
    while len(full) > MOST:  # without those that cost least to remove
        full = min((_without(full, k) for k in full), key=subsets.left)
    some = [min(combinations(every, n), key=subsets.score) for n in range(min(ALL_OF, len(every)) + 1)]
    chosen = min((_improved(subsets, start) for start in (full, *some)), key=subsets.score)
    while chosen:
        gains = {k: subsets.left(_without(chosen, k)) - subsets.left(chosen) for k in chosen}
        least = min(chosen, key=lambda k: gains[k])
        if gains[least] >= SPILL * max((gains[k] for k in chosen if k in effects), default=0.0):
            break
        chosen = _without(chosen, least)
    return chosen


def _improved(subsets: Subsets, chosen: Chosen) -> Chosen:
    while True:
        best = min(_neighbours(subsets, chosen), key=subsets.score)
        if subsets.score(best) >= subsets.score(chosen) - 1e-9:
            return chosen
        chosen = best


def _neighbours(subsets: Subsets, chosen: Chosen) -> Iterator[Chosen]:
    others = [k for k in range(len(subsets.columns)) if k not in chosen]
    if len(chosen) < MOST:
        yield from (tuple(sorted((*chosen, k))) for k in others)
    for gone in chosen:
        rest = _without(chosen, gone)
        yield rest
        yield from (tuple(sorted((*rest, k))) for k in others)


def _without(chosen: Chosen, gone: int) -> Chosen:
    return tuple(k for k in chosen if k != gone)


WIDE = Tolerances(
    lag=0.25,
    delay=0.25,
    early=0.03,  # a simulation may log its step's end with the input of its beginning
    ratio=1.0,
    bias_ay=1.5,
    trim=0.06,
    scale=0.10,
    speed=0.01,
    cg=0.05,
    h=0.20,
    roll_inertia=0.30,
    imu_x=0.08,
    imu_z=0.08,
    sensor_lag=0.010,
    velocity_gain=0.10,
    velocity_lag=0.30,
    heading=0.05,
    together=0.20,
    bend=1.5,
)
NEAR = 1e-3  # of a coordinate's scale: at its bound
KNOWN_ABSENT = 0.1  # standard deviation over an effect's usual size, of one that a side does not have
ABSENT, STEP = 0.3, 0.5  # of an effect's usual size: absent below, and step of its difference quotient
QUIET = 0.5  # share of the recordings' noise density below which a simulation has its noise added
SEED = 5
OF_THE_DAY = {"speed_share"}  # an error of the recording, which says nothing about the rover


@dataclass(frozen=True, eq=False)
class FittedSide:
    """One side fitted with the common model.

    plain: the problem without tolerances. problem: in their metric, in which the model is `fitted`, with its
    Jacobian there. covariance (k, k): of the coordinates over their scales. Those of `OF_THE_DAY` are fitted,
    but not in the k.
    """

    plain: Problem
    problem: Problem
    fitted: Fitted
    covariance: Array

    @property
    def model(self) -> Model:
        """The common model."""
        return self.fitted.model

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The k coordinates in which two sides are compared."""
        return of_the_rover(self.fitted.free)

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Names of coordinates with a prior that ended at a bound, three standard deviations away."""
        x = self.fitted.x
        return tuple(
            c.name
            for c in self.coordinates
            if c.prior and c.low < 0.0 and not c.low + NEAR * c.scale < x[c.name] < c.high - NEAR * c.scale
        )

    def at_largest(self, name: str) -> bool:
        """True if an effect's fit ended at the largest size of a vehicle: it measures nothing."""
        added = {c.name for c in added_coordinates(self.model.law(name))}
        return any(
            end and abs(self.fitted.x[c.name] - end) <= NEAR * c.scale
            for c in self.coordinates
            if c.name in added
            for end in (c.low, c.high)
        )

    @property
    def values(self) -> Array:
        """The coordinates (k,) over their scales."""
        return np.array([self.fitted.x[c.name] / c.scale for c in self.coordinates])


def of_the_rover(free: Sequence[Coordinate]) -> tuple[Coordinate, ...]:
    """`free` without errors of the recording (`OF_THE_DAY`)."""
    return tuple(c for c in free if c.name not in OF_THE_DAY)


def common_model(recordings: AugmentedModel, effects: Sequence[str], roll_seen: bool = True) -> Model:
    """The model of the recordings with wide tolerances, and the simulation's effects, by name.

    roll_seen: False if no compared channel shows roll: a model without it then replaces roll-yaw.
    """
    own = {form_named(name).id for name in recordings.effects}
    more = tuple(name for name in effects if form_named(name).id not in own)
    bare = recordings.baseline == "roll-yaw" and not roll_seen and not recordings.effects
    return Model(
        "bicycle" if bare else recordings.baseline,
        recordings.rover,
        WIDE,
        (*recordings.effects, *more),
        recordings.happened_in,
        happened_order=recordings.happened_order,
    )


def side_of(
    runs: Sequence[Experiment], model: Model, start: Mapping[str, float], present: Sequence[str] | None = ()
) -> FittedSide:
    """The model fitted to one side. start: {coordinate: value} to begin from.

    present: ids of the effects that this side may have; the others stay absent. None: all, if that lowers the
    cost by more than chance, else none. An effect that is fitted to a side without it may end in a false
    minimum, or take a part of a lag.
    """
    every = {form_named(name).id for name in model.effects}
    plain, closest = _closest(runs, model, start, every if present is None else set(present))
    if present is None and every:
        bare = _closest(runs, model, start, set())
        added = sum(len(added_coordinates(model.law(name))) for name in model.effects)
        if cost_of(bare[0], bare[1]) < cost_of(bare[0], closest) + PENALTY * added:
            plain, closest = bare
    metric = with_speed_drift(plain, closest)
    fitted = fit(metric, model, closest.x, closest.free)
    held = {c.name for c in model.free} - {c.name for c in closest.free}
    own = {c.name for name in model.effects for c in added_coordinates(model.law(name))}
    # the first small part of many laws changes nothing
    stepped = tuple(
        replace(c, step=STEP) if c.name in own and abs(fitted.x[c.name]) < ABSENT * c.scale else c
        for c in model.free
    )
    fitted = replace(sensitivities(metric, replace(fitted, free=stepped)), free=model.free)
    return FittedSide(plain, metric, fitted, _covariance(metric, fitted, held))


def _covariance(problem: Problem, fitted: Fitted, held: set[str]) -> Array:
    """Covariance (k, k) of the sides' coordinates; those that are held are known to be absent."""
    free = np.array([c.name not in held for c in fitted.free])
    kept = replace(
        fitted, free=tuple(c for c in fitted.free if c.name not in held), jacobian=fitted.jacobian[:, free]
    )
    out = np.diag(np.where(free, 0.0, KNOWN_ABSENT**2))
    out[np.ix_(free, free)] = fit_covariance(problem, kept)
    compared = np.array([c.name not in OF_THE_DAY for c in fitted.free])
    return out[np.ix_(compared, compared)]


def _closest(
    runs: Sequence[Experiment], model: Model, start: Mapping[str, float], present: set[str]
) -> tuple[Problem, Fitted]:
    """The fit with the floor of its own residual; effects that are not present are held at 0."""
    absent = {
        c.name
        for name in model.effects
        if form_named(name).id not in present
        for c in added_coordinates(model.law(name))
    }
    x = {**model.start, **start, **dict.fromkeys(absent, 0.0)}
    free = tuple(c for c in model.free if c.name not in absent)
    problem = with_floor_of(runs, model, x)
    # a simulation may have any numbers, also those of the vehicle file
    starts = (x, {**x, **{c.name: c.start for c in free if c.name not in absent}})
    first = min((fit(problem, model, start, free, roughly=True) for start in starts), key=lambda e: e.cost)
    problem = with_floor_of(runs, model, first.x)  # the start was far off, and its residual no noise
    return problem, fit(problem, model, first.x, free)


def as_noisy(runs: Sequence[Experiment], own: Floor, floor: Floor) -> list[Experiment]:
    """Simulated runs with the recordings' noise added in channels that have less than half of it.

    own, floor: of the simulation, of the recordings. Without noise every small term of a law would count.
    """
    random, out = np.random.default_rng(SEED), []
    both = [c for c in own.density if c in floor.density]
    quiet = [c for c in both if own.rms(c, 0.5, 8.0) ** 2 < QUIET * floor.rms(c, 0.5, 8.0) ** 2]
    for run in runs:
        measured = dict(run.measured)
        f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
        for channel in (c for c in run.measured if c in quiet):
            white = rfft(random.standard_normal(run.t.size))
            density = np.where(f < floor.f[1], 0.0, floor.at(channel, f))  # below, drift and not noise
            noise = irfft(white * np.sqrt(0.5 * RATE * density), run.t.size)
            measured[channel] = measured[channel] + noise
        out.append(replace(run, measured=measured))
    return out
