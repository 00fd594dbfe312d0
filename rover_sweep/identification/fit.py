"""Fits of model structures to frequency responses: the cost of equation (11), Cramer-Rao, insensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from rover_sweep.data.intervals import Intervals
from rover_sweep.data.recording import Array, LowPass
from rover_sweep.data.result_table import ShortTable, Shown, number
from rover_sweep.identification.starts import farthest
from rover_sweep.identification.structure.state_space import ModelStructure, Parameter
from rover_sweep.spectra.response import Band, FrequencyResponse
from rover_sweep.spectra.spectra import Complex

PHASE_WEIGHT = 0.01745  # W_p: 7.57 deg weigh as much as 1 dB (W_g = 1)
POINTS = 20  # log-spaced points a response
TOLERABLE = 200.0  # J beyond which nobody takes a fit for an answer (Tischler & Remple 2012)
MARGIN = 1e-3  # rad/s, by which an integrator's computed pole may miss 0


@dataclass(frozen=True, eq=False)
class ResponseData:
    """What the cost sees of one response: h (n,) complex per unit of input at w (n,), coherence (n,)."""

    output: str
    w: Array
    h: Complex
    coherence: Array
    input: str = "delta"

    @property
    def label(self) -> str:
        """The output, for the steering; "output/input" for another input."""
        return self.output if self.input == "delta" else f"{self.output}/{self.input}"

    @property
    def weight(self) -> Array:
        """W_gamma = [1.58 (1 - exp(-g2))]^2."""
        return (1.58 * (1.0 - np.exp(-self.coherence))) ** 2


@dataclass(frozen=True, eq=False)
class Condition:
    """Responses of runs at one speed [m/s], with the known low-passes of the sensors by output."""

    speed: float
    data: tuple[ResponseData, ...]
    filters: Mapping[str, LowPass]


def sampled(response: FrequencyResponse, band: Band, points: int = POINTS) -> ResponseData:
    """`points` log-spaced points of a measured response within a band [rad/s]."""
    w = np.geomspace(*band, points)
    h, coherence = response.at(w)
    return ResponseData(response.output, w, h, np.clip(coherence, 0.0, 1.0), response.input)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A parameter after the fit. cr_percent, insensitivity_percent: equations (13), (14) in % of |value|.

    interval: by the bootstrap, where it was asked for.
    """

    name: str
    unit: str
    value: float
    free: bool
    cr_percent: float | None
    insensitivity_percent: float | None
    at_bound: bool = False
    meaning: str = ""
    interval: Intervals | None = None


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Shown):
    """A fitted structure. costs: J of each response; average: J_ave; poles at the first condition's speed."""

    structure: ModelStructure
    speed: float
    estimates: tuple[Estimate, ...]
    costs: Mapping[str, float]
    spread: float
    """Largest relative difference of a parameter among starts that reached the same cost."""
    covariance: Array | None = None
    """Of the free parameters (n_free, n_free), in their units: roots of the diagonal are the CR bounds."""
    spread_in: str = ""
    """The parameter that differs most among those starts."""
    starts: int = 1
    """How many starts it was fitted from."""
    rivals: tuple[float, ...] = ()
    """J_ave of each start that ended at a higher cost, but low enough to pass for an answer."""

    @property
    def average(self) -> float:
        """J_ave over the responses."""
        return float(np.mean(list(self.costs.values())))

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    def table(self) -> ShortTable:
        """The free parameters with their accuracies, the fixed ones, the costs."""
        free = [e for e in self.estimates if e.free]
        rows = tuple(
            (e.name, number(e.value), e.unit, number(e.cr_percent, 3), number(e.insensitivity_percent, 3))
            for e in free
        )
        fixed = ", ".join(f"{e.name} {number(e.value)} {e.unit}" for e in self.estimates if not e.free)
        costs = ", ".join(f"{output} {j:.1f}" for output, j in self.costs.items())
        return ShortTable(
            f"{self.structure.name} model at {self.speed:.2f} m/s",
            ("parameter", "value", "unit", "CR %", "I %"),
            rows,
            (f"fixed: {fixed or 'none'}", f"J: {costs}; average {self.average:.1f}"),
        )


def residuals(structure: ModelStructure, condition: Condition) -> dict[str, Array]:
    """Weighted residuals (2n,) per response, [dB errors, deg errors], whose squares sum to its J."""
    out = {}
    for data in condition.data:
        model = structure.response(data.w, condition.speed, data.output, condition.filters, data.input)
        ratio = data.h / model
        scale = np.sqrt(20.0 / data.w.size * data.weight)
        db = 20 * np.log10(np.abs(ratio))
        deg = np.degrees(np.angle(ratio)) * np.sqrt(PHASE_WEIGHT)
        out[data.label] = np.concatenate((scale * db, scale * deg))
    return out


def jacobian(structure: ModelStructure, condition: Condition) -> Array:
    """d residuals / d theta (n_residuals, n_free), residuals in the order of `condition.data`."""
    blocks = []
    for data in condition.data:
        s = structure.log_sensitivity(data.w, condition.speed, data.output, data.input)
        scale = np.sqrt(20.0 / data.w.size * data.weight)[:, None]
        deg = np.degrees(s.imag) * np.sqrt(PHASE_WEIGHT)
        blocks += [-scale * s.real * 20 / np.log(10), -scale * deg]
    return np.concatenate(blocks)


