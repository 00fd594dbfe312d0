"""What differs between two fits of one model: the fewest quantities, with their values on both sides.

With the coordinates x_D and x_S of recordings and simulation, their covariances, and the columns B of the
chosen quantities, both sides are one Gaussian: x_S ~ N(mu, S_S), x_D ~ N(mu + B c, S_D). The estimate of mu
and c by generalised least squares gives both sides' values. The 90 % intervals come from 400 draws from its
covariance, shared among the sets of quantities that are nearly as likely as the chosen one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, exp
from types import MappingProxyType

import numpy as np

from rover_sweep.comparison.answer import Difference, Kind, difference_sentence
from rover_sweep.comparison.common_model import PENALTY, Chosen, FittedSide, Subsets, fewest
from rover_sweep.data.recording import Array
from rover_sweep.data.results import ByName, Quantity
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.effects.effect import (
    DegreeOfFreedom,
    FilterEffect,
    NominalEffect,
    Reported,
    SensorEffect,
    Values,
)
from rover_sweep.diagnosis.posterior.parameter_intervals import DRAWS, LEVEL, UNBOUNDED, shown_end
from rover_sweep.diagnosis.search import material_sizes
from rover_sweep.diagnosis.simulation.candidates import Coordinate, Model

# The numbers, effects and instruments in which simulation and recordings can differ.


Known = Mapping[str, tuple[float, float]]  # {coordinate: (recordings minus simulation, standard deviation)}
INSTRUMENT_EFFECTS = {"clock_offset", "velocity_lag", "imu_offset", "imu_tilt"}
SMALL = 0.03  # relative change of a number that does not matter


@dataclass(frozen=True, eq=False)
class Comparable:
    """One candidate for a difference.

    parts: per free direction, the coordinates that it moves, {coordinate: amount per unit}; a number has one
    direction, an effect one for each parameter. report: values for a user at the coordinates of the model.
    matters: change of the first direction from which the difference counts. relative: the direction is the
    logarithm of the number.
    """

    name: str
    kind: Kind
    parts: tuple[Mapping[str, float], ...]
    report: Callable[[Values], Reported]
    matters: float
    relative: bool = False
    effect: Effect | None = None

    def columns(self, coordinates: tuple[Coordinate, ...]) -> Array:
        """The directions as columns (k, m), in coordinates over their scales."""
        out = np.zeros((len(coordinates), len(self.parts)))
        for j, part in enumerate(self.parts):
            for i, c in enumerate(coordinates):
                out[i, j] = part.get(c.name, 0.0) / c.scale
        return out


def _number(
    name: str,
    words: tuple[str, str],
    moves: Values,
    of: Callable[[Values], float],
    matters: float,
    relative: bool = False,
    kind: Kind = "number",
) -> Comparable:
    """A number of the model. words: (unit, meaning); moves: coordinates; of: its value at coordinates."""
    return Comparable(name, kind, (moves,), lambda x: {name: (of(x), *words)}, matters, relative)


def _exp(*parts: tuple[str, float], size: float = 1.0) -> Callable[[Values], float]:
    return lambda x: size * exp(sum(factor * x.get(name, 0.0) for name, factor in parts))


def _relative(
    name: str, unit: str, meaning: str, coordinate: str, matters: float, size: float = 1.0
) -> Comparable:
    of = _exp((coordinate, 1.0), size=size)
    return _number(name, (unit, meaning), {coordinate: 1.0}, of, matters, True)


def _axle(name: str, meaning: str, sign: float) -> Comparable:
    """One axle's stiffness: Cf = C sqrt(ratio), Cr = C/sqrt(ratio); the other one stays."""
    of = _exp(("ln_C", 1.0), ("ln_ratio", 0.5 * sign))
    return _number(name, ("N/rad", meaning), {"ln_C": 0.5, "ln_ratio": sign}, of, 0.05, True)


def _absolute(name: str, unit: str, meaning: str, coordinate: str, matters: float, kind: Kind) -> Comparable:
    def of(x: Values) -> float:
        return x.get(coordinate, 0.0)

    return _number(name, (unit, meaning), {coordinate: 1.0}, of, matters, False, kind)


