"""The linear part of a diagnosed model for python-control, MATLAB and JSON; the rest as sentences."""

from __future__ import annotations

from typing import Any

import numpy as np

from rover_sweep.data.recording import LowPass
from rover_sweep.diagnosis.linear.linear import FirstOrderLowPass, hidden_filters, left_out, linear
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.report.export.augmented_model_json import augmented_document
from rover_sweep.report.export.system_document import NOTE, system_document
from rover_sweep.report.wording.strict_json import plain


def exported_augmented(model: AugmentedModel, verdict: str, speed: float | None = None) -> dict[str, Any]:
    """The linear part at a speed [m/s] (default: true speed of the runs), in the form of `exported_model`.

    verdict: of the diagnosis. "left_out": sentences on the nonlinear parts; "augmented": the whole model,
    from which `at_speed` computes another speed. sensor_filters: known and hidden low-passes in series.
    """
    structure, at = linear(model), speed or model.speed * (1.0 + model.value("vscale"))
    lost = left_out(model)
    remark = f"Not included: {'; '.join(lost)}." if lost else "The whole model is included."
    return plain(
        {
            "format": "rover-sweep model",
            "model": model.name,
            "verdict": verdict,
            "note": f"{NOTE} {remark}",
            "left_out": lost,
            "reference": structure.reference,
            **system_document(structure, structure.matrices(at), at),
            "parameters": structure.values,
            "parameter_units": {p.name: p.unit for p in structure.parameters},
            "sensor_filters": _filters(model, structure.outputs),
            "structure": None,
            "steering": {"trim_us": model.steering[0], "rad_per_us": model.steering[1]}
            if model.steering
            else None,
            "augmented": augmented_document(model),
        }
    )


def _filters(model: AugmentedModel, outputs: tuple[str, ...]) -> dict[str, Any]:
    """Each output's low-passes in series as one fraction, coefficients in falling powers of s."""
    hidden, out = hidden_filters(model), {}
    for output in outputs:
        found = [f[output] for f in (model.filters, hidden) if output in f]
        if found:
            num, den = np.ones(1), np.ones(1)
            for low_pass in found:
                n, d = _fraction(low_pass)
                num, den = np.polymul(num, n), np.polymul(den, d)
            out[output] = {
                "cutoff_hz": min(f.cutoff_hz for f in found),
                "num": num,
                "den": den,
                "source": ", ".join(f.source for f in found if f.source),
            }
    return out


def _fraction(low_pass: LowPass) -> tuple[Any, Any]:
    w0 = 2 * np.pi * low_pass.cutoff_hz
    if isinstance(low_pass, FirstOrderLowPass):
        return np.array([w0]), np.array([1.0, w0])
    return np.array([w0**2]), np.array([1.0, np.sqrt(2) * w0, w0**2])
