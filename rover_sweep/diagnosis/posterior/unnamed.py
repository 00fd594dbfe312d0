"""Evidence for something without a name: a curve over one quantity, or a resonance, at one place.

A family has the columns S (rows, k), which its points add to the whitened rows, and the prior
c ~ N(0, lambda^2 K), K^-1 the penalty on second differences. The log of the marginal likelihood over that
without the family, with the nominal coordinates refitted (P), is

    -1/2 ln det(I + lambda^2 L^T A L) + 1/2 b^T L (I/lambda^2 + L^T A L)^-1 L^T b
    with A = S^T P S/v, b = S^T P r/v

with K = L L^T and lambda where it is largest (type-II maximum likelihood: MacKay 1992, Tipping 2001). A
resonance of a hidden state (a swinging load, a swaying mast, an elastic linkage) has two columns at each
frequency, the resonator's displacement and its velocity; their shares are the coupling and its phase.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import exp
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import SteeringEffect, Values
from rover_sweep.diagnosis.posterior.model_fit import (
    ModelFit,
    RunTransfers,
    added_rows,
    tapered_spectrum,
    transfers,
)
from rover_sweep.diagnosis.posterior.parameter_intervals import LEVEL
from rover_sweep.diagnosis.problem.least_squares import WEAK, Fitted, prior_information, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import LawCurve
from rover_sweep.diagnosis.search import tangent
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.simulator import motion, vehicle_numbers
from rover_sweep.diagnosis.simulation.single_track import SGN_WIDTH, VehicleNumbers, tyre_force
from rover_sweep.diagnosis.simulation.table_law import TableLaw, acting, quantity, remembered, resonator

# Candidate laws: each place with each quantity that it may depend on, as a group of hat functions.
#
# A group is a curve with free points: linear between `KNOTS` points over the range that the runs visited.


KNOTS = 7
LEAST = 1e-9  # range of a quantity below which it does not vary
LAGS = (0.03, 0.1, 0.3)  # s
PLAYS = (0.1, 0.25)  # of the largest steering angle
_BODY = ("delta", "delta_dot", "a_y", "r", "p", "phi", "beta", "v", "psi", "t")
_SCALED = (("t", "delta"), ("v", "delta"), ("t", "a_y"), ("v", "a_y"), ("psi", "v^2"))
_OVER: dict[str, tuple[str, ...]] = {
    "steering": ("delta", "delta_dot"),
    "side force front": _BODY,
    "side force rear": _BODY,
    "side force": _BODY,
    "yaw moment": _BODY,
    "roll moment": ("phi", "p", "a_y", "delta", "r", "v", "psi", "t"),
    "sensor of r": ("signal", "signal_dot", "p", "a_y", "v", "t", "psi", "phi"),
    "sensor of ay": ("signal", "signal_dot", "r", "p", "r_dot", "p_dot", "v_dot", "v", "t", "psi"),
    "sensor of p": ("signal", "signal_dot", "r", "a_y", "r_dot", "v", "t", "psi"),
    "sensor of vy": ("signal", "signal_dot", "r", "a_y", "phi", "v", "t", "psi"),
}
_FACTORED: dict[str, tuple[tuple[str, str], ...]] = {
    "side force front": _SCALED,
    "side force rear": (*_SCALED[2:], ("t", "r")),
    "side force": (("psi", "v^2"), ("v", "a_y"), ("t", "a_y")),
    "yaw moment": (("t", "r"), ("v", "r"), ("psi", "v^2")),
}
_REMEMBERING = {
    "steering": "delta",
    "side force rear": "a_y",
    "yaw moment": "r",
    "roll moment": "p",
    "sensor of r": "signal",
    "sensor of ay": "signal",
    "sensor of p": "signal",
    "sensor of vy": "signal",
}


def groups(found: Sequence[RunTransfers]) -> Iterator[TableLaw]:
    """The laws that can act in these runs, with their points and y = 0."""
    for place in found[0].responses:
        for over in _OVER[place]:
            yield from _over_range(TableLaw(place, over, (), ()), found)
        for over, times in _FACTORED.get(place, ()):
            yield from _over_range(TableLaw(place, over, (), (), times), found)
        over = _REMEMBERING.get(place, "")
        for lag in LAGS if over else ():
            yield from _over_range(TableLaw(place, over, (), (), memory="lag", size=lag), found)
        if place == "steering":
            most = max(float(np.max(np.abs(t.motion["delta"]))) for t in found)
            for share in PLAYS:
                yield from _over_range(TableLaw(place, over, (), (), memory="play", size=share * most), found)


def _over_range(law: TableLaw, found: Sequence[RunTransfers]) -> Iterator[TableLaw]:
    """The law with points over the range of its quantity; none where the quantity does not vary."""
    x = np.concatenate([abscissa(law, t) for t in found])
    low, high = (-np.pi, np.pi) if law.over == "psi" else (float(np.min(x)), float(np.max(x)))
    if high - low > LEAST and np.ptp(np.quantile(x, (0.05, 0.95))) > LEAST:
        points = np.linspace(low, high, KNOTS)
        yield replace(law, x=tuple(points.tolist()), y=(0.0,) * KNOTS)


def abscissa(law: TableLaw, t: RunTransfers) -> Array:
    """The quantity (n,) that the law depends on in one run, with its memory."""
    return remembered(quantity(law.over, t.motion, signal_of(law, t)), law.memory, law.size)


def signal_of(law: TableLaw, t: RunTransfers) -> Array | None:
    """Signal (n,) of the sensor that the law acts on, else None."""
    return t.signals[law.place.split()[-1]] if law.place.startswith("sensor of ") else None


def unit_spectra(law: TableLaw, found: Sequence[RunTransfers]) -> list[list[Any]]:
    """For each coefficient of the law: spectra of its unit change, one per run."""
    out = []
    for k in range(len(law.x)):
        one = replace(law, y=tuple(float(j == k) for j in range(len(law.x))))
        out.append([tapered_spectrum(t.run, acting(one, t.motion, signal_of(law, t))) for t in found])
    return out


# The answer as curves: tyres, steering, roll damper and yaw moment of the fitted model with 90 % bands.
#
# Each curve is the law at rest over the range that the runs visited: lags, delays and changes of ground are
# no part of it. The bands come from the same draws as the numbers.


EVERY = 10  # of the draws
POINTS = 25
VISITED = (1.0, 99.0)  # percent of the samples
SLOWLY = 40  # samples of the steering between two points of its curve
Law = Callable[[VehicleNumbers, Array], Array]


def answer_curves(last: ModelFit, drawn: Sequence[Mapping[str, float]]) -> tuple[LawCurve, ...]:
    """The curves of both tyres, and of steering, damper and yaw moment if an effect acts on them.

    () of a lumped model.
    """
    model, x = replace(last.model, unnamed=()), last.fitted.x
    if model.lumped:
        return ()
    some = (x, *drawn[::EVERY])
    found = []
    if model.of(SteeringEffect):
        at = _loop(last)
        found.append(_curve("steering", ("command", "rad"), "rad", at, [_wheel(model, x, at) for x in some]))
    if model.slip:
        visited = _visited(last)
        numbers = [vehicle_numbers(model, x) for x in some]
        laws: list[tuple[str, tuple[str, str], str, Law]] = [
            ("side force front", ("slip angle front", "rad"), "N", partial(_tyre, front=True)),
            ("side force rear", ("slip angle rear", "rad"), "N", partial(_tyre, front=False)),
        ]
        if numbers[0].T_roll:
            laws.append(("roll damper", ("roll rate", "rad/s"), "N m", _damper))
        if numbers[0].yaw_damp or numbers[0].yaw_damp_v:
            v = float(np.mean([run.mean_speed for run in last.problem.runs]))
            against = ("yaw rate", "rad/s"), "N m", lambda q, r: -(q.yaw_damp + q.yaw_damp_v / v) * r
            laws.append(("yaw moment", *against))
        for place, over, unit, law in laws:
            at = np.linspace(*visited[over[0]], POINTS)
            found.append(_curve(place, over, unit, at, [law(q, at) for q in numbers]))
    return tuple(found)


def _curve(place: str, over: tuple[str, str], unit: str, at: Array, drawn: Sequence[Array]) -> LawCurve:
    """The law at the fit (`drawn[0]`), with a band from the other draws."""
    values = np.array(drawn)
    low, high = np.percentile(values[1:], LEVEL, axis=0) if len(values) > 1 else (values[0], values[0])
    low, high = np.minimum(low, values[0]), np.maximum(high, values[0])
    x, y, below, above = (tuple(map(float, some)) for some in (at, values[0], low, high))
    return LawCurve(place, (), *over, unit, x, y, below, above, 0.0)


def _visited(last: ModelFit) -> dict[str, tuple[float, float]]:
    """{quantity: range} that the fitted model visits in the runs."""
    model, x = replace(last.model, unnamed=()), last.fitted.x
    q = vehicle_numbers(model, x)
    seen: dict[str, list[Array]] = {}
    for run in last.problem.runs:
        y = motion(run, model, x)
        slips = y["v"] + q.a * y["r"], y["v"] - q.b * y["r"]
        front, rear = (np.arctan(across / y["V"]) for across in slips)
        parts = {"slip angle front": front - y["delta"], "slip angle rear": rear}
        for name, values in (parts | {"roll rate": y["p"], "yaw rate": y["r"]}).items():
            seen.setdefault(name, []).append(values)
    ends = {name: np.percentile(np.concatenate(parts), VISITED) for name, parts in seen.items()}
    return {name: (float(low), float(high)) for name, (low, high) in ends.items()}


def _loop(last: ModelFit) -> Array:
    """Commanded angles from the least to the largest of the runs and back [rad]."""
    every = np.concatenate([run.steer for run in last.problem.runs])
    low, high = np.percentile(every, VISITED)
    up = np.linspace(low, high, POINTS)
    return np.concatenate((up, up[::-1]))


def _wheel(model: Model, x: Values, at: Array) -> Array:
    """Road-wheel angle after a slow turn to each commanded angle, in their order."""
    twice = np.concatenate((at, at))  # so that play and friction begin as a turn leaves them
    steps = np.arange(SLOWLY * (twice.size - 1) + 1) / SLOWLY
    d = np.interp(steps, np.arange(twice.size), twice) * (1.0 + x.get("scale", 0.0))
    for effect in sorted(model.of(SteeringEffect), key=lambda e: not e.before_servo):
        d = effect.act(d, effect.coordinates(x))
    return np.asarray(d[::SLOWLY][at.size :] - x.get("trim", 0.0))


def _tyre(q: VehicleNumbers, at: Array, front: bool) -> Array:
    """Side force of an axle over its slip angle, without the shift of load."""
    stiffness, share = (q.Cf, q.b) if front else (q.Cr, q.a)
    load = q.m * q.g * share / (q.a + q.b)
    known = load, 1.0 / load, q.inv_mu, q.bend, q.tyre_form
    return np.array([tyre_force(slip, stiffness, *known) for slip in at])


def _damper(q: VehicleNumbers, at: Array) -> Array:
    """Roll moment of damper and dry friction over the roll rate."""
    return np.asarray(q.b_phi * at + q.T_roll * np.tanh(at / (SGN_WIDTH * exp(q.ln_width))))


LAMBDAS = np.geomspace(1e-3, 1e3, 25)  # over the size at which a family adds a row's standard deviation
ON_POINTS = 0.02  # of the prior's penalty on the points themselves, over that on second differences
RESONANCES = 0.5 * 2.0 ** (0.5 * np.arange(9))  # Hz
DAMPING = 0.15  # ratio
DRIVEN_BY = {  # place: what moves a resonator there; no gyro resonates below 10 Hz
    "steering": "delta",
    "side force": "a_y",
    "yaw moment": "r",
    "roll moment": "a_y",
    "sensor of ay": "signal",
}


@dataclass(frozen=True, eq=False)
class UnnamedFamily:
    """law: its place and quantity. a (k, k), b (k,): information and score outside the nominal model's reach,
    at a variance of 1 of the rows. moved (m, k): change of the nominal coordinates, in scales, per unit of
    each point."""

    law: TableLaw
    a: Array
    b: Array
    moved: Array

    def evidence(self, variance: float) -> float:
        """ln of (marginal likelihood with the family/without it), at a variance of the rows."""
        return self.at_best(variance)[0]

    def at_best(self, variance: float) -> tuple[float, Array, Array]:
        """(evidence, coefficients (k,), L (k, k) of their prior's covariance L L^T), at its best width."""
        k = self.b.size
        bend = np.diff(np.eye(k), n=2, axis=0) if self.law.memory != "resonance" else np.zeros((0, k))
        root = np.linalg.inv(np.linalg.cholesky(ON_POINTS * np.eye(k) + bend.T @ bend)).T
        values, vectors = np.linalg.eigh(root.T @ self.a @ root / variance)
        values = np.maximum(values, 0.0)
        if values[-1] < 1e-12:
            return 0.0, np.zeros(k), np.zeros((k, k))
        along = vectors.T @ root.T @ self.b / variance
        width = (LAMBDAS**2 / values[-1])[:, None]
        left = 1.0 + width * values
        found = np.sum(-0.5 * np.log(left) + 0.5 * along**2 * width / left, axis=1)
        best = int(np.argmax(found))
        amounts = root @ (vectors @ (along * width[best] / left[best]))
        return max(float(found[best]), 0.0), amounts, np.asarray(root * np.sqrt(width[best, 0]), float)


def families(problem: Problem, fitted: Fitted) -> list[UnnamedFamily]:
    """The families that these runs can show in the residual of a fit with own Jacobian."""
    found = transfers(problem.runs, fitted.model, fitted.x)
    driven = [(place, DRIVEN_BY[place]) for place in found[0].responses if place in DRIVEN_BY]
    resonances = (resonator(*one, float(f), DAMPING) for one in driven for f in RESONANCES)
    laws = [*groups(found), *resonances]
    every, ends = columns_of(problem, found, laws)
    space = tangent(fitted)
    left = space.outside(fitted.rows)[: space.rows]
    prior = np.diag(prior_information(fitted.free, absent=WEAK))
    normal = fitted.jacobian.T @ fitted.jacobian + prior
    moved: Array = np.asarray(-np.linalg.solve(normal, fitted.jacobian.T @ every), float)
    reach, score = space.q[: space.rows].T @ every, every.T @ left
    out = []
    for law, begin, end in zip(laws, [0, *ends], ends, strict=False):
        part, inside = every[:, begin:end], reach[:, begin:end]
        a = part.T @ part - inside.T @ inside
        out.append(UnnamedFamily(law, np.asarray(a), score[begin:end], moved[:, begin:end]))
    return out


def held_out_costs(
    held: Problem, fitted: Fitted, chosen: Sequence[UnnamedFamily], variance: float
) -> tuple[float, list[float]]:
    """(sum of squares of a held-out run's rows, the same with each family), to first order."""
    here = replace(fitted, rows=held.residual(fitted.model, fitted.x))
    jacobian = sensitivities(held, here).jacobian
    found = transfers(held.runs, fitted.model, fitted.x)
    every, ends = columns_of(held, found, [f.law for f in chosen])
    out = []
    for f, begin, end in zip(chosen, [0, *ends], ends, strict=False):
        rows = here.rows - (every[:, begin:end] + jacobian @ f.moved) @ f.at_best(variance)[1]
        out.append(float(rows @ rows))
    return float(here.rows @ here.rows), out


def columns_of(
    problem: Problem, found: Sequence[RunTransfers], laws: Sequence[TableLaw]
) -> tuple[Array, list[int]]:
    """(rows (size, k) of the points of all laws in the metric, end of each law's columns)."""
    known: dict[TableLaw, list[list[Any]]] = {}
    plain, ends, columns = problem.plain, [], []
    for law in laws:
        # the same signal acts at several places
        key = replace(law, place=law.place if law.place.startswith("sensor") else "")
        if key not in known:
            known[key] = unit_spectra(law, found)
        columns += [added_rows(plain, found, law.place, one) for one in known[key]]
        ends.append(len(columns))
    return problem.of_columns(np.column_stack(columns)), ends
