"""The rover's numbers from the posterior of a fitted model: medians and 90 % intervals of its draws.

What a fit of the responses alone must assume is drawn with them here: errors of the vehicle file, lag and
delay of the steering, bend of the tyres, place of the CG. So a stiffness does not carry those errors, and
K_us comes from the draws of both axles together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import degrees, exp

import numpy as np

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.posterior.model_fit import ModelFit, model_fit
from rover_sweep.diagnosis.posterior.parameter_intervals import LEVEL, draw_coordinates
from rover_sweep.diagnosis.problem.least_squares import fit, sensitivities
from rover_sweep.diagnosis.problem.noise_floor import has_floor
from rover_sweep.diagnosis.result import EffectValue
from rover_sweep.diagnosis.settings import Baseline
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment, in_order

WIDE = 3.0  # standard deviations from which a bound takes over where the ratio of both axles is a Gaussian
OF_TYRES = {
    "Cf": ("N/rad", "cornering stiffness of the front axle"),
    "Cr": ("N/rad", "cornering stiffness of the rear axle"),
    "K_us": ("deg/g", "understeer gradient"),
}
TOLD = {
    "Izz": ("kg m^2", "yaw inertia about the CG"),
    "k_phi": ("N m/rad", "roll stiffness"),
    "b_phi": ("N m s/rad", "roll damping"),
    "tau": ("s", "lag and delay of the steering"),
}


def fitted_baseline(
    runs: Sequence[Recording], rover: Geometry, baseline: Baseline, spread: Tolerances
) -> ModelFit | None:
    """The baseline fitted to sweeps, without effects; None where they are too short for a noise floor."""
    used = in_order([experiment(run) for run in runs])
    if not has_floor(used):
        return None
    model = Model(baseline, rover, spread, two_clocks=any(run.two_clocks for run in used))
    return model_fit(used, model, {})


def rover_numbers(last: ModelFit, seed: int) -> tuple[EffectValue, ...]:
    """The physical parameters of a fitted model, with 90 % intervals.

    Of a model with tyres: Cf, Cr, K_us, I_zz, of roll k_phi and b_phi, and tau. Of others its own parameters.
    """
    rover = last.model.rover
    drawn = draw_coordinates(_with_free_axles(last), seed)
    values = [_numbers(x, rover) for x in drawn] if not last.model.lumped else []
    if not values or "Cf" not in values[0]:
        own = [c for c in last.fitted.free if c.parameter]
        return tuple(_value(c.parameter, c.unit, "", [exp(x[c.name]) for x in drawn]) for c in own)
    told = {name: words for name, words in (OF_TYRES | TOLD).items() if name in values[0]}
    return tuple(_value(name, *told[name], [v[name] for v in values]) for name in told)


def _with_free_axles(last: ModelFit) -> ModelFit:
    """The fit with a Gaussian for ln(Cf/Cr), whose bounds are for a search: they cut the numbers off."""
    ratio, spread = "ln_ratio", last.model.spread.ratio
    free = tuple(
        replace(c, low=-WIDE * spread, high=WIDE * spread, prior=spread)
        if c.name == ratio and c.high == spread
        else c
        for c in last.fitted.free
    )
    if free == last.fitted.free:
        return last
    fitted = fit(last.problem, last.fitted.structure, free, last.fitted.x)
    return replace(last, fitted=sensitivities(last.problem, fitted))


def _numbers(x: Mapping[str, float], rover: Geometry) -> dict[str, float]:
    """{name: value} at drawn coordinates."""
    out = {name: exp(x[f"ln_{name}"]) for name in ("Izz", "k_phi", "b_phi") if f"ln_{name}" in x}
    if "ln_C" not in x:
        return out
    half, moved = 0.5 * x.get("ln_ratio", 0.0), x.get("da", 0.0)
    front, rear = exp(x["ln_C"] + half), exp(x["ln_C"] - half)
    gradient = rover.mass / rover.wheelbase * ((rover.b - moved) / front - (rover.a + moved) / rear)
    return out | {
        "Cf": front,
        "Cr": rear,
        "K_us": degrees(gradient * GRAVITY),
        "tau": x.get("lag", 0.0) + x.get("delay", 0.0),
    }


def _value(name: str, unit: str, meaning: str, values: Sequence[float]) -> EffectValue:
    low, middle, high = np.percentile(values, (LEVEL[0], 50.0, LEVEL[1]))
    return EffectValue(name, unit, float(middle), float(low), float(high), meaning)
