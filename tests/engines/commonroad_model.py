"""CommonRoad's multi-body model (29 states), compiled, and its parameters for a drawn rover.

Althoff and Wuersching, CommonRoad: Vehicle Models, 2020: sprung mass with roll, pitch and heave on two axles
that roll, heave and move sideways against it; Magic Formula tyres. Its axes are SAE's, x forward, y right, z
down, though the comments do not say so: a positive steering angle turns right, and the body leans outward.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import vehiclemodels.utils.acceleration_constraints as acceleration
import vehiclemodels.utils.steering_constraints as steering
import vehiclemodels.utils.tire_model as tyres
import vehiclemodels.utils.vehicle_dynamics_ks_cog as kinematic
import vehiclemodels.vehicle_dynamics_mb as multibody
from numba import njit

from tests.engines.rover import EngineRover
from tests.foreign.chassis import GRAVITY

AXLE_W, AXLE_ZETA = 80.0, 1.2  # rad/s: an axle's sideways compliance against the body
TYRE_W = 150.0  # rad/s: an axle on its tyres
ROTOR = 0.03  # of the rover's mass: motor and gear at the rolling radius of each wheel
MU = 2.0


class Tyre(NamedTuple):
    """Coefficients of the package's tire_model; shapes of its own data sheet, without offsets."""

    p_dx1: float
    p_kx1: float
    p_dy1: float
    p_ky1: float
    p_vy1: float = 0.0
    p_cx1: float = 1.6411
    p_dx3: float = 0.0
    p_ex1: float = 0.46403
    p_hx1: float = 0.0
    p_vx1: float = 0.0
    r_bx1: float = 13.276
    r_bx2: float = -13.778
    r_cx1: float = 1.2568
    r_ex1: float = 0.65225
    r_hx1: float = 0.0
    p_cy1: float = 1.3507
    p_dy3: float = -2.8821
    p_ey1: float = -0.0074722
    p_hy1: float = 0.0
    p_hy3: float = 0.0
    p_vy3: float = 0.0
    r_by1: float = 7.1433
    r_by2: float = 9.1916
    r_by3: float = 0.0
    r_cy1: float = 1.0719
    r_ey1: float = -0.27572
    r_hy1: float = 0.0
    r_vy1: float = 0.0
    r_vy3: float = 0.0
    r_vy4: float = 12.12
    r_vy5: float = 1.9
    r_vy6: float = -10.704


class Limits(NamedTuple):
    """Of steering and drive: none of them is reached."""

    min: float = -1.5
    max: float = 1.5
    v_min: float = -50.0
    v_max: float = 50.0
    v_switch: float = 50.0
    a_max: float = 50.0


class Parameters(NamedTuple):
    """The package's names; SI units."""

    m: float
    m_s: float
    m_uf: float
    m_ur: float
    a: float
    b: float
    I_Phi_s: float
    I_y_s: float
    I_z: float
    K_sf: float
    K_sdf: float
    K_sr: float
    K_sdr: float
    T_f: float
    T_r: float
    K_ras: float
    K_rad: float
    K_zt: float
    h_raf: float
    h_rar: float
    h_s: float
    I_uf: float
    I_ur: float
    I_y_w: float
    R_w: float
    tire: Tyre
    steering: Limits = Limits()
    longitudinal: Limits = Limits()
    I_xz_s: float = 0.0
    K_tsf: float = 0.0
    K_tsr: float = 0.0
    K_lt: float = 0.0
    T_sb: float = 0.0
    T_se: float = 0.0
    D_f: float = 0.0
    D_r: float = 0.0
    E_f: float = 0.0
    E_r: float = 0.0


def parameters(rover: EngineRover) -> Parameters:
    """The rover as the model has it; both axles have the stiffness of their mean over the load."""
    n, radius = rover.numbers, rover.instruments.wheel_radius
    axle = (n.m - n.ms) / 2
    grip = (n.Cf + n.Cr) / (n.m * GRAVITY)
    mu = min(n.mu, MU)
    soft = rover.own.get("soft_axle", 1.0)
    sideways, along = AXLE_W / soft, max(AXLE_ZETA / soft, 0.25)
    return Parameters(
        m=n.m, m_s=n.ms, m_uf=axle, m_ur=axle, a=n.a, b=n.b,
        I_Phi_s=n.Ixx, I_y_s=n.ms * (0.28 * (n.a + n.b)) ** 2, I_z=n.Izz,
        K_sf=n.kphi / n.track**2, K_sdf=n.bphi / n.track**2,
        K_sr=n.kphi / n.track**2, K_sdr=n.bphi / n.track**2,
        T_f=n.track, T_r=n.track,
        K_ras=axle * sideways**2, K_rad=2 * along * sideways * axle, K_zt=axle * TYRE_W**2 / 2,
        h_raf=n.roll_axis, h_rar=n.roll_axis, h_s=n.roll_axis + n.h,
        I_uf=axle * (0.45 * n.track) ** 2, I_ur=axle * (0.45 * n.track) ** 2,
        I_y_w=ROTOR * n.m * radius**2, R_w=radius,
        tire=Tyre(p_dx1=mu, p_kx1=1.5 * grip, p_dy1=mu, p_ky1=-grip, p_vy1=rover.own.get("plysteer", 0.0)),
    )  # fmt: skip


def _compiled() -> Callable[..., Any]:
    """The package's functions, unchanged, compiled by numba with one another in their global names."""
    rates = {"steering_constraints": njit(steering.steering_constraints)}
    rates["acceleration_constraints"] = njit(acceleration.acceleration_constraints)
    sign = njit(tyres.sign)
    tyre = ModuleType("tyre")
    for name in ("longitudinal", "lateral", "longitudinal_comb", "lateral_comb"):
        setattr(
            tyre,
            f"formula_{name}",
            njit(_with(getattr(tyres, f"formula_{name}"), sign=sign), error_model="numpy"),
        )
    slow = njit(_with(kinematic.vehicle_dynamics_ks_cog, **rates))
    whole = _with(multibody.vehicle_dynamics_mb, vehicle_dynamics_ks_cog=slow, tireModel=tyre, **rates)
    return njit(whole, error_model="numpy")  # a rover out of control gives nan


def _with(function: FunctionType, **names: Any) -> FunctionType:
    return FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__)


RATES = _compiled()
