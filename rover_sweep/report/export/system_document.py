"""Continuous-time matrices of a linear system with names, units and delays, as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from rover_sweep.identification.structure.state_space import Matrices, ModelStructure

UNITS = {
    "delta": "rad",
    "throttle": "us",
    "beta": "rad",
    "r": "rad/s",
    "V_y": "m/s",
    "p": "rad/s",
    "phi": "rad",
    "ay": "m/s^2",
    "vydot": "m/s^2",
}
NOTE = (
    "M x' = F x + G delta(t - tau), y = H0 x + H1 x'; equivalent to x' = A x + B delta(t - tau), y = C x + D "
    "delta(t - tau). delta [rad] is the road-wheel angle, left positive; ISO axes (x forward, y left, z up). "
    "The outputs are the rover's motion at the IMU; the recorded signals also passed the sensor_filters."
)


def system_document(structure: ModelStructure, mat: Matrices, speed: float) -> dict[str, Any]:
    """Matrices, delays, names and units at a speed [m/s]."""
    return {
        "speed_m_s": speed,
        "tau_s": _delay(structure, structure.input_delays.get(structure.inputs[0])),
        "input_delays_s": [_delay(structure, structure.input_delays.get(i)) for i in structure.inputs],
        "output_delays_s": [_delay(structure, structure.output_delays.get(o)) for o in structure.outputs],
        "inputs": structure.inputs,
        "input_units": [_unit(structure, i) for i in structure.inputs],
        "states": structure.states,
        "state_units": [_unit(structure, s) for s in structure.states],
        "outputs": structure.outputs,
        "output_units": [_unit(structure, o) for o in structure.outputs],
        **matrices_of(mat),
    }


def _delay(structure: ModelStructure, name: str | None) -> float:
    return structure.values[name] if name else 0.0


def _unit(structure: ModelStructure, name: str) -> str:
    """The unit given in the user's structure, else the usual one, else ""."""
    return structure.units.get(name) or UNITS.get(name, "")


def matrices_of(mat: Matrices) -> dict[str, Any]:
    """A, B, C, D and the matrices M, F, G, H0, H1 that they are computed from."""
    a = np.linalg.solve(mat.m, mat.f)
    b = np.linalg.solve(mat.m, mat.input_matrix.astype(float))
    return {
        "A": a,
        "B": b,
        "C": mat.h0 + mat.h1 @ a,
        "D": mat.h1 @ b,
        "M": mat.m.astype(float),
        "F": mat.f.astype(float),
        "G": mat.input_matrix.astype(float),
        "H0": mat.h0.astype(float),
        "H1": mat.h1.astype(float),
    }
