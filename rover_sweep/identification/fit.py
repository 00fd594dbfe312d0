"""Fits of model structures to frequency responses, with Cramer-Rao bounds and insensitivities.

The accuracies follow from the curvature of the summed cost J at the optimum theta^ (equations 12 to 14 of
the paper; Tischler & Remple 2012, chapter 12). The gradient is zero there, so with the residuals' Jacobian

    J(theta^ + d) = J(theta^) + d^T H d / 2,   H = 2 Jac^T Jac

where the second derivatives of the residuals are neglected, as Gauss-Newton does.
Insensitivity: moving theta_i alone by d raises J by H_ii d^2/2, so I_i = 1/sqrt(H_ii) raises it by 1/2.
Cramer-Rao: for independent residuals of variance s^2 no unbiased estimate has a smaller covariance than
s^2 (Jac^T Jac)^-1 = 2 s^2 H^-1. Equation (13), CR_i = 2 sqrt((H^-1)_ii), amounts to s^2 = 2.
(H^-1)_ii >= 1/H_ii, so CR_i >= 2 I_i, equal where theta_i is correlated with no other parameter. Both are
divided by |theta_i|: the columns of Jac are scaled by theta.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from rover_sweep.data.recording import Array, Complex, LowPass
from rover_sweep.data.results import (
    ByName,
    PlainNumbers,
    Quantity,
    ShortTable,
    Shown,
    ends_words,
    plain_number,
)
from rover_sweep.identification.modes import mode_quantities
from rover_sweep.identification.state_space import ModelStructure, Parameter
from rover_sweep.spectra.response import Band, FrequencyResponse

# Further starting points of a fit, which show whether its result depends on the start.
#
# Each draws every free parameter, reproducibly for a structure: positive ones by a factor (log-uniform, 0.1
# to 10), bounded ones of either sign uniformly between their bounds, delays uniformly up to three times
# their value, unbounded ones of either sign around zero; all within the bounds. `near_starts` stays within
# 60 % of the present values, for a structure whose starting values are already good.


COUNT = 3
REACH = 10.0  # largest factor between start and value of a positive parameter
NEAR = 0.6  # of the value: reach of `near_starts`
DELAY_REACH = 3.0  # times its value, of a delay: with much more, the phase is off by 360 deg


def drawn_starts(structure: ModelStructure, count: int = COUNT, seed: int = 0) -> list[dict[str, float]]:
    """`count` starting points {free parameter: value}, the same for a seed."""
    rng = np.random.default_rng(seed)
    delays = structure.delays
    return [{p.name: _drawn(p, p.name in delays, rng) for p in structure.free} for _ in range(count)]


def near_starts(structure: ModelStructure, count: int = COUNT, seed: int = 0) -> list[dict[str, float]]:
    """`count` starting points within 60 % of the present values, the same for a seed."""
    rng = np.random.default_rng(seed)
    return [
        {
            p.name: float(np.clip(p.value * (1 + NEAR * rng.uniform(-1, 1)), p.lower, p.upper))
            for p in structure.free
        }
        for _ in range(count)
    ]


def farthest(best: ModelStructure, others: Sequence[ModelStructure]) -> tuple[str, float]:
    """(parameter, relative difference) with the largest difference of the others from the best.

    Relative to the best value, or absolute where that is 0.
    """
    apart = {
        p.name: max(abs(o.values[p.name] - p.value) for o in others) / (abs(p.value) or 1.0)
        for p in best.free
    }
    name = max(apart, key=lambda n: apart[n], default="")
    return name, apart.get(name, 0.0)


def _drawn(p: Parameter, delay: bool, rng: np.random.Generator) -> float:
    share = float(rng.uniform())
    if delay:
        value = share * DELAY_REACH * p.value
    elif p.lower >= 0 and p.value > 0:
        value = p.value * REACH ** (2 * share - 1)
    elif np.isfinite(p.lower) and np.isfinite(p.upper):
        value = p.lower + share * (p.upper - p.lower)
    else:
        value = 3 * (2 * share - 1) * (abs(p.value) or 1.0)
    return float(np.clip(value, p.lower, p.upper))


# The cost of a model against measured frequency responses: residuals, their derivatives, J.
#
# For each response, n points w_i, log spaced over its usable band (equation 11 of the paper, with its |T|
# read as dB and its phase as degrees; Tischler & Remple 2012, chapter 11):
#
#     J = (20/n) sum_i W_i [ (dB error)^2 + W_p (deg error)^2 ],  W_i = [1.58 (1 - exp(-g2_i))]^2
#
# W_p = 0.01745 makes 7.57 deg weigh as much as 1 dB; W_i is 1 at coherence 1 and .39 at coherence .5.
# With e = ln(H_data/H_model) both errors are one complex number: dB = (20/ln 10) Re e, deg = (180/pi) Im e.
# The residuals are these errors times sqrt(20 W_i/n) and, for the phase, sqrt(W_p); so their squares sum to
# J. Their derivatives follow from d ln H/d theta, which the structure gives by complex step, with the sign
# reversed because the model is subtracted. A fit over several responses and speeds minimises the sum of J.


PHASE_WEIGHT = 0.01745  # W_p: 7.57 deg weigh as much as 1 dB (W_g = 1)
POINTS = 20  # log-spaced points a response


@dataclass(frozen=True, eq=False)
class ResponseData:
    """The points of one response in the cost: w (n,) rad/s, h (n,) in output unit per input unit.

    coherence (n,): 0..1, the partial coherence where another input was taken out.
    """

    output: str
    w: Array
    h: Complex
    coherence: Array
    input: str = "delta"

    @property
    def label(self) -> str:
        """`output` for the steering input, "output/input" for another one."""
        return self.output if self.input == "delta" else f"{self.output}/{self.input}"

    @property
    def weight(self) -> Array:
        """W_gamma (n,) = [1.58 (1 - exp(-g2))]^2 of equation (11)."""
        return (1.58 * (1.0 - np.exp(-self.coherence))) ** 2


@dataclass(frozen=True, eq=False)
class Condition:
    """Responses at one speed [m/s]. filters: known low-passes of the sensors, by output."""

    speed: float
    data: tuple[ResponseData, ...]
    filters: Mapping[str, LowPass]


def sampled(response: FrequencyResponse, band: Band, points: int = POINTS) -> ResponseData:
    """`points` log-spaced points of a measured response within a band (low, high) [rad/s]."""
    w = np.geomspace(*band, points)
    h, coherence = response.at(w)
    return ResponseData(response.output, w, h, np.clip(coherence, 0.0, 1.0), response.input)


def residuals(structure: ModelStructure, condition: Condition) -> dict[str, Array]:
    """Weighted residuals (2n,) of each response: n in dB, then n in deg; their squares sum to its J."""
    out = {}
    for data in condition.data:
        model = structure.response(data.w, condition.speed, data.output, condition.filters, data.input)
        out[data.label] = weighted_errors(data, model)
    return out


def weighted_errors(data: ResponseData, model: Complex) -> Array:
    """Residuals (2n,) of a model's complex response (n,) at the points of a measured one."""
    ratio = data.h / model
    scale = np.sqrt(20.0 / data.w.size * data.weight)
    db = 20 * np.log10(np.abs(ratio))
    deg = np.degrees(np.angle(ratio)) * np.sqrt(PHASE_WEIGHT)
    return np.concatenate((scale * db, scale * deg))


