"""The size up to which an effect that was not found could still be there, at 95 %.

The bound is the upper 95 % quantile of the posterior of the size, for each sign of each parameter. With the
unit direction u of the part of the signature that the nominal model cannot explain, and r the residual rows
there, the data give the length u^T r of the signature with the standard deviation sqrt(v), v the variance in
the tempered likelihood (`posterior.weights`); a length is not negative. A signature grows with the size by a
power law through the lengths at two sizes, since that of a limit grows steeply; it is computed again at the
size that was found.

If the nominal model has the same coordinate, it absorbs the effect up to the coordinate's bound, where the
length begins. With a prior of standard deviation s, it absorbs a part at a cost: the size q with rows of the
length L shows as q/sqrt(s^2 + (q/L)^2).

The other parameters of the effect are absent while one is judged. Effects that happen in one run at an
instant are judged in the middle of each run; the run that shows them least counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, log

import numpy as np
from scipy.special import ndtr, ndtri

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.problem.least_squares import COARSE, WEAK
from rover_sweep.diagnosis.result import Unseen, UpperBound
from rover_sweep.diagnosis.search import EARLIER, LAGS, Tangent, least_size, material_sizes, tangent
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model, possible
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.spectra.side_by_side import side_by_side

LEVEL = 0.95
ONE_SIDED = 1.645  # standard deviations: 95 % of a normal distribution lie below
STEEPNESS = (0.5, 4.0)  # bounds of the exponent of a signature's length in its size
SIZES = 5  # at most, at which a signature is computed
NEAREST, FARTHEST = 0.05, 4.0  # of the plain size: range of these sizes; nearer ones are the same, relative
EKF_CROSSOVER = 0.3
"""rad/s, below which an EKF follows its GPS: sqrt(0.35^2 0.012 / (0.3^2 0.2)), the steady state of a scalar
filter with ArduPilot's EK3_ACC_P_NSE each 12 ms and EK3_VELNE_M_NSE at 5 Hz (Gelb 1974, chapter 4)."""
GPS = "; T_gps: lag of the GPS velocity, most of which an EKF hides"
BOUND = "a smaller one may not show in these runs"
HALFWAY = "; sizes for a change halfway through a run, since one at its beginning shows less"
NO_BOUND = "these runs hardly excite it: they exclude no size"


@dataclass(frozen=True)
class Side:
    """One sign of one parameter of one law.

    effect: the law, in one of its forms. start: coordinate up to which the nominal model absorbs it. way: +1
    or -1. room: distance from there to the parameter's bound. slack: standard deviation of the nominal
    model's prior, 0 for none. run: of an effect in one run, else "".
    """

    effect: Effect
    parameter: EffectParameter
    start: float
    way: float
    room: float
    slack: float = 0.0
    run: str = ""


_End = tuple[Side, float]
"""One side with the coordinate of its bound; infinite where these runs exclude no size."""


def upper_bounds(last: ModelFit, only: Sequence[str] = (), without: Sequence[str] = ()) -> tuple[Unseen, ...]:
    """The effects that are not in the final model, with the largest size that each could have unseen.

    only, without: ids of effects, as in the search. Effects that add a degree of freedom have no bound.
    """
    effects = possible(last.model, last.problem.runs, only, without)[0]
    judged = [e for e in effects if e.id not in DEGREES_OF_FREEDOM]
    reach = {held: _reach(last, held) for held in {_replaced_by(e) for e in judged}}
    return tuple(side_by_side(lambda e: _unseen(last, reach[_replaced_by(e)], e), judged))


def _unseen(last: ModelFit, reach: Tangent, effect: Effect) -> Unseen:
    runs = tuple(r.name for r in last.problem.runs)
    ends = [(side, _end(last, reach, side)) for side in sides(effect, last.model, runs)]
    shown = [(side, bound) for side, bound in ends if isfinite(bound)]
    if not shown:
        return Unseen(effect.id, NO_BOUND)
    material = material_sizes(effect, last.model.spread, last.model.rover.wheelbase)
    largest = max(shown, key=lambda end: abs(end[1]) / abs(end[0].parameter.size))
    above = [abs(bound) > material.get(side.parameter.name, 0.0) for side, bound in shown]
    ranges, why = _ranges(effect, last.model.laws(effect.id), ends, material), BOUND
    if effect.id == "velocity_lag" and (gps := _gps_lag(last)):
        ranges, why = {**ranges, "T_gps": gps}, BOUND + GPS
    if effect.in_one_run:
        why += HALFWAY
    change = _change(last, *largest, material.get(largest[0].parameter.name, 0.0))
    return Unseen(effect.id, why, ranges, change, any(above))


