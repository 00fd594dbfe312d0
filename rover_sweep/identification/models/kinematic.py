"""Kinematic model, without tyre slip: r(t) = V delta(t - tau) / L_eff, ay = V r.

Sufficient at parking speeds (Petrov and Nashashibi 2014), and the model of ArduPilot's own SITL rover.
L_eff is free, so that a wrong steering scale shows as L_eff != a + b instead of a poor fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.identification.structure.state_space import Matrices, ModelStructure, Parameter


def kinematic(geometry: Geometry) -> ModelStructure:
    """Outputs r, ay; free L_eff [m], the effective wheelbase, and tau [s].

    A static relation in state-space form: one state with a pole at -1e4 rad/s.
    """
    base = geometry.wheelbase
    return ModelStructure(
        name="kinematic",
        states=("r",),
        outputs=("r", "ay"),
        parameters=(
            Parameter("L_eff", "m", base, True, base / 20, base * 20, "effective wheelbase"),
            Parameter("tau", "s", 0.03, True, 0.0, 0.5, "equivalent time delay of the steering"),
        ),
        build=matrices,
        reference="Petrov and Nashashibi 2014",
    )


def matrices(p: Mapping[str, Any]) -> Matrices:
    """M, F, G, H0, H1 at speed p["V"] [m/s]."""
    fast, v = 1e4, p["V"]
    return Matrices(
        m=np.eye(1),
        f=np.array([[-fast]]),
        g=np.array([fast * v / p["L_eff"]]),
        h0=np.array([[1.0], [v]]),
        h1=np.zeros((2, 1)),
    )