def costs(structure: ModelStructure, conditions: Sequence[Condition]) -> dict[str, float]:
    """J of each response of the structure, equation (11): the mean over several conditions."""
    values: dict[str, list[float]] = {}
    for condition in conditions:
        for label, r in residuals(structure, restricted(condition, structure)).items():
            values.setdefault(label, []).append(float(r @ r))
    return {label: float(np.mean(j)) for label, j in values.items()}


def accuracy(structure: ModelStructure, conditions: Sequence[Condition]) -> tuple[Array, Array]:
    """Cramer-Rao bounds and insensitivities (n_free,) in percent of |theta|, equations (12)-(14).

    H is the Hessian of the SUM of the costs, 2 Jac^T Jac near the optimum.
    """
    theta = np.abs([p.value for p in structure.free])
    jac = np.concatenate([jacobian(structure, c) for c in conditions]) * theta
    hessian = 2 * jac.T @ jac
    with np.errstate(divide="ignore", invalid="ignore"):
        insensitivity = 1 / np.sqrt(np.diag(hessian))
        try:
            bound = 2 * np.sqrt(np.abs(np.diag(np.linalg.inv(hessian))))
        except np.linalg.LinAlgError:
            bound = np.full(theta.size, np.inf)
    return 100 * bound, 100 * insensitivity


def covariance(structure: ModelStructure, conditions: Sequence[Condition]) -> Array:
    """4 H^-1 (n_free, n_free) in parameter units; infinite where the data leave a parameter open."""
    jac = np.concatenate([jacobian(structure, c) for c in conditions])
    scale = np.linalg.norm(jac, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        try:
            inverse = np.linalg.inv((jac / scale).T @ (jac / scale))
        except np.linalg.LinAlgError:
            return np.full((scale.size, scale.size), np.inf)
        return np.asarray(2 * inverse / np.outer(scale, scale))


def _vector(structure: ModelStructure) -> tuple[Array, Array, Array, np.ndarray]:
    """Start, bounds and a mask of the parameters that are fitted as logarithms (positive ones)."""
    free = structure.free
    log = np.array([p.lower > 0 for p in free])
    start, low, high = np.array([(p.value, p.lower, p.upper) for p in free], dtype=float).T.copy()
    for a in (start, low, high):
        a[log] = np.log(a[log])
    return start, low, high, log


def fit(
    structure: ModelStructure,
    conditions: Sequence[Condition],
    starts: Sequence[Mapping[str, float]] = (),
    tolerance: float = 1e-9,
    stable: bool = False,
) -> FitResult:
    """The structure with its free parameters at the least sum of costs over all conditions.

    starts: further starting values by name; the best end is kept. `spread` says how far others that
    reached the same cost lie from it, `rivals` which ended elsewhere. stable: from a stable start, do not
    step to values with an unstable pole: in a response that is a lag with less delay, but no rover drives
    a record with it.
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
    """Costs and accuracies of a structure at its present values."""
    usable = tuple(restricted(c, structure) for c in conditions)
    cr, insensitivity = accuracy(structure, usable)
    by_name = {p.name: (cr[i], insensitivity[i]) for i, p in enumerate(structure.free)}
    estimates = tuple(
        Estimate(p.name, p.unit, p.value, p.free, *by_name.get(p.name, (None, None)), _at_bound(p), p.meaning)
        for p in structure.parameters
    )
    spreads = covariance(structure, usable)
    return FitResult(structure, usable[0].speed, estimates, costs(structure, usable), spread, spreads)


def silent(structure: ModelStructure, conditions: Sequence[Condition]) -> bool:
    """True when the structure at its present values gives no answer at all in one of the responses."""
    return any(
        not np.all(np.abs(structure.response(d.w, c.speed, d.output, input=d.input)) > 0)
        for c in conditions
        for d in restricted(c, structure).data
    )


def is_stable(structure: ModelStructure, conditions: Sequence[Condition]) -> bool:
    """No pole right of the axis at any speed; one at 0, as in the paper's Table 4, is none."""
    poles = np.concatenate([structure.poles(c.speed) for c in conditions])
    return bool(np.max(poles.real) < MARGIN)


def _at_bound(p: Parameter) -> bool:
    return p.free and (p.value <= p.lower * (1 + 1e-3) + 1e-9 or p.value >= p.upper * (1 - 1e-3))


def restricted(condition: Condition, structure: ModelStructure) -> Condition:
    """The condition with only those responses that the structure has; ValueError where there is none."""
    """The responses that the structure has."""
    kept = tuple(d for d in condition.data if d.output in structure.outputs and d.input in structure.inputs)
    if not kept:
        raise ValueError(
            f"no response among {[d.label for d in condition.data]} is one of {structure.name}: "
            f"{structure.outputs} to {structure.inputs}"
        )
    return Condition(condition.speed, kept, condition.filters)


def _descend(
    structure: ModelStructure, conditions: Sequence[Condition], tolerance: float, stable: bool
) -> tuple[ModelStructure, float]:
    start, low, high, log = _vector(structure)
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
    return at(done.x), float(2 * done.cost)
