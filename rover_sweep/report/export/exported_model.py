"""Identified models for python-control, MATLAB and JSON: continuous-time matrices, names and units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rover_sweep.data.recording import LowPass
from rover_sweep.identification.acceptance import known_filters
from rover_sweep.identification.models import bicycle, kinematic, lumped, roll_yaw
from rover_sweep.identification.pipeline import Identification
from rover_sweep.identification.structure.toml_form import structure_from_text
from rover_sweep.report.export.system_document import NOTE, matrices_of, system_document
from rover_sweep.report.wording.strict_json import plain

BUILDERS = {
    "kinematic": kinematic.matrices,
    "bicycle": bicycle.matrices,
    "roll-yaw": roll_yaw.matrices,
    "lumped": lumped.matrices,
}


def exported_model(
    result: Identification, name: str, steering: tuple[float, float] | None = None
) -> dict[str, Any]:
    """One model of a result as plain data. steering: (trim_us, rad_per_us) of the vehicle file.

    A, B, C, D and M, F, G, H0, H1 are nested lists (B, G and D have a column per input). tau_s: delay of
    the steering; input_delays_s, output_delays_s: delays of all inputs and outputs. structure: text of a
    user's own structure, needed by `at_speed`. sensor_filters: {output: {cutoff_hz, num, den}}, not included
    in the matrices.
    """
    model = result.models[name]
    structure = model.fit.structure
    return plain(
        {
            "format": "rover-sweep model",
            "model": name,
            "verdict": model.verdict.level,
            "note": NOTE,
            "reference": structure.reference,
            **system_document(structure, structure.matrices(model.fit.speed), model.fit.speed),
            "parameters": structure.values,
            "parameter_units": {p.name: p.unit for p in structure.parameters},
            "sensor_filters": _filters(known_filters(result), structure.outputs),
            "structure": structure.source or None,
            "steering": {"trim_us": steering[0], "rad_per_us": steering[1]} if steering else None,
        }
    )


def at_speed(exported: Mapping[str, Any], speed: float) -> dict[str, Any]:
    """An exported model of physical parameters at another speed [m/s].

    ValueError for the lumped model, whose derivatives are valid only at the speed of the identification.
    """
    if whole := exported.get("augmented"):
        from rover_sweep.report.export.augmented_model_json import augmented_from
        from rover_sweep.report.export.diagnosed import exported_augmented

        return exported_augmented(augmented_from(whole), exported["verdict"], speed)
    if exported["model"] == "lumped":
        raise ValueError("the lumped model is valid only at the speed of the identification")
    own = exported.get("structure")
    build = structure_from_text(own).build if own else BUILDERS[exported["model"]]
    mat = build({**exported["parameters"], "V": speed})
    return plain({**exported, **matrices_of(mat), "speed_m_s": speed})


def _filters(filters: Mapping[str, LowPass], outputs: tuple[str, ...]) -> dict[str, Any]:
    """Each known low-pass (Butterworth, unit gain at 0): num and den in falling powers of s."""
    known = {o: filters[o] for o in outputs if o in filters}
    out = {}
    for output, f in known.items():
        w0 = 2 * np.pi * f.cutoff_hz
        out[output] = {
            "cutoff_hz": f.cutoff_hz,
            "num": [w0**2],
            "den": [1.0, np.sqrt(2) * w0, w0**2],
            "source": f.source,
        }
    return out
