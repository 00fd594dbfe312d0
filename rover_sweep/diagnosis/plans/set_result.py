"""What a set of runs can detect: the detectable size of each effect, and the pairs that look alike.

Two effects are separated if, with either one present at twice its detectable size, noise and the normal
tolerances of a rover leave no doubt which one it is. Their signatures must also differ clearly: if they are
nearly equal, the smallest error of the model would decide.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import nnls

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter, library
from rover_sweep.diagnosis.plans.evidence import Evidence, start
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Metric
from rover_sweep.diagnosis.problem.signatures import Signature, columns
from rover_sweep.diagnosis.search.candidate_fits import tangent
from rover_sweep.diagnosis.search.material import EARLIER, LAGS, material_sizes
from rover_sweep.diagnosis.search.threshold import null_distribution
from rover_sweep.diagnosis.simulation.candidates import Model

TRUE_SIZE = 2.0  # times the detectable size: the size at which effects must be separated
# length of the part of a signature that the other effect cannot explain: the other one is then excluded, at
# the 2 % level of `look_alikes`, in 95 of 100 sets of runs
SEPARATED = 3.7
MOST_ALIKE = 0.9  # cosine of two signatures above which no size separates the effects
LATE = 3.0  # times the size that matters: an effect is found late if it is detectable only above this
FAINT = 1e-6


@dataclass(frozen=True)
class Size:
    """The detectable size of one parameter, as a coordinate.

    upper_bound: up to where the nominal model can take its place. column: index of its signature.
    """

    parameter: EffectParameter
    coordinate: float
    upper_bound: float
    column: int


Sizes = Mapping[str, Mapping[str, Size]]


@dataclass(frozen=True, eq=False)
class Stacked:
    """A set of runs: columns of the nominal model, signatures of all effects and of the tolerances.

    The rows of the runs are stacked, in units of the noise. nominal (rows, m). found, tolerances: signatures
    of (rows,) each.
    """

    model: Model
    nominal: Array
    found: tuple[Signature, ...]
    tolerances: tuple[Signature, ...]

    @staticmethod
    def of(model: Model, runs: Sequence[Evidence]) -> Stacked:
        """The set of these runs, each as often as it is driven."""
        found = (*_common(runs, "effects"), *_single(runs, "own_effects"))
        tolerances = (*_common(runs, "tolerances"), *_single(runs, "own_tolerances"))
        return Stacked(model, np.vstack([run.nominal for run in runs]), found, tolerances)

    @cached_property
    def judged(self) -> Stacked:
        """The same in the metric of noise and normal tolerances together."""
        metric = Metric.of_directions(columns(self.tolerances, self.nominal.shape[0]))
        found, tolerances = (
            tuple(replace(s, rows=metric.of(s.rows)) for s in part) for part in (self.found, self.tolerances)
        )
        return Stacked(self.model, metric.of(self.nominal), found, tolerances)

    @cached_property
    def thresholds(self) -> Mapping[str, float]:
        """{effect: fall of chi-squared that a diagnosis of these runs would require}."""
        judged = self.judged
        return null_distribution(
            judged.found, judged.tolerances, tangent(judged._fitted(())), 1.0, 1
        ).thresholds

    @cached_property
    def _outside(self) -> dict[frozenset[str], Array]:
        return {}

    def outside(self, held: Collection[str]) -> Array:
        """The part of the k signatures that the nominal model cannot explain with some coordinates held.

        (k, k): columns with the same inner products as the full rows.
        """
        key = frozenset(held)
        if key not in self._outside:
            rows = tangent(self._fitted(key)).outside(np.column_stack([s.rows for s in self.found]))
            self._outside[key] = np.asarray(np.linalg.qr(rows, mode="r"))
        return self._outside[key]

    def _fitted(self, held: Collection[str]) -> Fitted:
        """The nominal fit with the held coordinates at their upper bounds."""
        base = self._start
        x = dict(base.x) | {c.name: c.high for c in base.free if c.name in held}
        return replace(base, x=x, jacobian=self.nominal)

    @cached_property
    def members(self) -> dict[str, list[int]]:
        """{effect: its columns}."""
        out: dict[str, list[int]] = {}
        for k, s in enumerate(self.found):
            out.setdefault(s.effect, []).append(k)
        return out

    def held(self, effect: str) -> set[str]:
        """Nominal coordinates that are at their bounds when this effect is a finding."""
        if effect in LAGS or effect == "clock_offset":
            return {"lag", "delay"}
        return {p.nominal for p in library()[effect].parameters if p.nominal} & set(self._start.x)

    @cached_property
    def _start(self) -> Fitted:
        return start(self.model, self.nominal.shape[0])

    @cached_property
    def sizes(self) -> Sizes:
        """{effect: {parameter: size}} of the detectable parameters; the smallest if each run has a column."""
        out: dict[str, dict[str, Size]] = {}
        for effect, members in self.members.items():
            rows = self.judged.outside(self.held(effect))
            for k in members:
                size, shown = _size(self, k, rows[:, k]), out.get(effect, {})
                least = shown.get(self.found[k].parameter)
                if size and (least is None or size.coordinate < least.coordinate):
                    out[effect] = shown | {self.found[k].parameter: size}
        return out

    @cached_property
    def late(self) -> dict[str, float]:
        """{effect: detectable size over the size that matters}, where that is above `LATE`."""
        out = {}
        for effect, size in ((e, next(iter(shown.values()))) for e, shown in self.sizes.items()):
            every = material_sizes(self.model.law(effect), self.model.spread, self.model.rover.wheelbase)
            matters = every.get(size.parameter.name, 0.0)
            if matters > 0 and size.coordinate > LATE * matters:
                out[effect] = size.coordinate / matters
        return out

    def cosine(self, one: str, two: str) -> float:
        """Cosine of the first to its best fit by the second, the nominal model refitted; at most 1."""
        rows = self.outside(self.held(one) | self.held(two))
        return max((self._explained(rows, k, two) for k in self.members[one]), default=0.0)

    def separation(self, one: str, two: str, sizes: Sizes | None = None) -> float:
        """How clearly the first effect, if present, is separated from the second; 1 or more is separated.

        sizes: detectable sizes of a larger set that these runs are part of; None: their own. The first effect
        has `TRUE_SIZE` times its detectable size; the second explains all of it but the length
        L sqrt(1 - cos^2), which must exceed `SEPARATED` in standard deviations of noise and tolerances.
        """
        held = self.held(one) | self.held(two)
        plain, judged = self.outside(held), self.judged.outside(held)
        found = []
        for k in self.members[one]:
            s = self.found[k]
            if (size := (sizes or self.sizes)[one].get(s.parameter)) is None:
                continue
            strength = float(np.linalg.norm(judged[:, k])) / abs(s.size) * parameter_of(s).per
            length = strength * (TRUE_SIZE * size.coordinate - size.upper_bound)
            left = length * np.sqrt(1.0 - self._explained(judged, k, two) ** 2)
            distinct = (1.0 - self._explained(plain, k, two) ** 2) / (1.0 - MOST_ALIKE**2)
            found.append(min(left / SEPARATED, distinct))
        worst = max if library()[one].in_one_run else min  # one good run is enough for a change of ground
        return float(worst(found))

    def _explained(self, rows: Array, k: int, effect: str) -> float:
        """Cosine of column k to its best fit by the effect's columns; one-sided columns keep their sign."""
        target, size = rows[:, k], float(np.linalg.norm(rows[:, k]))
        others = self.members[effect]
        if size < FAINT:
            return 0.0
        sign = -1.0 if self._early(self.found[k].effect) else 1.0
        single = library()[effect].in_one_run
        ways = (1.0, -1.0) if self._free[k] else (sign,)
        best = 0.0
        for group in [[o] for o in others] if single else [others]:
            block = self._directed(rows, group, effect)
            left = min(float(nnls(block, way * target)[1]) for way in ways)
            best = max(best, 1.0 - (left / size) ** 2)
        return float(np.sqrt(min(max(best, 0.0), 1.0)))

    def _directed(self, rows: Array, group: Sequence[int], effect: str) -> Array:
        part = rows[:, group]
        if self._early(effect):
            return -part
        return np.hstack((part, -part)) if self._free[group[0]] else part

    @cached_property
    def _free(self) -> list[bool]:
        """For each column, whether both signs are possible."""
        return [s.signed and parameter_of(s).low < 0 and not self._early(s.effect) for s in self.found]

    def _early(self, effect: str) -> bool:
        """With one clock an offset shows only as a response before its command, unlike a delay."""
        return effect == "clock_offset" and not self.model.two_clocks