def jacobian(structure: ModelStructure, condition: Condition) -> Array:
    """d residuals / d theta (2n per response, n_free), responses in the order of `condition.data`."""
    blocks = []
    for data in condition.data:
        s = structure.log_sensitivity(data.w, condition.speed, data.output, data.input)
        scale = np.sqrt(20.0 / data.w.size * data.weight)[:, None]
        deg = np.degrees(s.imag) * np.sqrt(PHASE_WEIGHT)
        blocks += [-scale * s.real * 20 / np.log(10), -scale * deg]
    return np.concatenate(blocks)


def costs(structure: ModelStructure, conditions: Sequence[Condition]) -> dict[str, float]:
    """J of each response, equation (11), averaged over the conditions."""
    values: dict[str, list[float]] = {}
    for condition in conditions:
        for label, r in residuals(structure, restricted(condition, structure)).items():
            values.setdefault(label, []).append(float(r @ r))
    return {label: float(np.mean(j)) for label, j in values.items()}


def restricted(condition: Condition, structure: ModelStructure) -> Condition:
    """The condition with only the responses that the structure has; ValueError when it has none of them."""
    kept = tuple(d for d in condition.data if d.output in structure.outputs and d.input in structure.inputs)
    if not kept:
        raise ValueError(
            f"{structure.name} has none of the responses {[d.label for d in condition.data]}: outputs "
            f"{structure.outputs}, inputs {structure.inputs}"
        )
    return Condition(condition.speed, kept, condition.filters)


TOLERABLE = 200.0  # J of a single response that is still tolerable (Tischler & Remple 2012, chapter 12)
MARGIN = 1e-3  # rad/s: numerical error of a pole at 0


AT_BOUND = 1e-6  # distance from a bound, in the unit of the parameter
NO_DELAY = 1e-3  # s