_NUMBERS: tuple[Comparable, ...] = (
    _relative("C", "N/rad", "cornering stiffness of an axle, both axles", "ln_C", SMALL),
    _axle("Cf", "cornering stiffness, front axle", 1.0),
    _axle("Cr", "cornering stiffness, rear axle", -1.0),
    _relative("Izz", "kg m^2", "yaw inertia", "ln_Izz", 0.05),
    _relative("L_eff", "m", "effective wheelbase", "ln_L_eff", SMALL),
    _relative("k_phi", "N m/rad", "roll stiffness", "ln_k_phi", 0.05),
    _relative("b_phi", "N m s/rad", "roll damping", "ln_b_phi", 0.10),
    _absolute("servo_lag", "s", "first-order lag of the steering", "lag", 0.008, "number"),
    _absolute("servo_delay", "s", "delay of the steering", "delay", 0.006, "number"),
    _absolute("lag_shape", "", "second-order share of the servo's lag", "lag_shape", 0.5, "number"),
    _absolute("steering_trim", "rad", "road-wheel angle at the trim", "trim", 0.006, "number"),
    _absolute("tyre_bend", "", "curvature of the tyres' force near the limit", "bend", 0.7, "number"),
    _absolute("track", "m^2", "square of half the track", "track", 0.05, "number"),
    _absolute("imu_x", "m", "IMU further forward than in the vehicle file", "imu_x", 0.012, "instrument"),
    _absolute("imu_z", "m", "IMU further up than in the vehicle file", "imu_z", 0.012, "instrument"),
    _absolute("bias_ay", "m/s^2", "offset of the accelerometer", "bias_ay", 0.15, "instrument"),
    _absolute("ay_lag", "s", "a_y later than r", "ay_lag", 0.005, "instrument"),
    _absolute("p_lag", "s", "p later than r", "p_lag", 0.005, "instrument"),
    _absolute("velocity_lag", "s", "lag of the estimator's velocity", "vy_lag", 0.012, "instrument"),
    _absolute("heading", "rad", "error of the estimator's heading", "heading", 0.025, "instrument"),
    _absolute("vy_gain", "", "relative error of V_y", "vy_gain", 0.10, "instrument"),
    _absolute("speed_scale", "", "true speed over the logged one, minus 1", "vscale", 0.02, "instrument"),
)


def quantities(model: Model, coordinates: tuple[Coordinate, ...]) -> tuple[Comparable, ...]:
    """All quantities that move a coordinate of the model."""
    known = {c.name for c in coordinates}
    numbers = (n for n in (*_of_rover(model), *_NUMBERS) if n.parts[0].keys() <= known)
    return (*numbers, *_effects(model, known))


def _of_rover(model: Model) -> Iterator[Comparable]:
    """Numbers of the vehicle file, with their nominal values."""
    rover = model.rover
    steering, place = (
        ("of the vehicle file", "steering angle per PWM"),
        ("m", "centre of mass to the front axle"),
    )
    yield _number("rad_per_us", steering, {"scale": 1.0}, lambda x: 1.0 + x.get("scale", 0.0), 0.02, True)
    yield _number("cg_to_front_axle", place, {"da": 1.0}, lambda x: rover.a + x.get("da", 0.0), 0.008)
    if rover.h:
        yield _relative("h", "m", "height of the sprung mass above the roll axis", "ln_h", 0.10, rover.h)
    if rover.roll_inertia:
        yield _relative("Ixx", "kg m^2", "roll inertia", "ln_Ixx", 0.10, rover.roll_inertia)


def _effects(model: Model, known: set[str]) -> Iterator[Comparable]:
    for effect in (model.law(name) for name in model.effects):
        if isinstance(effect, NominalEffect):
            continue
        measures = isinstance(effect, SensorEffect | FilterEffect) or effect.id in INSTRUMENT_EFFECTS
        if moved := _moved(effect, known):
            yield Comparable(
                effect.id,
                "instrument" if measures else "size",
                tuple({name: 1.0} for name in moved),
                effect.reported,
                material_sizes(effect, model.spread, model.rover.wheelbase).get(
                    effect.parameters[0].name, 0.0
                ),
                effect=effect,
            )


def _moved(effect: Effect, known: set[str]) -> list[str]:
    if isinstance(effect, DegreeOfFreedom):
        own = ("ln_C", "ln_Izz") if effect.id == "tyre_slip" else ("ln_k_phi", "ln_b_phi")
        return [name for name in own if name in known]
    return [n for p in effect.parameters if (n := effect.coordinate_name(p)) in known and not p.nominal]


ALIKE = 0.85  # share of a quantity's gain from which another one in its place is a look-alike
ABSENT_SHARE = 0.2  # of the other side's size, up to which an effect counts as absent on one side