def _common(runs: Sequence[Evidence], name: str) -> list[Signature]:
    lists = [getattr(run, name) for run in runs]
    return [
        replace(same[0], rows=np.concatenate([s.rows for s in same])) for same in zip(*lists, strict=True)
    ]


def _single(runs: Sequence[Evidence], name: str) -> list[Signature]:
    """Columns that belong to one run each, zero in the other runs."""
    ends = np.cumsum([0, *(run.size for run in runs)])
    out = []
    for begin, run in zip(ends, runs, strict=False):
        for s in getattr(run, name):
            rows = np.zeros(int(ends[-1]))
            rows[begin : begin + run.size] = s.rows
            out.append(replace(s, rows=rows))
    return out


def parameter_of(s: Signature) -> EffectParameter:
    """The parameter of a signature."""
    return next(p for p in library()[s.effect].parameters if p.name == s.parameter)


def _size(stacked: Stacked, k: int, rows: Array) -> Size | None:
    """The size that is found in half of repeats, None if it would be above the parameter's bound.

    rows (k,): the part of the signature that the nominal model cannot explain, in the metric of noise and
    tolerances. Per coordinate its length is d. At the coordinate q the nominal model takes the place of the
    effect up to its bound q0, so chi-squared falls by (d (q - q0))^2 on average. An effect is found if the
    fall exceeds the threshold; noise makes it larger or smaller equally often. Hence half of repeats find
    q = q0 + sqrt(threshold)/d. The size is not below the one that matters.
    """
    s = stacked.found[k]
    effect = stacked.model.law(s.effect)
    parameter = next(p for p in effect.parameters if p.name == s.parameter)
    strength = float(np.linalg.norm(rows)) / abs(s.size) * parameter.per
    if strength < FAINT:
        return None
    upper_bound = _upper_bound(stacked.model, effect, parameter)
    needed = upper_bound + float(np.sqrt(stacked.thresholds[s.effect])) / strength
    model = stacked.model
    least = material_sizes(effect, model.spread, model.rover.wheelbase).get(parameter.name, 0.0)
    if s.effect in LAGS:  # the other lag as in a normal rover
        other = "delay" if s.effect == "servo_lag" else "lag"
        least = stacked.model.spread.together - stacked._start.x[other]
    size = max(needed, least)
    return Size(parameter, size, upper_bound, k) if size <= parameter.high else None


def _upper_bound(model: Model, effect: Effect, parameter: EffectParameter) -> float:
    """The coordinate up to which the nominal model can take the effect's place."""
    if effect.id == "clock_offset" and not model.two_clocks:
        return EARLIER
    bound = {c.name: c.high for c in model.free if c.prior is None}
    return bound.get(parameter.nominal, 0.0) / parameter.per