@dataclass(frozen=True)
class Estimate(Quantity):
    """A parameter after the fit, with the interval of the bootstrap where one was requested.

    The interval of the noise is corrected for the method's bias, then widened to hold the estimate; of the
    bicycle and roll-yaw model it includes errors of the structure, see `with_structural_error`. low, high, sd
    and bias are nan when more than half of the replicates failed.
    cr_percent, insensitivity_percent: equations (13) and (14) in % of |value|, None for a fixed parameter
    and infinite for a value of 0. at_bound: where the fit ran into a bound; a delay of 0 is a result. Such an
    estimate has no interval.
    sd, bias: standard deviation of the estimate and bias of the method by the bootstrap, of the noise alone.
    replicates: number that converged; failed: number that did not.
    """

    free: bool = True
    cr_percent: float | None = None
    insensitivity_percent: float | None = None
    at_bound: bool = False
    sd: float | None = None
    bias: float | None = None
    replicates: int = 0
    failed: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(PlainNumbers, Shown):
    """A fitted structure. costs: J of each response, equation (11); speed [m/s]: of the first condition."""

    structure: ModelStructure
    speed: float
    estimates: tuple[Estimate, ...]
    costs: Mapping[str, float]
    spread: float
    """Largest relative difference of a parameter among starts that reached the same cost."""
    covariance: Array | None = None
    """4 H^-1 of the free parameters (n_free, n_free), in their units: CR_i^2 on the diagonal."""
    spread_in: str = ""
    """The parameter that differs most among those starts."""
    starts: int = 1
    """Number of starting points of the fit."""
    rivals: tuple[float, ...] = ()
    """J_ave of each start that ended in another local minimum with a cost low enough to be accepted."""
    mode_intervals: tuple[Quantity, ...] = ()
    """The quantities of `modes` with intervals by the bootstrap."""

    @property
    def parameters(self) -> ByName[Estimate]:
        """The estimates by name, as in identification.json: parameters["C"].value."""
        return ByName(self.estimates)

    @property
    def average(self) -> float:
        """J_ave over the responses."""
        return float(np.mean(list(self.costs.values())))

    @property
    def modes(self) -> ByName[Quantity]:
        """Frequency, damping and time constant of the yaw and the roll mode, see `ModelResult.modes`."""
        return mode_quantities(self.structure, self.speed, self.mode_intervals)

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    def table(self) -> ShortTable:
        """The free parameters with 90 % intervals, else CR and I; the fixed ones, the costs."""
        free = [e for e in self.estimates if e.free]
        known = any(e.interval_90 for e in free)
        rows = tuple(
            (
                e.name,
                plain_number(e.value),
                e.unit,
                *((ends_words(e.low, e.high, 4),) if known else ()),
                *(() if known else (plain_number(e.cr_percent, 3), plain_number(e.insensitivity_percent, 3))),
            )
            for e in free
        )
        fixed = ", ".join(f"{e.name} {plain_number(e.value)} {e.unit}" for e in self.estimates if not e.free)
        costs = ", ".join(f"{output} {j:.1f}" for output, j in self.costs.items())
        return ShortTable(
            f"{self.structure.name} model at {self.speed:.2f} m/s",
            ("parameter", "value", "unit", *(("90 % interval",) if known else ("CR %", "I %"))),
            rows,
            (f"fixed: {fixed or 'none'}", f"J: {costs}; average {self.average:.1f}"),
        )


def accuracy(structure: ModelStructure, conditions: Sequence[Condition]) -> tuple[Array, Array]:
    """Cramer-Rao bounds and insensitivities (n_free,) in percent of |theta|, equations (12)-(14).

    H is the Hessian of the SUM of the costs, 2 Jac^T Jac near the optimum.
    """
    theta = np.abs([p.value for p in structure.free])
    jac = np.concatenate([jacobian(structure, c) for c in conditions])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        insensitivity = 1 / np.sqrt(2 * np.sum(jac**2, axis=0)) / theta
        bound = np.sqrt(np.diag(covariance(structure, conditions))) / theta
    return 100 * bound, 100 * insensitivity