@dataclass(frozen=True, eq=False)
class Found:
    """Two sides compared. candidates: all quantities; chosen: indices of those that differ.

    subsets: costs of all sets. simulation, recordings: coordinates {name: value} of both sides, the first of
    them the estimate, then the draws.
    """

    candidates: tuple[Comparable, ...]
    chosen: Chosen
    subsets: Subsets
    simulation: tuple[Values, ...]
    recordings: tuple[Values, ...]


def found_between(
    recordings: FittedSide, simulation: FittedSide, seed: int = 1, known: Known = MappingProxyType({})
) -> Found:
    """The fewest quantities that explain the difference of two sides fitted with one model.

    known: coordinates known better than from the two fits.
    """
    coordinates = recordings.coordinates
    candidates = quantities(recordings.model, coordinates)
    columns = [q.columns(coordinates) for q in candidates]
    covariance = recordings.covariance + simulation.covariance
    before = _of_candidates(known, candidates)
    subsets = Subsets(recordings.values - simulation.values, covariance, columns, before)
    effects = {k for k, q in enumerate(candidates) if q.effect is not None}
    chosen = _axle_by_axle(fewest(subsets, effects), candidates)
    sets = subsets.likely(chosen)
    return Found(candidates, chosen, subsets, *_draws(recordings, simulation, columns, before, sets, seed))


def differences_left(
    found: Found, recordings: FittedSide, simulation: FittedSide, known: Known, changed: Collection[str]
) -> tuple[Difference, ...]:
    """The rest of the differences in quantities that were corrected before, with intervals.

    They are estimated together with those that still differ, even if small.
    """
    every = range(len(found.candidates))
    both = tuple(k for k in every if k in found.chosen or found.candidates[k].name in changed)
    columns = [q.columns(recordings.coordinates) for q in found.candidates]
    before = _of_candidates(known, found.candidates)
    again = Found(
        found.candidates,
        both,
        found.subsets,
        *_draws(recordings, simulation, columns, before, {both: 1.0}, seed=1),
    )
    return tuple(_difference(again, k) for k in both if found.candidates[k].name in changed)


def _of_candidates(known: Known, candidates: Sequence[Comparable]) -> dict[int, tuple[float, float]]:
    """Known coordinates as {candidate that moves one alone: (amount, standard deviation)}."""
    out = {}
    for k, q in enumerate(candidates):
        (name, *others) = q.parts[0]
        if name in known and not (q.effect or others or q.parts[0][name] != 1.0):
            out[k] = known[name]
    return out


def _draws(
    recordings: FittedSide,
    simulation: FittedSide,
    columns: Sequence[Array],
    known: Mapping[int, tuple[float, float]],
    sets: Mapping[Chosen, float],
    seed: int,
) -> tuple[tuple[Values, ...], tuple[Values, ...]]:
    """(simulation, recordings): the estimate by the first of the sets, then draws by all of them."""
    random, parts = np.random.default_rng(seed), []
    none = np.zeros((len(recordings.coordinates), 0))
    for some, share in sets.items():
        first = np.cumsum([0, *(columns[k].shape[1] for k in some)])
        at = {int(first[n]): known[k] for n, k in enumerate(some) if k in known}
        b = np.column_stack([none, *(columns[k] for k in some)])
        parts.append(_both(recordings, simulation, b, at, ceil(share * DRAWS), random))
    one, two = (np.vstack([parts[0][side][:1], *(part[side][1:] for part in parts)]) for side in (0, 1))
    return _named(recordings, one), _named(recordings, two)


def _axle_by_axle(chosen: Chosen, candidates: Sequence[Comparable]) -> Chosen:
    """The same set; mean stiffness and one axle's are replaced by both axles'."""
    place = {q.name: k for k, q in enumerate(candidates) if q.name in ("C", "Cf", "Cr")}
    stiff = {name for name, k in place.items() if k in chosen}
    if "C" not in stiff or len(stiff) == 1:
        return chosen
    return tuple(sorted({*chosen, place["Cf"], place["Cr"]} - {place["C"]}))


