"""Roll-yaw model, equation (18) of the paper with its misprints put right, reduced to four states.

m V_y' - h ms p' = -(C0/V) V_y - (C1/V + m V) r + Cf delta(t - tau)
Izz r' + Ixz p' = -(C1/V) V_y - (C2/V) r + a Cf delta(t - tau)
(Ixx + ms h^2) p' - h ms V_y' + Ixz r' = h ms V r - b_phi p - (k_phi - ms g h) phi
phi' = p, with C0 = Cf + Cr, C1 = a Cf - b Cr, C2 = a^2 Cf + b^2 Cr.

The printed form has two more states, the integrals of the slip angles, which only add two poles at 0.
Here the slip angles are eliminated: alpha_f = (V_y + a r)/V - delta, alpha_r = (V_y - b r)/V.
ISO axes: a roll outwards in a left turn is positive.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.identification.models.bicycle import axle_stiffness, known_parameters, stiffness_parameters
from rover_sweep.identification.structure.state_space import Matrices, ModelStructure, Parameter


def roll_yaw(geometry: Geometry, tied: bool = True) -> ModelStructure:
    """States V_y [m/s] at the height of the roll axis, r, p [rad/s], phi [rad].

    Free: C (Cf = Cr per axle, N/rad; Cf and Cr if not tied), Izz [kg m^2], k_phi [N m/rad], b_phi
    [N m s/rad], tau [s]. ValueError when the geometry lacks sprung_mass, h or roll_inertia.
    """
    ms, h, ixx = geometry.sprung_mass, geometry.h, geometry.roll_inertia
    if ms is None or h is None or ixx is None:
        raise ValueError("the roll-yaw model needs sprung_mass, h and roll_inertia")
    stiffness = 3.0 * geometry.mass * GRAVITY / 2
    inertia = geometry.yaw_inertia or geometry.mass * geometry.a * geometry.b
    about_axis = ixx + ms * h * h
    spring = about_axis * (2 * np.pi * 3.5) ** 2 + ms * GRAVITY * h
    damper = 2 * 0.2 * about_axis * 2 * np.pi * 3.5
    return ModelStructure(
        name="roll-yaw",
        states=("V_y", "r", "p", "phi"),
        outputs=("r", "ay", "vydot", "p"),
        parameters=(
            *stiffness_parameters(stiffness, tied),
            Parameter("Izz", "kg m^2", inertia, True, inertia / 50, inertia * 50, "yaw inertia about the CG"),
            Parameter("k_phi", "N m/rad", spring, True, ms * GRAVITY * h, spring * 100, "roll stiffness"),
            Parameter("b_phi", "N m s/rad", damper, True, damper / 100, damper * 100, "roll damping"),
            Parameter("tau", "s", 0.03, True, 0.0, 0.5, "equivalent time delay of the steering"),
            Parameter("Ixx", "kg m^2", ixx, False, ixx / 20, ixx * 20, "roll inertia about the sprung CG"),
            Parameter(
                "Ixz",
                "kg m^2",
                geometry.roll_yaw_inertia,
                False,
                -inertia / 2,
                inertia / 2,
                "product of inertia",
            ),
            Parameter("h", "m", h, False, h / 10, h * 10, "sprung CG above the roll axis"),
            Parameter("ms", "kg", ms, meaning="sprung mass"),
            *known_parameters(geometry),
            Parameter("imu_z", "m", geometry.imu_z, meaning="IMU above the roll axis"),
            Parameter("g", "m/s^2", GRAVITY, meaning="gravity"),
        ),
        build=matrices,
        reference="equation (18), Laws et al. 2006",
    )


def matrices(p: Mapping[str, Any]) -> Matrices:
    """M, F, G, H0, H1 at speed p["V"] [m/s].

    Outputs r, ay = V_y' + V r + x r' - z p' + g phi, vydot = V_y' + x r' - z p', p, with the IMU at
    x ahead of the CG and z above the roll axis.
    """
    cf, cr = axle_stiffness(p)
    m, ms, h, v = p["m"], p["ms"], p["h"], p["V"]
    a, b, x, z = p["a"], p["b"], p["imu_x"], p["imu_z"]
    c0, c1, c2 = cf + cr, a * cf - b * cr, a * a * cf + b * b * cr
    ixz = p["Ixz"]
    return Matrices(
        m=np.array(
            [
                [m, 0, -h * ms, 0],
                [0, p["Izz"], ixz, 0],
                [-h * ms, ixz, p["Ixx"] + ms * h * h, 0],
                [0, 0, 0, 1],
            ]
        ),
        f=np.array(
            [
                [-c0 / v, -c1 / v - m * v, 0, 0],
                [-c1 / v, -c2 / v, 0, 0],
                [0, h * ms * v, -p["b_phi"], -p["k_phi"] + ms * p["g"] * h],
                [0, 0, 1, 0],
            ]
        ),
        g=np.array([cf, a * cf, 0, 0]),
        h0=np.array([[0, 1, 0, 0], [0, v, 0, p["g"]], [0, 0, 0, 0], [0, 0, 1, 0]]),
        h1=np.array([[0, 0, 0, 0], [1, x, -z, 0], [1, x, -z, 0], [0, 0, 0, 0]]),
    )
