"""CommonRoad's multi-body model as an engine: Heun's method at 2 kHz, road and wind as forces beside it.

The model divides by the speed, so a run is simulated from a walking pace on; before and after it the rover
starts and stops evenly in a straight line.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tests.engines.added_forces import at_speed, load_roll, load_step, lost_share
from tests.engines.commonroad_laws import LISTED, OUTSIDE, PLACES
from tests.engines.commonroad_model import RATES, Parameters, parameters
from tests.engines.engine import Array, Engine, Signals
from tests.engines.rover import EngineRover
from tests.foreign.chassis import GRAVITY, ROAD_ROLL, ROAD_Y, ROAD_YAW, WIND_X, WIND_Y, bump_moment
from tests.foreign.instruments import mounted
from tests.foreign.motion import DT
from tests.foreign.numbers import Numbers
from tests.foreign.rover import SIZES
from tests.foreign.steering import STATES as STEERING_STATES
from tests.foreign.steering import steering_step

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