def covariance(structure: ModelStructure, conditions: Sequence[Condition]) -> Array:
    """4 H^-1 (n_free, n_free) in parameter units; infinite where the data do not determine a parameter."""
    jac = np.concatenate([jacobian(structure, c) for c in conditions])
    scale = np.linalg.norm(jac, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        try:
            inverse = np.linalg.inv((jac / scale).T @ (jac / scale))
        except np.linalg.LinAlgError:
            return np.full((scale.size, scale.size), np.inf)
        return np.asarray(2 * inverse / np.outer(scale, scale))


def fit(
    structure: ModelStructure,
    conditions: Sequence[Condition],
    starts: Sequence[Mapping[str, float]] = (),
    tolerance: float = 1e-9,
    stable: bool = False,
) -> FitResult:
    """Minimises the sum of the costs (equation 11) over all conditions in the free parameters.

    starts: further starting points {parameter: value}; the lowest minimum is returned. tolerance: relative,
    of cost and parameters. stable: from a stable start, never step to an unstable model. A frequency
    response cannot separate a lag from an unstable pole with another delay, but the recorded rover was
    stable.
    """
    usable = tuple(restricted(c, structure) for c in conditions)
    ends = [_descend(structure.with_values(s), usable, tolerance, stable) for s in ({}, *starts)]
    best = min(ends, key=lambda e: e[1])
    same = best[1] * 1.001 + 1e-6
    name, spread = farthest(best[0], [s for s, total in ends if total <= same])
    found = evaluated(best[0], usable, spread)
    mean = found.average / best[1] if best[1] else 0.0
    rivals = sorted(mean * total for _, total in ends if total > same)
    within = tuple(j for j in rivals if j <= max(TOLERABLE, 2 * found.average))
    return replace(found, spread_in=name, starts=len(ends), rivals=within)


def evaluated(structure: ModelStructure, conditions: Sequence[Condition], spread: float = 0.0) -> FitResult:
    """Costs and accuracies of a structure at its present values. spread: passed on to the result."""
    usable = tuple(restricted(c, structure) for c in conditions)
    cr, insensitivity = accuracy(structure, usable)
    by_name = {p.name: (cr[i], insensitivity[i]) for i, p in enumerate(structure.free)}
    estimates = tuple(
        Estimate(
            p.name,
            p.unit,
            p.value,
            None,
            None,
            p.meaning,
            None,
            p.free,
            *by_name.get(p.name, (None, None)),
            p.free
            and any(abs(p.value - end) <= 1e-3 * abs(end) + 1e-9 for end in (p.lower, p.upper))
            and not (p.name in structure.delays and p.value < NO_DELAY),
        )
        for p in structure.parameters
    )
    spreads = covariance(structure, usable)
    return FitResult(structure, usable[0].speed, estimates, costs(structure, usable), spread, spreads)


def has_zero_response(structure: ModelStructure, conditions: Sequence[Condition]) -> bool:
    """True when one of the model's responses is zero at some frequency, at the present values."""
    return any(
        not np.all(np.abs(structure.response(d.w, c.speed, d.output, input=d.input)) > 0)
        for c in conditions
        for d in restricted(c, structure).data
    )


def is_stable(structure: ModelStructure, conditions: Sequence[Condition]) -> bool:
    """True when no pole has a positive real part at any speed; a pole at 0 (Table 4) counts as stable."""
    poles = np.concatenate([structure.poles(c.speed) for c in conditions])
    return bool(np.max(poles.real) < MARGIN)


def _descend(
    structure: ModelStructure, conditions: Sequence[Condition], tolerance: float, stable: bool
) -> tuple[ModelStructure, float]:
    free = structure.free
    log = np.array([p.lower > 0 for p in free])  # positive parameters, as logarithms
    start, low, high = np.array([(p.value, p.lower, p.upper) for p in free], dtype=float).T.copy()
    for a in (start, low, high):
        a[log] = np.log(a[log])
    fenced = stable and is_stable(structure, conditions)
    size = 2 * sum(d.w.size for c in conditions for d in c.data)
    names = [p.name for p in structure.free]

    def at(x: Array) -> ModelStructure:
        theta = np.where(log, np.exp(np.minimum(x, 700)), x)
        return structure.with_values(dict(zip(names, theta, strict=True)))

    def error(x: Array) -> Array:
        s = at(x)
        if fenced and not is_stable(s, conditions):
            return np.full(size, np.inf)  # least_squares takes a shorter step
        return np.concatenate([r for c in conditions for r in residuals(s, c).values()])

    def slope(x: Array) -> Array:
        s = at(x)
        jac = np.concatenate([jacobian(s, c) for c in conditions])
        return jac * np.where(log, [p.value for p in s.free], 1.0)

    inside = np.clip(start, low + 1e-9, high - 1e-9)
    done = least_squares(
        error,
        inside,
        jac=slope,
        bounds=(low, high),
        x_scale="jac",
        xtol=tolerance,
        ftol=tolerance,
        max_nfev=300,
    )
    ended = ~log & (done.x - low < AT_BOUND)  # the search stops a little inside of a bound
    return at(np.where(ended, low, done.x)), float(2 * done.cost)