def _both(
    recordings: FittedSide,
    simulation: FittedSide,
    b: Array,
    known: Mapping[int, tuple[float, float]],
    draws: int,
    random: np.random.Generator,
) -> tuple[Array, Array]:
    """(simulation, recordings) (1 + draws, k) over their scales, the estimate first. known: by b's column."""
    pd, ps = np.linalg.inv(recordings.covariance), np.linalg.inv(simulation.covariance)
    normal = np.block([[pd + ps, pd @ b], [b.T @ pd, b.T @ pd @ b]])
    right = np.concatenate((pd @ recordings.values + ps @ simulation.values, b.T @ pd @ recordings.values))
    k = len(recordings.coordinates)
    for column, (amount, sd) in known.items():
        normal[k + column, k + column] += 1.0 / sd**2
        right[k + column] += amount / sd**2
    normal += 1e-12 * np.trace(normal) / len(normal) * np.eye(len(normal))
    covariance = np.linalg.inv(normal)
    centre = covariance @ right
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    drawn = centre + random.standard_normal((draws, centre.size)) * np.sqrt(np.maximum(values, 0.0)) @ axes.T
    rows = np.vstack((centre, drawn))
    return rows[:, :k], rows[:, :k] + rows[:, k:] @ b.T


def _named(side: FittedSide, rows: Array) -> tuple[Values, ...]:
    """Coordinates (n, k) over their scales as {name: value}, within their bounds."""
    scale = np.array([c.scale for c in side.coordinates])
    low, high = (np.array([getattr(c, end) for c in side.coordinates]) for end in ("low", "high"))
    names = [c.name for c in side.coordinates]
    inside = np.clip(rows * scale, low, high)
    return tuple({**side.fitted.x, **dict(zip(names, map(float, row), strict=True))} for row in inside)


def differences(found: Found) -> tuple[tuple[Difference, ...], tuple[Difference, ...]]:
    """(those that matter, those within normal tolerance), instruments first, then the largest gain."""
    sides = found.recordings[0], found.simulation[0]
    chosen = [(k, found.candidates[k]) for k in found.chosen]
    every = [(_difference(found, k), _how_far(q, *sides) >= q.matters) for k, q in chosen]
    order: dict[Kind, int] = {"instrument": 0}
    every.sort(key=lambda e: (order.get(e[0].kind, 1), -e[0].gain))
    return tuple(d for d, m in every if m), tuple(d for d, m in every if not m)


def _difference(found: Found, k: int) -> Difference:
    q = found.candidates[k]
    simulation, recordings = (_values(q, side) for side in (found.simulation, found.recordings))
    kind = _kind(q, found)
    rest = tuple(c for c in found.chosen if c != k)
    gain = found.subsets.left(rest) - found.subsets.left(found.chosen)
    change = {
        one.name: two.value / one.value if q.relative and one.value else two.value - one.value
        for one, two in zip(simulation, recordings, strict=True)
    }
    base, near = found.subsets.left(rest), dict[int, float]()
    for j in range(len(found.candidates)):  # that explain nearly as much in its place
        if j not in found.chosen:
            g = base - found.subsets.left((*rest, j))
            near |= {j: g} if g > ALIKE * gain and g > gain - PENALTY else {}
    alike = tuple(found.candidates[j].name for j in sorted(near, key=lambda j: -near[j]))
    words = difference_sentence(kind, q.name, simulation, recordings, q.relative)
    return Difference(kind, q.name, simulation, recordings, change, q.relative, gain, alike, words)


def _values(q: Comparable, side: Sequence[Values]) -> ByName[Quantity]:
    centre, *drawn = side
    reports = [q.report(x) for x in drawn]
    out = []
    for name, (value, unit, meaning) in q.report(centre).items():
        low, high = np.percentile([min(max(r[name][0], -1e12), 1e12) for r in reports], LEVEL)
        out.append(Quantity(name, unit, min(value, UNBOUNDED), shown_end(low), shown_end(high), meaning))
    return ByName(out)


def _kind(q: Comparable, found: Found) -> Kind:
    """The kind of a chosen quantity; of an effect by which side has it."""
    if q.effect is None or q.kind == "instrument":
        return q.kind
    if q.effect.id in ("tyre_slip", "roll_dof"):
        return "left out"
    first = next(iter(q.parts[0]))
    one, two = (abs(side[0].get(first, 0.0)) for side in (found.simulation, found.recordings))
    if one < ABSENT_SHARE * two:
        return "left out"
    return "too much" if two < ABSENT_SHARE * one else "size"


def _how_far(q: Comparable, one: Values, two: Values) -> float:
    """How far the quantity's first direction moves between two sides."""
    name, per = next(iter(q.parts[0].items()))
    if q.relative:
        values = [next(iter(q.report(x).values()))[0] for x in (one, two)]
        return abs(float(np.log(values[0] / values[1]))) if min(values) > 0 else np.inf
    return abs(one.get(name, 0.0) - two.get(name, 0.0)) / abs(per)
