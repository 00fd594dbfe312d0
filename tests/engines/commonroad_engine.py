"""CommonRoad's multi-body model as an engine: Heun's method at 2 kHz, road and wind as forces beside it.

The model divides by the speed, so a run is simulated from a walking pace on; before and after it the rover
starts and stops evenly in a straight line.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import vehiclemodels.utils.acceleration_constraints as acceleration
import vehiclemodels.utils.steering_constraints as steering
import vehiclemodels.utils.tire_model as tyres
import vehiclemodels.utils.vehicle_dynamics_ks_cog as kinematic
import vehiclemodels.vehicle_dynamics_mb as multibody
from numba import njit

from tests.engines.engine import (
    Array,
    Engine,
    EngineRover,
    Signals,
    at_speed,
    load_roll,
    load_step,
    lost_share,
)
from tests.engines.shared_laws import EVERYWHERE, PATH, SENSING, outside_laws, own_numbers, vehicle_laws
from tests.foreign.grade import PLACES as FOREIGN_PLACES
from tests.foreign.laws import Law
from tests.foreign.plant import (
    DT,
    GRAVITY,
    ROAD_ROLL,
    ROAD_Y,
    ROAD_YAW,
    STEERING_STATES,
    WIND_X,
    WIND_Y,
    Numbers,
    bump_moment,
    steering_step,
)
from tests.foreign.recorded import mounted
from tests.foreign.rover import SIZES

AXLE_W, AXLE_ZETA = 80.0, 1.2  # rad/s: an axle's sideways compliance against the body
TYRE_W = 150.0  # rad/s: an axle on its tyres
ROTOR = 0.03  # of the rover's mass: motor and gear at the rolling radius of each wheel
MU = 2.0


# coefficients of the package's tire_model; shapes of its own data sheet, offsets of none
SHAPES = {
    "p_cx1": 1.6411, "p_ex1": 0.46403, "r_bx1": 13.276, "r_bx2": -13.778, "r_cx1": 1.2568, "r_ex1": 0.65225,
    "p_cy1": 1.3507, "p_dy3": -2.8821, "p_ey1": -0.0074722, "r_by1": 7.1433, "r_by2": 9.1916,
    "r_cy1": 1.0719, "r_ey1": -0.27572, "r_vy4": 12.12, "r_vy5": 1.9, "r_vy6": -10.704,
}  # fmt: skip
SHAPES |= dict.fromkeys(
    ["p_dx3", "p_hx1", "p_vx1", "r_hx1", "p_hy1", "p_hy3", "p_vy3", "r_by3", "r_hy1", "r_vy1", "r_vy3"], 0.0
)
Tyre = namedtuple("Tyre", ["p_dx1", "p_kx1", "p_dy1", "p_ky1", "p_vy1", *SHAPES], defaults=SHAPES.values())
# of steering and drive: none of them is reached
LIMITS = namedtuple("Limits", "min max v_min v_max v_switch a_max")(-1.5, 1.5, -50.0, 50.0, 50.0, 50.0)
NONE = dict.fromkeys(["I_xz_s", "K_tsf", "K_tsr", "K_lt", "T_sb", "T_se", "D_f", "D_r", "E_f", "E_r"], 0.0)
# the package's names; SI units
Parameters = namedtuple(
    "Parameters",
    "m m_s m_uf m_ur a b I_Phi_s I_y_s I_z K_sf K_sdf K_sr K_sdr T_f T_r K_ras K_rad K_zt h_raf h_rar h_s "
    "I_uf I_ur I_y_w R_w tire steering longitudinal " + " ".join(NONE),
)


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
        steering=LIMITS, longitudinal=LIMITS, **NONE,
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


# ---- Effects that CommonRoad's multi-body model makes itself, and those of forces beside it.


LISTED: tuple[Law, ...] = (
    *PATH,
    *SENSING,
    *vehicle_laws(
        ("suspension_friction", "tanh"),
        ("tyre_saturation", "Magic Formula"),
        ("yaw_damping", "moment"),
        ("side_wind", ""),
    ),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws((*EVERYWHERE, "outside:wheel_lift")),
    Law("outside:soft_axle", "sideways bushings", "axles", 1.5, 12.0, own_numbers(soft_axle="size"), "-"),
    Law(
        "outside:plysteer",
        "side force by the sign of roll",
        "tyre",
        0.01,
        0.3,
        own_numbers(plysteer="size"),
        "-",
    ),
)
PLACES: dict[str, tuple[str, ...]] = {
    **FOREIGN_PLACES,
    "outside:soft_axle": ("side force", "roll moment"),
    "outside:plysteer": ("side force", "roll moment"),
}


# ---- The loop of a run.

STATES = 29
SUBSTEPS = 2
PACE = 0.6  # m/s
START = 2.5  # m/s^2
STOP = 0.15  # s
# columns of a run, ISO axes
U, V, R, PHI, P, PSI, U_DOT, V_DOT, R_DOT, P_DOT, UP_DOT = range(11)


@njit(error_model="numpy")
def _rates(x: Array, drive: float, push: Array, p: Parameters, n: Numbers) -> Array:
    """Rates of the states (SAE axes). push: force to the left at the ground [N], yaw moment to the left and
    roll moment [N m]."""
    f = np.array(RATES(x, (0.0, drive), p))
    left = push[0] / (p.a + p.b)
    f[15] -= left * p.b / p.m_uf
    f[20] -= left * p.a / p.m_ur
    f[5] -= (push[1] - n.yaw_c * -x[5] - n.yaw_c2 * -x[5] * abs(x[5])) / p.I_z
    f[7] += (push[2] - bump_moment(x[6], n)) / p.I_Phi_s
    if n.friction > 0.0:
        f[7] -= n.friction * np.tanh(x[7] / 0.02) / p.I_Phi_s
    return f


@njit(error_model="numpy")
def _run(command: Array, wanted: Array, around: Array, heading: float, p: Parameters, n: Numbers) -> Array:
    """(steps, 11) of the CG of the sprung mass."""
    out = np.zeros((command.size, 11))
    out[:, PSI] = heading
    x, servo, push = np.zeros(STATES), np.zeros(STEERING_STATES), np.zeros(3)
    base = p.a + p.b
    down_f = (p.m_s * GRAVITY * p.b / base + p.m_uf * GRAVITY) / 2 / p.K_zt
    down_r = (p.m_s * GRAVITY * p.a / base + p.m_ur * GRAVITY) / 2 / p.K_zt
    moving, speed, front, slip = False, 0.0, 0.0, 0.0
    load, hung, lost = np.zeros(2), 0.0, 0.0
    lever = p.a if n.lift_form == 0.0 else -p.b
    for k in range(command.size):
        delta = steering_step(servo, command[k], speed, front, slip, n, DT)
        if not moving:
            going = wanted[k] > 0.0
            speed = speed + START * DT if going else speed * (1 - DT / STOP)
            out[k, U], out[k, U_DOT] = speed, (START if going else -speed / STOP)
            if k > 0:
                out[k, PSI] = out[k - 1, PSI]
                for column in (R, V, PHI, P):
                    out[k, column] = out[k - 1, column] * (1 - DT / STOP)
            if speed >= PACE and going:
                moving = True
                x[:] = 0.0
                x[3], x[4] = speed, -out[k, PSI]
                x[16], x[21] = down_f, down_r
                x[11] = (down_f * p.b + down_r * p.a) / base
                x[8] = (down_r - down_f) / base
                x[23:27] = speed / p.R_w
            continue
        angle = delta + n.roll_steer_front * x[6]
        x[2] = -angle
        drive = max(-n.most_drive, min(n.most_drive, (wanted[k] - x[3]) / n.tau_drive))
        drive -= n.rolling * GRAVITY
        cos, sin = np.cos(-x[4]), np.sin(-x[4])
        wind = around[k, WIND_Y] * cos - around[k, WIND_X] * sin
        push[0] = around[k, ROAD_Y] + wind - lost + hung
        push[1] = around[k, ROAD_YAW] + wind * n.wind_x - lever * lost
        push[2] = around[k, ROAD_ROLL] - wind * n.wind_z + load_roll(load, hung, n)
        for j in range(SUBSTEPS):
            one = _rates(x, drive, push, p, n)
            if j == 0:
                out[k, U], out[k, V], out[k, R], out[k, PHI] = x[3], -x[10], -x[5], x[6]
                out[k, P], out[k, PSI], out[k, UP_DOT] = x[7], -x[4], -one[12]
                out[k, U_DOT], out[k, V_DOT], out[k, R_DOT], out[k, P_DOT] = one[3], -one[10], -one[5], one[7]
            two = _rates(x + DT / SUBSTEPS * one, drive, push, p, n)
            x += DT / SUBSTEPS / 2 * (one + two)
        across = out[k, V_DOT] + x[3] * out[k, R]
        front = (p.b * p.m * across + p.I_z * out[k, R_DOT]) / base
        if n.lift > 0.0:
            lean = (n.kphi * x[6] + n.bphi * x[7] + p.m * n.roll_axis * x[3] * out[k, R]) / n.track
            tyres = (front if n.lift_form == 0.0 else p.m * across - front) + lost
            lost = lost_share(lean, n) * tyres
        if n.loose > 0.0:
            hung = load_step(load, across, n, DT)
        slip, speed = -front / n.Cf, x[3]
        if speed < PACE and wanted[k] == 0.0:
            moving = False
    return out


def _signals(rover: EngineRover, command: Array, wanted: Array, around: Array, heading: float) -> Signals:
    rover = at_speed(rover, float(np.max(wanted)))
    i, n = rover.instruments, rover.numbers
    found = _run(command, wanted, around, heading, parameters(rover), n)
    u, v, r, phi, p, psi, u_dot, v_dot, r_dot, p_dot, up_dot = found.T
    cos, sin, z = np.cos(phi), np.sin(phi), i.imu_z - n.h  # above the CG of the sprung mass
    across = v_dot + u * r + r_dot * i.imu_x - z * (cos * p_dot - sin * p * p) + r * r * z * sin
    up = GRAVITY + up_dot - z * (sin * p_dot + cos * p * p)
    ahead = u_dot - v * r - r * r * i.imu_x
    return {
        **mounted(r * cos, p, (ahead, cos * across + sin * up, cos * up - sin * across), i),
        "vy": v + r * i.imu_x - z * cos * p,
        "speed": u,
        "phi": phi,
        "psi": psi,
    }


ENGINE = Engine("commonroad", SIZES, _signals, LISTED, OUTSIDE, PLACES)
