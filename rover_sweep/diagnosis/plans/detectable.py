"""What a set of runs shows: the size at which each effect is found, and the pairs that look alike.

Two effects are told apart where noise and the little that every rover has leave no doubt, either being the
truth at twice its detectable size, and where their signatures are not nearly the same: then the least error
of the model would decide.
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
from rover_sweep.diagnosis.search.material import EARLIER, material_sizes
from rover_sweep.diagnosis.search.rounds import LAGS
from rover_sweep.diagnosis.search.threshold import null_distribution
from rover_sweep.diagnosis.simulation.candidates import Model

TRUTH = 2.0  # of its detectable size, at which an effect is told from its neighbours
SURE = (
    3.7  # length of what is left of a signature: `alike` then excludes the other (at 2 %) in 95 of 100 sets
)
ALIKE = 0.9  # cosine, from which two effects are not told apart whatever their size
LATE = 3.0  # times the size at which an effect counts: found only beyond that, it is found too late
FAINT = 1e-6


@dataclass(frozen=True)
class Size:
    """The detectable size of one parameter, as a coordinate.

    beyond: up to where the nominal model follows; column: of the signature that shows it.
    """

    parameter: EffectParameter
    coordinate: float
    beyond: float
    column: int


Sizes = Mapping[str, Mapping[str, Size]]


@dataclass(frozen=True, eq=False)
class Stacked:
    """Runs side by side: columns of the nominal model, of all effects, and of the little every rover has."""

    model: Model
    nominal: Array
    found: tuple[Signature, ...]
    tiny: tuple[Signature, ...]

    @staticmethod
    def of(model: Model, runs: Sequence[Evidence]) -> Stacked:
        """The set of these runs, each as often as it is driven; rows in sizes of the noise."""
        found = (*_common(runs, "effects"), *_apart(runs, "own_effects"))
        tiny = (*_common(runs, "tiny"), *_apart(runs, "own_tiny"))
        return Stacked(model, np.vstack([run.nominal for run in runs]), found, tiny)

    @cached_property
    def judged(self) -> Stacked:
        """The same in the metric in which noise and what an ordinary rover does anyhow count alike."""
        metric = Metric.of_directions(columns(self.tiny, self.nominal.shape[0]))
        found, tiny = (
            tuple(replace(s, rows=metric.of(s.rows)) for s in part) for part in (self.found, self.tiny)
        )
        return Stacked(self.model, metric.of(self.nominal), found, tiny)

    @cached_property
    def thresholds(self) -> Mapping[str, float]:
        """{effect: gain} as the bootstrap of a diagnosis on these runs has them."""
        judged = self.judged
        return null_distribution(judged.found, judged.tiny, tangent(judged._fitted(())), 1.0, 1).thresholds

    @cached_property
    def _outside(self) -> dict[frozenset[str], Array]:
        return {}

    def outside(self, held: Collection[str]) -> Array:
        """What of the k signatures the nominal model cannot reach while it holds some coordinates.

        (k, k): columns with the inner products of those of all rows.
        """
        key = frozenset(held)
        if key not in self._outside:
            rows = tangent(self._fitted(key)).outside(np.column_stack([s.rows for s in self.found]))
            self._outside[key] = np.asarray(np.linalg.qr(rows, mode="r"))
        return self._outside[key]

    def _fitted(self, held: Collection[str]) -> Fitted:
        """The nominal fit, with held coordinates at their upper bounds, where they do not move."""
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
        """Nominal coordinates that are at their bounds where this effect is a finding."""
        if effect in LAGS or effect == "clock_offset":
            return {"lag", "delay"}
        return {p.nominal for p in library()[effect].parameters if p.nominal} & set(self._start.x)

    @cached_property
    def _start(self) -> Fitted:
        return start(self.model, self.nominal.shape[0])

    @cached_property
    def sizes(self) -> Sizes:
        """{effect: {parameter: size}} of what shows; of columns of one run each that which shows best."""
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
        """{effect: how many times the size at which it counts it is found from}, beyond `LATE`."""
        out = {}
        for effect, size in ((e, next(iter(shown.values()))) for e, shown in self.sizes.items()):
            counts = material_sizes(library()[effect], self.model.spread).get(size.parameter.name, 0.0)
            if counts > 0 and size.coordinate > LATE * counts:
                out[effect] = size.coordinate / counts
        return out

    def cosine(self, one: str, two: str) -> float:
        """How alike the first looks to what the second can do, the nominal model refitted: at most 1."""
        rows = self.outside(self.held(one) | self.held(two))
        return max((self._explained(rows, k, two) for k in self.members[one]), default=0.0)

    def told_apart(self, one: str, two: str, sizes: Sizes | None = None) -> float:
        """By how much the first, being the truth, is told from the second: 1 and more is told apart.

        sizes: the detectable ones of a larger set that these runs are part of, None for their own.
        """
        held = self.held(one) | self.held(two)
        plain, judged = self.outside(held), self.judged.outside(held)
        sure = []
        for k in self.members[one]:
            if (size := (sizes or self.sizes)[one].get(self.found[k].parameter)) is None:
                continue
            strength = float(np.linalg.norm(judged[:, k])) / abs(self.found[k].size) * _per(self.found[k])
            length = strength * (TRUTH * size.coordinate - size.beyond)
            left = length * np.sqrt(1.0 - self._explained(judged, k, two) ** 2)
            apart = (1.0 - self._explained(plain, k, two) ** 2) / (1.0 - ALIKE**2)
            sure.append(min(left / SURE, apart))
        worst = max if library()[one].in_one_run else min  # a change of ground needs one good run
        return float(worst(sure))

    def _explained(self, rows: Array, k: int, effect: str) -> float:
        """Cosine of column k to the best that the effect's columns can do, one-sided ones with their sign."""
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
        """Which columns may come with either sign."""
        return [s.signed and parameter_of(s).low < 0 and not self._early(s.effect) for s in self.found]

    def _early(self, effect: str) -> bool:
        """With one clock an offset is only an answer before its command, the other way from a delay."""
        return effect == "clock_offset" and not self.model.two_clocks


