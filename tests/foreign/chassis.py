"""Equations of motion: an unsprung frame on four wheels that carries a body rolling about a fixed axis.

Lagrange's equations with finite roll angles. Coordinates: velocities u (forward), v (left) of the point of
the roll axis below the CG and yaw rate r, in the frame that yaws and does not roll; roll angle phi, positive
where the left side rises. The CG of the body lies at y = -h sin(phi), z = h cos(phi).
state: 0 u, 1 v, 2 r, 3 phi, 4 phi', 5 heading, 6 to 9 slip angle or force share of each wheel that lags, 10
and 11 place and speed of the loose load (left).
loose_form 0 on a spring beside the CG, 1 a pendulum that hangs from the CG, 2 on a bed at its height with dry
friction, between stops. lift_form 0 front axle, 1 rear axle.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.foreign.numbers import Numbers
from tests.foreign.tyres import dead_zone, load_factor, side_force

Array = NDArray[np.float64]
STATES = 12
GRAVITY = 9.81
BED_FRICTION, BED_WAY, STOP_W = 0.12, 0.12, 60.0  # of a sliding load; its way in tracks; rad/s
CREEP = 0.1  # m/s: below it tyres resist in proportion to the sliding speed
# columns of a step's surroundings
SURFACE, SHIFT, WIND_X, WIND_Y, ROAD_Y, ROAD_YAW, ROAD_ROLL = range(7)


@njit
def derivative(x: Array, delta: float, around: Array, wanted: float, n: Numbers, out: Array) -> None:
    """out: (15,) rates of the state, then front side force, front slip angle, and gravity to the left.

    around: (7,) share of the stiffness, shift of the CG [m], wind in world axes [N], road as side force [N],
    yaw and roll moment [N m]. wanted: forward speed that the drive asks for [m/s].
    """
    u, v, r, phi, p, psi = x[0], x[1], x[2], x[3], x[4], x[5]
    a, b = n.a - around[SHIFT], n.b + around[SHIFT]
    fall = GRAVITY * math.sin(n.slope)
    gx, gy = fall * math.cos(n.slope_heading - psi), fall * math.sin(n.slope_heading - psi)
    gz = GRAVITY * math.cos(n.slope)
    drive = max(-n.most_drive, min(n.most_drive, (wanted - u) / n.tau_drive)) * n.m
    fx, fy = drive - n.rolling * n.m * gz * math.tanh(u / 0.05), around[ROAD_Y]
    mz, mx = around[ROAD_YAW], around[ROAD_ROLL]
    front, slip_front = 0.0, 0.0
    lean = (n.kphi * phi + n.bphi * p + n.m * n.roll_axis * u * r) / n.track  # of both axles, half each
    for k in range(4):
        ahead, left = (a if k < 2 else -b), (n.track / 2 if k % 2 == 0 else -n.track / 2)
        angle = _wheel_angle(k, delta, phi, left, a + b, n)
        cos, sin = math.cos(angle), math.sin(angle)
        vx, vy = u - r * left, v + r * ahead
        along, across = vx * cos + vy * sin, vy * cos - vx * sin
        alpha = math.atan2(across, max(abs(along), CREEP))
        if n.sigma > 0.0 and (n.sigma_form < 2.0 or k < 2):
            out[6 + k] = max(abs(along), 5 * CREEP) / n.sigma * (alpha - x[6 + k])
            alpha = x[6 + k]
        else:
            out[6 + k] = 0.0
        static = n.m * gz * (b if k < 2 else a) / (a + b) / 2
        moved = (-lean if k % 2 == 0 else lean) / 2
        load = static + moved
        stiffness = (n.Cf if k < 2 else n.Cr) / 2 * around[SURFACE]
        stiffness *= 1.0 + math.copysign(n.tyre_left_right, alpha)
        if n.load_form > 0.0:
            stiffness *= load_factor(load, static, n.load_k, n.load_form)
        if n.lift > 0.0 and (k < 2) == (n.lift_form == 0.0):
            stiffness *= load_factor(static + n.lift * moved, static, 0.0, 4.0)
        if n.slip_speed > 0.0:
            stiffness *= (max(abs(along), 5 * CREEP) / n.speed_ref) ** n.slip_speed
        if n.tyre_dead_zone > 0.0:
            alpha = dead_zone(alpha, n.tyre_dead_zone)
        f = side_force(alpha, stiffness, n.mu * static, n.tyre_form)
        fx -= f * sin
        fy += f * cos
        mz += ahead * f * cos + left * f * sin
        if k < 2:
            front += f
            slip_front += alpha / 2
    mz -= n.yaw_c * r + n.yaw_c2 * r * abs(r)
    if n.diff_c > 0.0:  # rear wheels of one speed: each slips by half the difference
        slip = n.track * r / (2 * max(abs(u), CREEP))
        grip = min(n.mu, 1.0) * n.m * gz * a / (a + b) / 2
        mz -= n.track * grip * math.tanh(n.diff_c * slip / grip) * min(1.0, abs(u) / CREEP)
    wind = around[WIND_Y] * math.cos(psi) - around[WIND_X] * math.sin(psi)
    fx += around[WIND_X] * math.cos(psi) + around[WIND_Y] * math.sin(psi)
    fy += wind
    mz += wind * n.wind_x
    mx -= wind * n.wind_z
    body, sprung, pull = n.m, n.ms, loose_pull(x[10], x[11], n)
    if n.loose > 0.0:
        loose = n.loose * n.m
        body -= loose
        fy += loose * pull
        mx -= loose * pull * n.h
        if n.loose_form > 0.0:
            sprung -= loose
        if n.loose_form == 2.0:
            mx -= loose * gz * x[10]
    mx -= n.kphi * phi + n.bphi * p + _dry(p, n) + bump_moment(phi, n)
    # two equations for v' and phi''
    cphi, sphi = math.cos(phi), math.sin(phi)
    m01 = -sprung * n.h * cphi
    m11 = n.Ixx + sprung * n.h * n.h
    right_y = fy + body * (gy - u * r) - sprung * n.h * sphi * (p * p + r * r)
    right_roll = mx + sprung * n.h * (cphi * (u * r - gy) + n.h * r * r * sphi * cphi)
    right_roll += n.ms * n.h * gz * sphi
    det = body * m11 - m01 * m01
    out[1] = (m11 * right_y - m01 * right_roll) / det
    out[4] = (body * right_roll - m01 * right_y) / det
    out[0] = v * r + fx / n.m + gx
    out[2] = (mz - n.ms * n.h * sphi * (out[0] - v * r)) / n.Izz
    out[3], out[5] = p, r
    out[10] = x[11]
    out[11] = -pull - (out[1] + u * r - gy)
    if n.loose_form > 0.0:
        out[11] += n.h * (cphi * out[4] - sphi * p * p)
    out[12], out[13], out[14] = front, slip_front, gy


@njit
def _wheel_angle(k: int, delta: float, phi: float, left: float, base: float, n: Numbers) -> float:
    if k >= 2:
        return n.roll_steer_rear * phi + n.rear_share * delta
    # Ackermann: cot(outer) - cot(inner) = track / base, here to second order
    return delta * (1.0 + n.ackermann * delta * left / base) + n.roll_steer_front * phi


@njit
def loose_pull(y: float, speed: float, n: Numbers) -> float:
    """What a loose load at y [m] to the left pulls the rover to the left with, m/s^2 of its mass."""
    if n.loose_form == 1.0:
        length = GRAVITY / n.loose_w**2
        return GRAVITY * math.sin(y / length) + 2 * n.loose_z * n.loose_w * speed
    if n.loose_form == 2.0:
        beyond = math.copysign(max(abs(y) - BED_WAY * n.track, 0.0), y)
        stop = STOP_W**2 * beyond + (STOP_W * speed if beyond != 0.0 else 0.0)
        return BED_FRICTION * GRAVITY * math.tanh(speed / 0.02) + speed + stop
    return n.loose_w**2 * y + 2 * n.loose_z * n.loose_w * speed


@njit
def bump_moment(phi: float, n: Numbers) -> float:
    """Roll moment [N m] of the stops, against phi."""
    if n.bump <= 0.0:
        return 0.0
    return n.bump_k * math.copysign(max(abs(phi) - n.bump, 0.0), phi)


@njit
def _dry(p: float, n: Numbers) -> float:
    """Friction moment in the suspension. Forms: 0 tanh, 1 Stribeck (more at rest), 2 progressive, sqrt."""
    if n.friction <= 0.0:
        return 0.0
    if n.friction_form == 1.0:
        return n.friction * math.tanh(p / 0.01) * (1.0 + 0.5 * math.exp(-((p / 0.05) ** 2)))
    if n.friction_form == 2.0:
        return n.friction * p / math.sqrt(p * p + 0.03**2)
    return n.friction * math.tanh(p / 0.02)