def _end(last: ModelFit, reach: Tangent, side: Side) -> float:
    """The coordinate of the side's bound."""
    distance = _distance(last, reach, side)
    coordinate = side.start + side.way * (distance if distance <= side.room else inf)
    if side.effect.id in LAGS:
        coordinate = max(coordinate, least_size(side.effect, side.parameter, last.model, last.fitted.x))
    return coordinate


def _distance(last: ModelFit, reach: Tangent, side: Side) -> float:
    """The distance from the side's start to its bound, infinite without a signature."""
    noise = float(np.sqrt(COARSE * last.fitted.overdispersion))
    residual = reach.outside(last.fitted.rows)
    near, plain = _rows(last, side, 0.0), min(abs(side.parameter.size), side.room)
    distance, before, found = plain, (0.0, 0.0), inf
    for _ in range(SIZES):
        rows = reach.outside(_rows(last, side, distance) - near)
        length = shown_length(rows, distance, side.slack)
        if length**2 < WEAK:
            break
        power = 1.0
        if before[0]:
            power = float(np.clip(log(length / before[1]) / log(distance / before[0]), *STEEPNESS))
        amount = float(rows @ residual) / float(np.linalg.norm(rows))
        # the 95 % quantile of a normal distribution that is cut off below 0
        below = float(ndtr(-amount / noise))
        upper = amount + noise * float(ndtri(below + LEVEL * (1.0 - below)))
        found = distance * (upper / length) ** (1.0 / power)
        following = min(float(np.clip(found, NEAREST * plain, FARTHEST * plain)), side.room)
        if abs(log(following / distance)) < NEAREST:
            break
        before, distance = (distance, length), following
    return found


def shown_length(rows: Array, distance: float, slack: float) -> float:
    """Length of a signature at a distance, less the part that the nominal model's prior absorbs."""
    length = float(np.linalg.norm(rows))
    return length / float(np.sqrt(1.0 + (length / distance * slack) ** 2)) if distance > 0 else 0.0


def _rows(last: ModelFit, side: Side, distance: float) -> Array:
    """The rows (n,) of the model at a distance from the side's start."""
    if distance == 0.0 and not side.parameter.nominal:
        return last.problem.measured - last.fitted.rows
    return last.problem.model(*_at(last, side, side.start + side.way * distance))


def _at(last: ModelFit, side: Side, coordinate: float) -> tuple[Model, dict[str, float]]:
    """The model with the effect, and the coordinates {name: value} with its own at `coordinate`."""
    effect, p = side.effect, side.parameter
    x = {**last.fitted.x, effect.coordinate_name(p): coordinate * p.per}
    order = 0
    if effect.in_one_run:
        run = next(r for r in last.problem.runs if r.name == side.run)
        x[effect.key("t")], order = 0.5 * float(run.t[-1]), run.order
    return last.model.with_effect(effect.name, side.run, order), x


def _reach(last: ModelFit, held: frozenset[str]) -> Tangent:
    """Rows that the nominal model explains with some coordinates at bounds."""
    x = {**last.fitted.x, **{c.name: c.high for c in last.fitted.free if c.name in held}}
    return tangent(replace(last.fitted, x=x))


def _replaced_by(effect: Effect) -> frozenset[str]:
    """Nominal coordinates at their bounds when this effect is a finding."""
    if effect.id in LAGS or effect.id == "clock_offset":
        return frozenset({"lag", "delay"})
    return frozenset(p.nominal for p in effect.parameters if p.nominal)


