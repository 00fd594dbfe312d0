"""One model of identification.json: parameters, costs, verification, poles, variants, reduction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rover_sweep.data.intervals import Intervals
from rover_sweep.identification.acceptance import rejection
from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.model_results import TIED
from rover_sweep.identification.pipeline import Identification, ModelResult
from rover_sweep.identification.structure.state_space import OUTPUTS
from rover_sweep.identification.verify import Verification


def model_document(result: Identification, name: str) -> dict[str, Any]:
    """Parameters, cost, verification and all else of a model; see `identification_document`.

    If the kinematic model suffices, the value of every free parameter of a larger model is null, with
    "reason", and "rejected" has the optimiser's numbers.
    """
    model, reason = result.models[name], rejection(result, name)
    return {
        "verdict": {"level": model.verdict.level, "sentences": model.verdict.sentences},
        "reference": model.fit.structure.reference,
        "speed_m_s": model.fit.speed,
        "parameters": parameters_document(model.fit, reason) | _tied_stiffness(model, reason),
        "bootstrap": _bootstrap(model.fit),
        "cost": _cost(model.costs, model.fit.costs),
        "verification": _first(model),
        "verification_runs": [_verification(v) for v in model.verification],
        "poles": _poles(model.fit),
        "starts_spread_percent": 100 * model.fit.spread,
        "variants": {
            label: {"parameters": parameters_document(f, reason), "cost": _cost(f.costs, f.costs)}
            for label, f in model.variants.items()
        },
        "reduction": [
            {
                "parameter": s.parameter,
                "reason": s.reason,
                "average_before": s.before,
                "average_after": s.after,
                "dropped": s.dropped,
                "unstable_without": s.unstable,
                "found": s.found,
                "fixed_at": s.value if s.dropped else None,
            }
            for s in model.reduction
        ],
    }


def _tied_stiffness(model: ModelResult, reason: str | None) -> dict[str, Any]:
    """C of the fit with one C for both axles, where the fit has Cf and Cr: not a parameter of this fit.

    Its "variant" names that fit, which is in `variants`. Kept for programs that read C.
    """
    tied = model.variants.get(TIED)
    return {"C": {**parameters_document(tied, reason)["C"], "variant": TIED}} if tied else {}


def parameters_document(fit: FitResult, reason: str | None = None) -> dict[str, Any]:
    """{name: {value, unit, free, cr_percent, insensitivity_percent, interval_90, sd, ..., meaning}}.

    interval_90 [low, high], sd and bias by the bootstrap, in the parameter's unit; null without one.
    """
    return {e.name: _parameter(e, reason if e.free else None) for e in fit.estimates}


def _parameter(e: Estimate, reason: str | None) -> dict[str, Any]:
    numbers = {
        "value": e.value,
        "cr_percent": e.cr_percent,
        "insensitivity_percent": e.insensitivity_percent,
        **_interval(e.interval),
    }
    shown = dict.fromkeys(numbers) if reason else numbers
    out = {
        "value": shown["value"],
        "unit": e.unit,
        "free": e.free,
        "cr_percent": shown["cr_percent"],
        "insensitivity_percent": shown["insensitivity_percent"],
        "interval_90": shown["interval_90"],
        "sd": shown["sd"],
        "bias": shown["bias"],
        "at_bound": e.at_bound,
        "meaning": e.meaning,
    }
    return out | ({"reason": reason, "rejected": numbers} if reason else {})


def _interval(interval: Intervals | None) -> dict[str, Any]:
    if interval is None:
        return dict.fromkeys(("interval_90", "sd", "bias"))
    return {"interval_90": [interval.low, interval.high], "sd": interval.sd, "bias": interval.bias}


def _bootstrap(fit: FitResult) -> dict[str, Any] | None:
    """Level, number of converged replicates and number of failed ones; None without intervals."""
    found = next((e.interval for e in fit.estimates if e.interval), None)
    return {"level": found.level, "replicates": found.replicates, "failed": found.failed} if found else None


def _cost(costs: Mapping[str, float], fitted: Mapping[str, float]) -> dict[str, Any]:
    return {
        **{output: costs.get(output) for output in OUTPUTS},
        **{label: j for label, j in costs.items() if label not in OUTPUTS},
        "average": float(np.mean(list(fitted.values()))),
        "fitted": list(fitted),
        "average_all": float(np.mean(list(costs.values()))),
    }


def _first(model: ModelResult) -> dict[str, Any] | None:
    return _verification(model.verification[0]) if model.verification else None


def _verification(v: Verification) -> dict[str, Any]:
    return {
        "j_rms": v.j_rms,
        "tic": v.tic,
        "run": v.run,
        "speed_m_s": v.speed,
        "channels": {o.channel: {"unit": o.unit, "j_rms": o.j_rms, "tic": o.tic} for o in v.overlays},
        "state_biases": v.state_biases,
        "output_biases": v.output_biases,
    }


def _poles(fit: FitResult) -> list[dict[str, float]]:
    """Poles [rad/s] with natural frequency [rad/s] and damping ratio, slowest first."""
    poles = sorted(fit.structure.poles(fit.speed), key=lambda s: (abs(s), s.imag))
    return [
        {
            "re": float(s.real),
            "im": float(s.imag),
            "frequency_rad_s": float(abs(s)),
            "damping": float(-s.real / abs(s)) if s else 0.0,
        }
        for s in poles
    ]
