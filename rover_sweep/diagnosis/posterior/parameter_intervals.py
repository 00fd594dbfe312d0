"""Values of a fitted model's parameters with 90 % intervals.

Two errors count: noise, from the curvature of the cost, and the model's own error. With the Jacobian J, the
priors' weights W and H = J^T J + W, noise gives the covariance v H^-1 (v: variance of a row). Model error
shows in groups of rows (an octave of a channel of a run) whose scores g = J_g^T r_g differ by more than their
noise. The sandwich H^-1 (sum of (g - mean)(g - mean)^T - v J^T J) H^-1 is therefore added (cluster-robust
covariance), where it is positive: noise alone makes the bracket 0.

Liang and Zeger 1986: Longitudinal data analysis using generalized linear models, Biometrika 73(1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import degrees, exp

import numpy as np
from scipy.special import ndtr, ndtri

from rover_sweep.data.geometry import GRAVITY, Geometry, Tolerances
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.recording import Array, Recording
from rover_sweep.data.results import Quantity
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.posterior.model_fit import ModelFit, model_fit
from rover_sweep.diagnosis.problem.least_squares import COARSE, Fitted, fit, prior_information
from rover_sweep.diagnosis.problem.noise_floor import has_floor
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import Baseline
from rover_sweep.diagnosis.simulation.candidates import Model, physical_numbers
from rover_sweep.diagnosis.simulation.experiment import experiment, in_order

DRAWS = 400
SWEEPS = 12  # of the sampler, over all axes
LEVEL = (5.0, 95.0)  # percent
SURE = 0.95  # share of the draws that are implausible, from which a number is
OCTAVES = (0.0, 0.4, 0.8, 1.6, 3.2, 100.0)  # Hz
UNBOUNDED = 1e9  # value of a limit or cut-off that the data do not show
FEWEST = 4  # lines of an octave that form a group


def draw_coordinates(last: ModelFit, seed: int) -> list[dict[str, float]]:
    """`DRAWS` sets {name: value} from the Gaussian at the fit, truncated at the bounds."""
    fitted = last.fitted
    scale = np.array([c.scale for c in fitted.free])
    centre = np.array([fitted.x[c.name] for c in fitted.free])
    low = (np.array([c.low for c in fitted.free]) - centre) / scale
    high = (np.array([c.high for c in fitted.free]) - centre) / scale
    drawn = centre + between_bounds(fit_covariance(last.problem, fitted), low, high, seed) * scale
    names = [c.name for c in fitted.free]
    return [{**fitted.x, **dict(zip(names, map(float, row), strict=True))} for row in drawn]


def between_bounds(covariance: Array, low: Array, high: Array, seed: int) -> Array:
    """`DRAWS` changes (n, k) from a Gaussian about 0 between bounds (k,), which include 0.

    Gibbs sampling along the columns of the covariance's triangular root, since the bound of a coordinate also
    limits those correlated with it, and along each coordinate, since a corner of the bounds may block all
    other directions. Unlike the covariance's axes, these columns have no sign of their own.
    """
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(low.size))
    precision = np.linalg.inv(root.T) @ np.linalg.inv(root)
    random = np.random.default_rng(seed)
    at = np.zeros((DRAWS, low.size))
    for _ in range(SWEEPS):
        for way in (*root.T, *np.eye(low.size)):
            known = way @ precision @ way
            mean, spread = -(at @ (precision @ way)) / known, 1.0 / np.sqrt(known)
            moves = np.abs(way) > 1e-9
            ends = np.stack([(bound[moves] - at[:, moves]) / way[moves] for bound in (low, high)])
            first, last = np.max(ends.min(axis=0), axis=1), np.min(ends.max(axis=0), axis=1)
            below, above = ndtr((first - mean) / spread), ndtr((last - mean) / spread)
            share = below + (above - below) * random.uniform(size=DRAWS)
            step = mean + spread * ndtri(np.clip(share, 1e-12, 1.0 - 1e-12))
            at = at + np.clip(step, first, np.maximum(first, last))[:, None] * way
    return np.clip(at, low, high)


def fit_covariance(problem: Problem, fitted: Fitted) -> Array:
    """Covariance (k, k) of the coordinates of a fit over their scales, see the module."""
    prior = prior_information(fitted.free) / COARSE  # the noise counts in full here
    known = fitted.jacobian.T @ fitted.jacobian
    values, axes = np.linalg.eigh(np.linalg.inv(known + np.diag(prior + 1e-6)))
    root = axes * np.sqrt(np.maximum(values, 0.0)) @ axes.T
    scores = _scores(problem, fitted)
    scores = scores - scores.mean(axis=0)
    spread = scores.T @ scores * (len(scores) / max(len(scores) - 1, 1))
    beyond, ways = np.linalg.eigh(root @ (spread - known * fitted.overdispersion) @ root)
    return np.asarray(root @ (ways * (fitted.overdispersion + np.maximum(beyond, 0.0)) @ ways.T) @ root)


def _scores(problem: Problem, fitted: Fitted) -> Array:
    """(groups, k): score of each octave of each channel of each run, by coordinate over its scale."""
    out = []
    for rows in problem.rows:
        for low, high in zip(OCTAVES, OCTAVES[1:], strict=False):
            lines = rows.start + np.flatnonzero((rows.f >= low) & (rows.f < high))
            if lines.size >= FEWEST:
                both = np.concatenate((lines, lines + rows.bins.size))
                out.append(fitted.jacobian[both].T @ fitted.rows[both])
    return np.array(out)


def effect_values(effect: Effect, last: ModelFit, drawn: list[dict[str, float]]) -> tuple[Quantity, ...]:
    """The reported parameters of an effect with their intervals."""
    out, drawn = [], _with_doubt(effect, drawn)
    for name, (value, unit, meaning) in effect.reported(last.fitted.x).items():
        low, high = _interval(drawn, lambda x, n=name: effect.reported(x)[n][0])  # type: ignore[misc]
        begin = 0.0
        if effect.in_one_run and name == "t":  # on the clock of the recording
            begin = next(r.begin for r in last.problem.runs if r.name == last.model.happened_in)
        found = Quantity(name, unit, value + begin, shown_end(low + begin), shown_end(high + begin), meaning)
        if not np.isfinite(value):  # a limit or cut-off of which only the lower bound is known
            words = f"{meaning}; not visible in these data"
            found = replace(found, value=UNBOUNDED, high=None, meaning=words)
        out.append(found)
    return tuple(out)


def holds_absence(effect: Effect, drawn: list[dict[str, float]]) -> bool:
    """True if the 90 % interval of each size of the effect includes its absence."""
    names = [effect.coordinate_name(p) for p in effect.parameters if p.name != "t"]
    doubtful = _with_doubt(effect, drawn)
    ends = [np.percentile([x.get(name, 0.0) for x in doubtful], LEVEL) for name in names]
    return bool(ends) and all(low <= 0.0 <= high for low, high in ends)


def implausible_numbers(last: ModelFit, drawn: list[dict[str, float]]) -> tuple[str, ...]:
    """Sentences on the vehicle file, and on numbers that are implausible in nearly all draws."""
    rover = last.model.rover
    every = [physical_numbers(x, rover) for x in drawn]
    sure = {
        name: value
        for name, value in physical_numbers(last.fitted.x, rover).items()
        if implausible(rover, {name: value})
        and np.mean([bool(implausible(rover, {name: one[name]})) for one in every]) >= SURE
    }
    return implausible(rover, sure)


def _with_doubt(effect: Effect, drawn: list[dict[str, float]]) -> list[dict[str, float]]:
    """The draws with the uncertainty that no such recording reduces (`Effect.doubt`) added."""
    random = np.random.default_rng(len(drawn))
    out = drawn
    for p in effect.parameters:
        if not p.doubt:
            continue
        name = effect.coordinate_name(p)
        moves = p.doubt * p.per * random.standard_normal(len(out))
        out = [{**x, name: x.get(name, 0.0) + float(move)} for x, move in zip(out, moves, strict=True)]
    return out


def _interval(
    drawn: list[dict[str, float]], of: Callable[[Mapping[str, float]], float]
) -> tuple[float, float]:
    values: Array = np.array([of(x) for x in drawn])
    values = np.where(np.isfinite(values), values, 1e12)
    low, high = np.percentile(values, LEVEL)
    return float(low), float(high)


def shown_end(x: float) -> float | None:
    """An end of an interval, None if it is unlimited."""
    return float(x) if np.isfinite(x) and abs(x) < UNBOUNDED else None


# The rover's numbers from the posterior of a fitted model: medians and 90 % intervals of its draws.
#
# What a fit of the responses alone must assume is drawn with them here: errors of the vehicle file, lag and
# delay of the steering, bend of the tyres, place of the CG. So a stiffness does not carry those errors, and
# K_us comes from the draws of both axles together.


WIDE = 3.0  # standard deviations from which a bound takes over where the ratio of both axles is a Gaussian
TOLD = {
    "Cf": ("N/rad", "cornering stiffness of the front axle"),
    "Cr": ("N/rad", "cornering stiffness of the rear axle"),
    "K_us": ("deg/g", "understeer gradient"),
    "Izz": ("kg m^2", "yaw inertia about the CG"),
    "k_phi": ("N m/rad", "roll stiffness"),
    "b_phi": ("N m s/rad", "roll damping"),
    "tau": ("s", "lag and delay of the steering"),
}


def fitted_baseline(
    runs: Sequence[Recording], rover: Geometry, baseline: Baseline, spread: Tolerances
) -> ModelFit | None:
    """The baseline fitted to sweeps, without effects; None if they are too short for a noise floor."""
    used = in_order([experiment(run) for run in runs])
    if not has_floor(used):
        return None
    model = Model(baseline, rover, spread, two_clocks=any(run.two_clocks for run in used))
    return model_fit(used, model, {})


def rover_numbers(last: ModelFit, seed: int) -> tuple[Quantity, ...]:
    """The physical parameters of a fitted model, with 90 % intervals.

    Of a model with tyres: Cf, Cr, K_us, I_zz, of roll k_phi and b_phi, and tau. Of others its own parameters.
    """
    rover = last.model.rover
    drawn = draw_coordinates(_with_free_axles(last), seed)
    values = [_numbers(x, rover) for x in drawn] if not last.model.lumped else []
    if not values or "Cf" not in values[0]:
        own = [c for c in last.fitted.free if c.parameter]
        return tuple(_value(c.parameter, c.unit, "", [exp(x[c.name]) for x in drawn]) for c in own)
    told = {name: words for name, words in TOLD.items() if name in values[0]}
    return tuple(_value(name, *told[name], [v[name] for v in values]) for name in told)


def _with_free_axles(last: ModelFit) -> ModelFit:
    """The fit with a Gaussian for ln(Cf/Cr) instead of the search bounds, which truncate it."""
    ratio, spread = "ln_ratio", last.model.spread.ratio
    free = tuple(
        replace(c, low=-WIDE * spread, high=WIDE * spread, prior=spread)
        if c.name == ratio and c.high == spread
        else c
        for c in last.fitted.free
    )
    if free == last.fitted.free:
        return last
    fitted = fit(last.problem, last.fitted.model, last.fitted.x, free)
    return replace(last, fitted=fitted)


def _numbers(x: Mapping[str, float], rover: Geometry) -> dict[str, float]:
    """{name: value} at drawn coordinates."""
    out, moved = physical_numbers(x, rover), x.get("da", 0.0)
    if "ln_b_phi" in x:
        out["b_phi"] = exp(x["ln_b_phi"])
    if "Cf" in out:
        slack = (rover.b - moved) / out["Cf"] - (rover.a + moved) / out["Cr"]
        out["K_us"] = degrees(rover.mass / rover.wheelbase * slack * GRAVITY)
        out["tau"] = x.get("lag", 0.0) + x.get("delay", 0.0)
    return out


def _value(name: str, unit: str, meaning: str, values: Sequence[float]) -> Quantity:
    low, middle, high = np.percentile(values, (LEVEL[0], 50.0, LEVEL[1]))
    return Quantity(name, unit, float(middle), float(low), float(high), meaning)