def _common(runs: Sequence[Evidence], name: str) -> list[Signature]:
    lists = [getattr(run, name) for run in runs]
    return [
        replace(same[0], rows=np.concatenate([s.rows for s in same])) for same in zip(*lists, strict=True)
    ]


def _apart(runs: Sequence[Evidence], name: str) -> list[Signature]:
    """Columns of one run each, nothing in the others."""
    ends = np.cumsum([0, *(run.size for run in runs)])
    out = []
    for begin, run in zip(ends, runs, strict=False):
        for s in getattr(run, name):
            rows = np.zeros(int(ends[-1]))
            rows[begin : begin + run.size] = s.rows
            out.append(replace(s, rows=rows))
    return out


def parameter_of(s: Signature) -> EffectParameter:
    """The parameter whose signature it is."""
    return next(p for p in library()[s.effect].parameters if p.name == s.parameter)


def _per(s: Signature) -> float:
    return parameter_of(s).per


def _size(stacked: Stacked, k: int, rows: Array) -> Size | None:
    """The size that half of such sets would show, None where no believable one does."""
    s = stacked.found[k]
    effect, parameter = library()[s.effect], parameter_of(s)
    strength = float(np.linalg.norm(rows)) / abs(s.size) * _per(s)
    if strength < FAINT:
        return None
    beyond = _beyond(stacked.model, effect, parameter)
    needed = beyond + float(np.sqrt(stacked.thresholds[s.effect])) / strength
    least = material_sizes(effect, stacked.model.spread).get(parameter.name, 0.0)
    if s.effect in LAGS:  # with the other one as an ordinary rover has it
        other = "delay" if s.effect == "servo_lag" else "lag"
        least = stacked.model.spread.together - stacked._start.x[other]
    size = max(needed, least)
    return Size(parameter, size, beyond, k) if size <= parameter.high else None


def _beyond(model: Model, effect: Effect, parameter: EffectParameter) -> float:
    """How far the nominal model follows on its own, in the parameter's own unit."""
    if effect.id == "clock_offset" and not model.two_clocks:
        return EARLIER
    bound = {c.name: c.high for c in model.free if c.prior is None}
    return bound.get(parameter.nominal, 0.0) / parameter.per
