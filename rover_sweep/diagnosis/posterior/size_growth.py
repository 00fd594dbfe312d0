"""How the signature of an effect grows with its size, for the bound of an effect that was not found.

An effect of the coordinate q, with the nominal model refitted, adds rows of the length L(q). Where the
nominal model has the coordinate itself, it takes the effect's place up to its bound, and L begins there. With
a prior of the standard deviation s instead of bounds, it takes a part of the effect's place at a cost:
L = q/sqrt(s^2 + (q/L)^2).

The two signs of an effect differ: towards oversteer a given Cf/Cr shows several times more than towards
understeer. Both are computed. L of a limit grows steeply with q, so L is taken at two sizes, and a power law
through both gives the size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, log

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.search.candidate_fits import Tangent, tangent
from rover_sweep.diagnosis.search.material import EARLIER, LAGS
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.structure import Structure

STEEPNESS = (0.5, 4.0)  # bounds of the exponent of a signature's length in its size
NEAR, FAR = 0.05, 4.0  # factors on the plain size within which the second signature is computed
FAINT = 1e-3  # length of a signature that no data show


@dataclass(frozen=True)
class Side:
    """One sign of one parameter of one law.

    effect: the law, of one of the effect's forms. start: the coordinate up to which the nominal model takes
    its place. way: +1 or -1. room: distance from there to the parameter's bound. slack: standard deviation of
    the nominal model's prior, 0 for none. run: where an effect of one run happens, else "".
    """

    effect: Effect
    parameter: EffectParameter
    start: float
    way: float
    room: float
    slack: float = 0.0
    run: str = ""


@dataclass(frozen=True, eq=False)
class Growth:
    """How a signature's length grows with the distance from the side's start.

    distance: of the second signature. rows: its part that the nominal model cannot explain. power: exponent.
    """

    side: Side
    distance: float
    rows: Array
    power: float

    @property
    def length(self) -> float:
        """Square root of the mean gain at `distance`."""
        return _length(self.rows, self.distance, self.side.slack)

    def distance_of(self, length: float) -> float:
        """The distance at which the signature has this length, at most the room of the side."""
        found = self.distance * (length / self.length) ** (1.0 / self.power)
        return found if found <= self.side.room else inf


@dataclass(frozen=True, eq=False)
class Signals:
    """The rows that a fitted nominal model predicts with an effect added, and their reach.

    fitted: with its Jacobian at its own coordinates.
    """

    problem: Problem
    model: Model
    fitted: Fitted
    _reach: dict[frozenset[str], Tangent] = field(default_factory=dict)

    @cached_property
    def now(self) -> Array:
        """The rows (n,) of the fitted model."""
        return self.problem.measured - self.fitted.rows

    def rows(self, side: Side, distance: float, start: Array | None = None) -> Array:
        """Rows (n,) at the distance from the side's start minus rows at the start, computed if not given."""
        far = self.problem.model(*self.at(side, side.start + side.way * distance))
        return far - (self.rows_at_start(side) if start is None else start)

    def rows_at_start(self, side: Side) -> Array:
        """Rows (n,) of the nominal model at the side's start."""
        if not side.parameter.nominal:
            return self.now
        return self.problem.model(*self.at(side, side.start))

    def at(self, side: Side, coordinate: float) -> tuple[Structure, dict[str, float]]:
        """The structure with the effect, and the coordinates {name: value} with its own at `coordinate`."""
        effect, p = side.effect, side.parameter
        x = {**self.fitted.x, effect.coordinate_name(p): coordinate * p.per}
        order = 0
        if effect.in_one_run:
            run = next(r for r in self.problem.runs if r.name == side.run)
            x[effect.key("t")], order = 0.5 * float(run.t[-1]), run.order
        return self.model.with_effect(effect.name, side.run, order).structure, x

    def reach(self, effect: Effect) -> Tangent:
        """What the nominal model explains with the coordinates held that the effect replaces."""
        held = frozenset(replaced_by(effect))
        if held not in self._reach:
            x = {**self.fitted.x, **{c.name: c.high for c in self.fitted.free if c.name in held}}
            self._reach[held] = tangent(replace(self.fitted, x=x))
        return self._reach[held]

    def growth(self, side: Side, needed: float) -> Growth | None:
        """The growth of one side's signature about the length `needed`; None where it shows nothing."""
        reach, plain = self.reach(side.effect), min(abs(side.parameter.size), side.room)
        start = self.rows_at_start(side)
        first = reach.outside(self.rows(side, plain, start))
        length = _length(first, plain, side.slack)
        if length < FAINT or plain <= 0.0:
            return None
        again = float(np.clip(needed / length, NEAR, FAR)) * plain
        again = min(again, side.room)
        if abs(log(again / plain)) < NEAR:
            return Growth(side, plain, first, 1.0)
        second = reach.outside(self.rows(side, again, start))
        other = _length(second, again, side.slack)
        if other < FAINT:
            return Growth(side, plain, first, 1.0)
        power = float(np.clip(log(other / length) / log(again / plain), *STEEPNESS))
        return Growth(side, again, second, power)


def _length(rows: Array, distance: float, slack: float) -> float:
    length = float(np.linalg.norm(rows))
    return length / float(np.sqrt(1.0 + (length / distance * slack) ** 2)) if distance > 0 else 0.0


def replaced_by(effect: Effect) -> set[str]:
    """Nominal coordinates at their bounds when this effect is a finding."""
    if effect.id in LAGS or effect.id == "clock_offset":
        return {"lag", "delay"}
    return {p.nominal for p in effect.parameters if p.nominal}


def sides(effect: Effect, model: Model, runs: tuple[str, ...]) -> Iterator[Side]:
    """The signs of an effect's parameters that these runs could show, in all its forms.

    For an effect that is in one run there is one for each run. Forms with the same nominal coordinate have
    the same sides.
    """
    for law in model.laws(effect.id):
        yield from _sides_of(law, model, runs)


def _sides_of(effect: Effect, model: Model, runs: tuple[str, ...]) -> Iterator[Side]:
    nominal = {c.name: c for c in model.free}
    for p in effect.parameters:
        if p.name == "t" or p.size == 0.0 or (p.nominal and (p.nominal not in nominal or not effect.first)):
            continue
        low, high, slack = 0.0, 0.0, 0.0
        if p.nominal:
            c = nominal[p.nominal]
            low, high, slack = c.low / p.per, c.high / p.per, (c.prior or 0.0) / p.per
            if c.prior:
                low = high = c.start / p.per
        if effect.id == "clock_offset" and not model.two_clocks:
            yield Side(effect, p, -EARLIER, -1.0, -EARLIER - p.low)  # only a response before the command
            continue
        for run in runs if effect.in_one_run else ("",):
            if p.high > high:
                yield Side(effect, p, high, 1.0, p.high - high, slack, run)
            if effect.signed and p.low < low:
                yield Side(effect, p, low, -1.0, low - p.low, slack, run)