def sides(effect: Effect, model: Model, runs: tuple[str, ...]) -> Iterator[Side]:
    """The signs of an effect's parameters that these runs could show, in all its forms.

    An effect in one run has one side per run. Forms with the same nominal coordinate have the same sides. The
    two signs differ: towards oversteer Cf/Cr shows several times more than towards understeer.
    """
    nominal = {c.name: c for c in model.free}
    pairs = [(law, p) for law in model.laws(effect.id) for p in law.parameters]
    for law, p in pairs:
        if p.name == "t" or p.size == 0.0 or (p.nominal and (p.nominal not in nominal or not law.first)):
            continue
        low, high, slack = 0.0, 0.0, 0.0
        if p.nominal:
            c = nominal[p.nominal]
            low, high, slack = c.low / p.per, c.high / p.per, (c.prior or 0.0) / p.per / np.sqrt(COARSE)
            if c.prior:
                low = high = c.start / p.per
        if effect.id == "clock_offset" and not model.two_clocks:
            yield Side(law, p, -EARLIER, -1.0, -EARLIER - p.low)  # only a response before the command
            continue
        for run in runs if effect.in_one_run else ("",):
            if p.high > high:
                yield Side(law, p, high, 1.0, p.high - high, slack, run)
            if effect.signed and p.low < low:
                yield Side(law, p, low, -1.0, low - p.low, slack, run)


def _gps_lag(last: ModelFit) -> UpperBound | None:
    """The GPS lag that the EKF's V_y does not exclude; None without such a V_y.

    Far above the crossover w, V_y = V jw/(jw + w) + V_gps w/(jw + w) with V_gps = V exp(-jw T) has the gain
    1 - w T at least. It looks like a normal error of that gain, the prior of `vy_gain`.
    """
    gain = next((c for c in last.fitted.free if c.name == "vy_gain"), None)
    if gain is None or gain.prior is None or not any("vy" in run.measured for run in last.problem.runs):
        return None
    lowest = last.fitted.x["vy_gain"] - ONE_SIDED * gain.prior
    return UpperBound("s", 0.0, max(-lowest, 0.0) / EKF_CROSSOVER)


def _change(last: ModelFit, side: Side, bound: float, material: float) -> float:
    """Change of r or a_y, the larger one, from normal tolerance to the bound: rms over rms at tolerance.

    material: the coordinate from which the effect matters.
    """
    normal = max(side.way * side.start, material)
    near, far = (_at(last, side, c) for c in (side.way * normal, side.way * max(side.way * bound, normal)))
    squares: dict[str, Array] = {c: np.zeros(2) for c in ("r", "ay")}
    for run in last.problem.runs:
        one, two = logged(run, *near), logged(run, *far)
        for c in squares:
            if c in run.measured:
                squares[c] += float(np.sum((two[c] - one[c]) ** 2)), float(np.sum(one[c] ** 2))
    return max(float(np.sqrt(change / max(whole, 1e-12))) for change, whole in squares.values())


def _ranges(
    effect: Effect, laws: Sequence[Effect], ends: Sequence[_End], material: Mapping[str, float]
) -> dict[str, UpperBound]:
    """{reported parameter: its range}, over all signs and runs."""
    values: dict[str, list[float]] = {}
    units, matters = {}, {}
    for p in {p.name: p for law in laws for p in law.parameters}.values():
        own = [bound for side, bound in ends if side.parameter.name == p.name]
        if not any(map(isfinite, own)):
            continue
        # an absent effect is always within its range
        for coordinate in (*own, *(() if effect.id == "clock_offset" else (0.0,))):
            name, units[name], value = reported_value(effect, p, coordinate)
            values.setdefault(name, []).append(value)
        if effect.id == "clock_offset":
            matters[name] = reported_value(effect, p, -EARLIER)[2]
        elif p.name in material:
            matters[name] = reported_value(effect, p, material[p.name])[2]
    out = {}
    for name, found in values.items():
        low, high = (end if isfinite(end) else None for end in (min(found), max(found)))
        low = None if effect.id == "clock_offset" else low
        out[name] = UpperBound(units[name], low, high, matters.get(name))
    return out


def reported_value(effect: Effect, p: EffectParameter, coordinate: float) -> tuple[str, str, float]:
    """(name, unit, value) of one parameter, for a user."""
    if not isfinite(coordinate):
        value = coordinate if p.form == "plain" else inf if coordinate > 0 else -inf
        name, unit, _ = reported_value(effect, p, p.low if coordinate < 0 else p.high)
        return name, unit, value
    if not effect.report_values:
        return p.name, p.unit, float(p.value(coordinate))
    values = {q.name: q.value(0.0) for q in effect.parameters}
    shown = effect.report_values(values | {p.name: p.value(coordinate)})
    name = next(iter(shown))
    return name, shown[name][1], float(shown[name][0])
