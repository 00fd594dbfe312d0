"""Dynamic bicycle model, equation (17) of the paper with its rows put right:

beta' = -(C0/(m V)) beta - (C1/(m V^2) + 1) r + (Cf/(m V)) delta(t - tau)
r' = -(C1/Izz) beta - (C2/(Izz V)) r + (a Cf/Izz) delta(t - tau)
C0 = Cf + Cr, C1 = a Cf - b Cr, C2 = a^2 Cf + b^2 Cr.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.identification.structure.state_space import Matrices, ModelStructure, Parameter


def bicycle(geometry: Geometry, tied: bool = True) -> ModelStructure:
    """States beta [rad], r [rad/s]; free C (Cf = Cr per axle, N/rad), Izz [kg m^2], tau [s].

    tied: one C for both axles, as in Table 2 of the paper; otherwise Cf and Cr are free.
    """
    stiffness = 3.0 * geometry.mass * GRAVITY / 2
    inertia = geometry.yaw_inertia or geometry.mass * geometry.a * geometry.b
    return ModelStructure(
        name="bicycle",
        states=("beta", "r"),
        outputs=("r", "ay", "vydot"),
        parameters=(
            *stiffness_parameters(stiffness, tied),
            Parameter("Izz", "kg m^2", inertia, True, inertia / 50, inertia * 50, "yaw inertia about the CG"),
            Parameter("tau", "s", 0.03, True, 0.0, 0.5, "equivalent time delay of the steering"),
            *known_parameters(geometry),
        ),
        build=matrices,
        reference="equation (17), Kong et al. 2015",
    )


def stiffness_parameters(start: float, tied: bool) -> tuple[Parameter, ...]:
    """C for both axles, or Cf and Cr, N/rad per axle (both tyres)."""
    names = (
        (("C", "cornering stiffness, each axle"),)
        if tied
        else (("Cf", "cornering stiffness, front axle"), ("Cr", "cornering stiffness, rear axle"))
    )
    return tuple(Parameter(n, "N/rad", start, True, start / 300, start * 300, m) for n, m in names)


def known_parameters(geometry: Geometry) -> tuple[Parameter, ...]:
    """Mass, axle distances and the IMU's position, fixed."""
    return (
        Parameter("m", "kg", geometry.mass, meaning="mass"),
        Parameter("a", "m", geometry.a, meaning="front axle to CG"),
        Parameter("b", "m", geometry.b, meaning="rear axle to CG"),
        Parameter("imu_x", "m", geometry.imu_x, meaning="IMU ahead of the CG"),
    )


def axle_stiffness(p: Mapping[str, Any]) -> tuple[Any, Any]:
    """Cf, Cr [N/rad per axle] of a tied or untied parameter set."""
    return (p["C"], p["C"]) if "C" in p else (p["Cf"], p["Cr"])


def matrices(p: Mapping[str, Any]) -> Matrices:
    """M, F, G, H0, H1 at speed p["V"] [m/s].

    Outputs r, ay = V (beta' + r) + x r', vydot = V beta' + x r', with the IMU at x ahead of the CG.
    """
    cf, cr = axle_stiffness(p)
    m, v, izz, a, b, x = p["m"], p["V"], p["Izz"], p["a"], p["b"], p["imu_x"]
    c0, c1, c2 = cf + cr, a * cf - b * cr, a * a * cf + b * b * cr
    return Matrices(
        m=np.eye(2),
        f=np.array([[-c0 / (m * v), -c1 / (m * v * v) - 1], [-c1 / izz, -c2 / (izz * v)]]),
        g=np.array([cf / (m * v), a * cf / izz]),
        h0=np.array([[0, 1], [0, v], [0, 0]]),
        h1=np.array([[0, 0], [v, x], [v, x]]),
    )
