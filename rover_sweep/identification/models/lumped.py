"""Lumped model of stability derivatives (Taylor series), equation (19) of the paper.

Rows: V_y' (Y), phi'' (L), r' (N), phi'; columns: V_y, p, r, phi, delta(t - tau). The printed state vector
repeats phi''. V r is kept apart from Y_r: V_y' = ... + (Y_r - V) r + ...
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.identification.structure.state_space import Matrices, ModelStructure, Parameter

ROWS = {"Y": ("m/s^2", "side force per mass"), "L": ("rad/s^2", "rolling"), "N": ("rad/s^2", "yawing")}
COLUMNS = {
    "v": ("m/s", "lateral velocity"),
    "p": ("rad/s", "roll rate"),
    "r": ("rad/s", "yaw rate"),
    "phi": ("rad", "roll angle"),
    "delta": ("rad", "steering"),
}


def lumped(geometry: Geometry, start: ModelStructure, speed: float) -> ModelStructure:
    """States V_y [m/s], p, r [rad/s], phi [rad]; all fifteen derivatives and tau [s] free.

    start: a roll-yaw model whose linearisation at `speed` [m/s] gives the first values.
    """
    first = _derivatives(start, speed)
    parameters = tuple(
        Parameter(
            f"{row}_{column}",
            f"{row_unit} per {unit}",
            first[f"{row}_{column}"],
            True,
            *_bounds(first, row, column),
            meaning=f"{kind} by {what}",
        )
        for row, (row_unit, kind) in ROWS.items()
        for column, (unit, what) in COLUMNS.items()
    )
    return ModelStructure(
        name="lumped",
        states=("V_y", "p", "r", "phi"),
        outputs=("r", "ay", "vydot", "p"),
        parameters=(
            *parameters,
            Parameter("tau", "s", start.values["tau"], True, 0.0, 0.5, "equivalent time delay"),
            Parameter("imu_x", "m", geometry.imu_x, meaning="IMU ahead of the CG"),
            Parameter("imu_z", "m", geometry.imu_z, meaning="IMU above the point of V_y"),
            Parameter("g", "m/s^2", GRAVITY, meaning="gravity"),
        ),
        build=matrices,
        reference="equation (19), Nelson 1989",
    )


def _bounds(first: Mapping[str, float], row: str, column: str) -> tuple[float, float]:
    """+-10 times the larger of the first value and a tenth of the row's median.

    Without bounds the fit of this over-parameterised structure diverges.
    """
    middle = float(np.median([abs(first[f"{row}_{c}"]) for c in COLUMNS]))
    reach = 10 * max(abs(first[f"{row}_{column}"]), 0.1 * middle)
    return -reach, reach


def _derivatives(start: ModelStructure, speed: float) -> dict[str, float]:
    """Y, L, N derivatives of a roll-yaw model: rows of M^-1 F and M^-1 G, with V taken out of Y_r."""
    mat = start.matrices(speed)
    f, g = np.linalg.solve(mat.m, mat.f), np.linalg.solve(mat.m, mat.g)
    state = {"v": 0, "r": 1, "p": 2, "phi": 3}
    row = {"Y": 0, "N": 1, "L": 2}
    out = {f"{n}_{c}": float(f[i, j]) for n, i in row.items() for c, j in state.items()}
    out["Y_r"] += speed
    return out | {f"{n}_delta": float(g[i]) for n, i in row.items()}


def matrices(p: Mapping[str, Any]) -> Matrices:
    """M, F, G, H0, H1 at speed p["V"] [m/s]; outputs as in the roll-yaw model."""
    v, x, z = p["V"], p["imu_x"], p["imu_z"]
    return Matrices(
        m=np.eye(4),
        f=np.array(
            [
                [p["Y_v"], p["Y_p"], p["Y_r"] - v, p["Y_phi"]],
                [p["L_v"], p["L_p"], p["L_r"], p["L_phi"]],
                [p["N_v"], p["N_p"], p["N_r"], p["N_phi"]],
                [0, 1, 0, 0],
            ]
        ),
        g=np.array([p["Y_delta"], p["L_delta"], p["N_delta"], 0]),
        h0=np.array([[0, 0, 1, 0], [0, 0, v, p["g"]], [0, 0, 0, 0], [0, 1, 0, 0]]),
        h1=np.array([[0, 0, 0, 0], [1, -z, x, 0], [1, -z, x, 0], [0, 0, 0, 0]]),
    )
