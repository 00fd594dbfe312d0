"""Dynamic bicycle model, equation (17) of the paper with its rows corrected:

beta' = -(C0/(m V)) beta - (C1/(m V^2) + 1) r + (Cf/(m V)) delta(t - tau)
r' = -(C1/Izz) beta - (C2/(Izz V)) r + (a Cf/Izz) delta(t - tau)
C0 = Cf + Cr, C1 = a Cf - b Cr, C2 = a^2 Cf + b^2 Cr.

In reverse the speed is negative: a tyre's force is -C ((V_y + x r)/|V| - s delta) with s the sign of V (delta
0 at the rear), while m V r keeps V. Rows: C0, C1 s, C2 over |V|, and s Cf delta.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.identification.fit import Condition, FitResult, fit
from rover_sweep.identification.state_space import Matrices, ModelStructure, Parameter


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
        build=bicycle_matrices,
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


def bicycle_matrices(p: Mapping[str, Any]) -> Matrices:
    """M, F, G, H0, H1 at speed p["V"] [m/s], negative in reverse.

    Outputs r, ay = V (beta' + r) + x r', vydot = V beta' + x r', with the IMU at x ahead of the CG.
    """
    cf, cr = axle_stiffness(p)
    m, v, izz, a, b, x = p["m"], p["V"], p["Izz"], p["a"], p["b"], p["imu_x"]
    c0, c1, c2 = cf + cr, a * cf - b * cr, a * a * cf + b * b * cr
    rolling, s = abs(v), np.sign(v)
    return Matrices(
        m=np.eye(2),
        f=np.array(
            [[-c0 / (m * rolling), -c1 / (m * v * rolling) - 1], [-s * c1 / izz, -c2 / (izz * rolling)]]
        ),
        g=np.array([cf / (m * rolling), s * a * cf / izz]),
        h0=np.array([[0, 1], [0, v], [0, 0]]),
        h1=np.array([[0, 0], [v, x], [v, x]]),
    )


# Kinematic model, without tyre slip: r(t) = V delta(t - tau) / L_eff, ay = V r.
#
# Sufficient at parking speeds (Petrov and Nashashibi 2014), and the model of ArduPilot's own SITL rover.
# L_eff is free, so that a wrong steering scale shows as L_eff != a + b instead of a poor fit.


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
        build=kinematic_matrices,
        reference="Petrov and Nashashibi 2014",
    )


def kinematic_matrices(p: Mapping[str, Any]) -> Matrices:
    """M, F, G, H0, H1 at speed p["V"] [m/s]."""
    fast, v = 1e4, p["V"]
    return Matrices(
        m=np.eye(1),
        f=np.array([[-fast]]),
        g=np.array([fast * v / p["L_eff"]]),
        h0=np.array([[1.0], [v]]),
        h1=np.zeros((2, 1)),
    )


# Lumped model of stability derivatives (Taylor series), equation (19) of the paper.
#
# Rows: V_y' (Y), phi'' (L), r' (N), phi'; columns: V_y, p, r, phi, delta(t - tau). The printed state vector
# repeats phi''. V r is kept apart from Y_r: V_y' = ... + (Y_r - V) r + ...


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
        build=lumped_matrices,
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


def lumped_matrices(p: Mapping[str, Any]) -> Matrices:
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


# A model with a first-order lag between steering command and road wheels, in addition to its delay.


STARTS = ({"T_s": 0.06},)
LAG = Parameter("T_s", "s", 0.02, True, 5e-4, 0.3, "first-order lag of the steering")


def with_steering_lag(structure: ModelStructure) -> ModelStructure:
    """The structure driven by delta, with T_s delta' = u - delta as one more state; T_s [s] is free.

    For structures with one input. A servo loses gain at high frequencies, a pure delay does not: without the
    lag a fit lowers the front stiffness instead, which changes the understeer gradient.
    """
    build = structure.build

    def lagged(p: Mapping[str, Any]) -> Matrices:
        inner = build(p)
        n, outputs = inner.f.shape[0], inner.h0.shape[0]
        row, none = np.zeros((1, n)), np.zeros((outputs, 1))
        steering = inner.input_matrix
        return Matrices(
            m=np.block([[inner.m, row.T], [row, np.array([[p[LAG.name]]])]]),
            f=np.block([[inner.f, steering], [row, -np.ones((1, 1))]]),
            g=np.concatenate((np.zeros(n), np.ones(1))),
            h0=np.hstack([inner.h0, none]),
            h1=np.hstack([inner.h1, none]),
        )

    return replace(
        structure, states=(*structure.states, "delta"), parameters=(*structure.parameters, LAG), build=lagged
    )


def lagged_fit(found: FitResult, conditions: Sequence[Condition]) -> FitResult:
    """Refits the model of a fit with an added steering lag T_s [s]. conditions: data of the fit."""
    return fit(with_steering_lag(found.structure), conditions, STARTS)


def refitted_with_lag(found: FitResult, conditions: Sequence[Condition]) -> FitResult:
    """A fit's model with the parameters and covariance of a refit with a steering lag.

    conditions: data of the fit. The lag itself is left out of the result, whose costs and estimates are those
    of `found`.
    """
    lagged = lagged_fit(found, conditions)
    names = [p.name for p in lagged.structure.free]
    kept = [names.index(p.name) for p in found.structure.free]
    assert lagged.covariance is not None
    values = {p.name: p.value for p in lagged.structure.free if p.name != LAG.name}
    return replace(
        found, structure=found.structure.with_values(values), covariance=lagged.covariance[np.ix_(kept, kept)]
    )


# Roll-yaw model, equation (18) of the paper with its misprints put right, reduced to four states.
#
# m V_y' - h ms p' = -(C0/V) V_y - (C1/V + m V) r + Cf delta(t - tau)
# Izz r' + Ixz p' = -(C1/V) V_y - (C2/V) r + a Cf delta(t - tau)
# (Ixx + ms h^2) p' - h ms V_y' + Ixz r' = h ms V r - b_phi p - (k_phi - ms g h) phi
# phi' = p, with C0 = Cf + Cr, C1 = a Cf - b Cr, C2 = a^2 Cf + b^2 Cr.
#
# The printed form has two more states, the integrals of the slip angles, which only add two poles at 0.
# Here the slip angles are eliminated: alpha_f = (V_y + a r)/V - delta, alpha_r = (V_y - b r)/V.
# ISO axes: a roll outwards in a left turn is positive.


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
        build=roll_yaw_matrices,
        reference="equation (18), Laws et al. 2006",
    )


def roll_yaw_matrices(p: Mapping[str, Any]) -> Matrices:
    """M, F, G, H0, H1 at speed p["V"] [m/s], negative in reverse.

    Outputs r, ay = V_y' + V r + x r' - z p' + g phi, vydot = V_y' + x r' - z p', p, with the IMU at
    x ahead of the CG and z above the roll axis.
    """
    cf, cr = axle_stiffness(p)
    m, ms, h, v = p["m"], p["ms"], p["h"], p["V"]
    a, b, x, z = p["a"], p["b"], p["imu_x"], p["imu_z"]
    c0, c1, c2 = cf + cr, a * cf - b * cr, a * a * cf + b * b * cr
    ixz, rolling, s = p["Ixz"], abs(v), np.sign(v)
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
                [-c0 / rolling, -c1 / rolling - m * v, 0, 0],
                [-c1 / rolling, -c2 / rolling, 0, 0],
                [0, h * ms * v, -p["b_phi"], -p["k_phi"] + ms * p["g"] * h],
                [0, 0, 1, 0],
            ]
        ),
        g=np.array([s * cf, s * a * cf, 0, 0]),
        h0=np.array([[0, 1, 0, 0], [0, v, 0, p["g"]], [0, 0, 0, 0], [0, 0, 1, 0]]),
        h1=np.array([[0, 0, 0, 0], [1, x, -z, 0], [1, x, -z, 0], [0, 0, 0, 0]]),
    )
