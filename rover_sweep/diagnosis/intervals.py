"""Values of a fitted model's parameters with 90 % intervals, from the curvature of its cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import exp

import numpy as np

from rover_sweep.diagnosis.choose import Round
from rover_sweep.diagnosis.result import EffectValue
from rover_sweep.identify.effects import Effect
from rover_sweep.identify.recording import Array

DRAWS = 400
LEVEL = (5.0, 95.0)  # percent


def draws(last: Round, seed: int) -> list[dict[str, float]]:
    """Coordinates drawn from the Gaussian at the fit, held within the bounds."""
    fitted = last.fitted
    scale = np.array([c.scale for c in fitted.free])
    prior = np.array([(c.scale / c.prior) ** 2 if c.prior else 0.0 for c in fitted.free])
    curvature = fitted.jacobian.T @ fitted.jacobian + np.diag(prior + 1e-6)
    covariance = np.linalg.inv(curvature) * last.overdispersion
    values, axes = np.linalg.eigh(covariance)
    random = np.random.default_rng(seed)
    moves = random.standard_normal((DRAWS, scale.size)) * np.sqrt(np.maximum(values, 0.0)) @ axes.T
    centre = np.array([fitted.x[c.name] for c in fitted.free])
    low, high = np.array([c.low for c in fitted.free]), np.array([c.high for c in fitted.free])
    drawn = np.clip(centre + moves * scale, low, high)
    names = [c.name for c in fitted.free]
    return [{**fitted.x, **dict(zip(names, map(float, row), strict=True))} for row in drawn]


def effect_values(effect: Effect, last: Round, drawn: list[dict[str, float]]) -> tuple[EffectValue, ...]:
    """The parameters that a user reads of an effect."""
    out = []
    for name, (value, unit, meaning) in effect.reported(last.fitted.x).items():
        if effect.stage == "grip" and name == "t":
            begin = next(r.begin for r in last.problem.runs if r.name == last.model.happened_in)
            value += begin
        else:
            begin = 0.0
        low, high = _span(drawn, lambda x, n=name: effect.reported(x)[n][0])  # type: ignore[misc]
        out.append(EffectValue(name, unit, value, _number(low + begin), _number(high + begin), meaning))
    return tuple(v if np.isfinite(v.value) else _absent(v) for v in out)


def nominal_values(last: Round, drawn: list[dict[str, float]]) -> tuple[EffectValue, ...]:
    """The physical parameters of the nominal model, refitted together with the effects."""
    out = []
    for c in last.fitted.free:
        if c.parameter:
            low, high = _span(drawn, lambda x, n=c.name: exp(x[n]))  # type: ignore[misc]
            out.append(EffectValue(c.parameter, c.unit, exp(last.fitted.x[c.name]), low, high))
    return tuple(out)


def _span(drawn: list[dict[str, float]], of: Callable[[Mapping[str, float]], float]) -> tuple[float, float]:
    values: Array = np.array([of(x) for x in drawn])
    values = np.where(np.isfinite(values), values, 1e12)
    low, high = np.percentile(values, LEVEL)
    return float(low), float(high)


def _number(x: float) -> float | None:
    return float(x) if np.isfinite(x) and abs(x) < 1e9 else None


def _absent(v: EffectValue) -> EffectValue:
    """A limit or a cut-off that is not there: its lower bound alone says something."""
    return EffectValue(v.name, v.unit, 1e9, v.low, None, f"{v.meaning}; not there")
