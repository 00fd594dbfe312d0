"""Compiled loops of the simulation: single track with roll; a servo.

Axes ISO. Velocity v is lateral, taken on the roll axis; the equations are (18) of the paper as
corrected, with the angles of the tyres left nonlinear:

    m (v' + V r) - h ms p'                      = Ff cos d + Fr + Fy
    Izz r' + Ixz p'                             = a Ff cos d - b Fr + Mz
    (Ixx + ms h^2) p' + Ixz r' - h ms (v' + V r) = (ms g h - k_phi) phi - b_phi p - T sgn p + Mx
"""

from __future__ import annotations

from math import atan, exp, sqrt, tanh

import numpy as np
from numba import njit

SLOTS = (
    "m",
    "ms",
    "h",
    "Ixx",
    "Izz",
    "Ixz",
    "a",
    "b",
    "Cf",
    "Cr",
    "k_phi",
    "b_phi",
    "g",
    "inv_mu",
    "sigma",
    "k_load",
    "e_roll",
    "T_roll",
    "ln_width",
    "bend",
)
SLOT = {name: k for k, name in enumerate(SLOTS)}
SGN_WIDTH = 0.01  # rad/s, within which dry friction is smooth, times exp(ln_width)
FASTEST = 300.0  # 1/s, of the tyre's relaxation: shorter ones are as good as none


@njit(cache=True, nogil=True, fastmath=True)
def _tyre(alpha: float, c: float, load: float, inv_mu: float, bend: float) -> float:
    """Side force: C alpha, bent to fifth order as every tyre near its limit, tanh where it saturates."""
    force = -c * alpha
    square = (force / load) * (force / load)
    force = force / sqrt(1.0 + 0.5 * bend * square * square)
    if inv_mu > 1e-9:
        top = load / inv_mu
        return top * tanh(force / top)
    return force


@njit(cache=True, nogil=True, fastmath=True)
def _angle(slope: float) -> float:
    """atan, by its series where that is exact to 1e-6 rad."""
    if -0.2 < slope < 0.2:
        square = slope * slope
        return slope * (1.0 - square * (1.0 / 3.0 - square * (0.2 - square / 7.0)))
    return atan(slope)


@njit(cache=True, nogil=True, fastmath=True)
def _dry(torque: float, p: float, ln_width: float) -> float:
    """Dry friction at the roll rate p; free where there is none, since tanh is dear."""
    return torque * tanh(p / (SGN_WIDTH * exp(ln_width))) if torque != 0.0 else 0.0


@njit(cache=True, nogil=True, fastmath=True)
def _rates(x, out, d, speed, grip, fy, mz, mx, ay, q, roll, relaxed):  # type: ignore[no-untyped-def]
    m, ms, h, ixx, izz, ixz, a, b = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7]
    g = q[12]
    v, r, phi, p = x[0], x[1], x[2], x[3]
    d += q[16] * phi
    soft = 1.0 - q[15] * (ay / g) * (ay / g)
    if soft < 0.05:
        soft = 0.05
    cf, cr = q[8] * grip * soft, q[9] * grip * soft
    alpha_f = _angle((v + a * r) / speed) - d
    alpha_r = _angle((v - b * r) / speed)
    front = _tyre(alpha_f, cf, m * g * b / (a + b), q[13], q[19])
    rear = _tyre(alpha_r, cr, m * g * a / (a + b), q[13], q[19])
    if relaxed:
        rate = min(speed / q[14], FASTEST)
        out[4] = rate * (front - x[4])
        out[5] = rate * (rear - x[5])
        front, rear = x[4], x[5]
    cd = 1.0 - d * d * (0.5 - d * d / 24.0)
    side = front * cd + rear + fy
    yaw = a * front * cd - b * rear + mz
    if not roll:
        out[0] = side / m - speed * r
        out[1] = yaw / izz
        out[2] = 0.0
        out[3] = 0.0
        return side / m
    torque = (ms * g * h - q[10]) * phi - q[11] * p - _dry(q[17], p, q[18]) + mx
    # lateral acceleration A = v' + V r and p' of the first and third equation, r' of the second
    hm = h * ms / m
    j = ixx + ms * h * h - hm * h * ms - ixz * ixz / izz
    p_dot = (torque + hm * side - ixz * yaw / izz) / j
    across = side / m + hm * p_dot
    out[0] = across - speed * r
    out[1] = (yaw - ixz * p_dot) / izz
    out[2] = p
    out[3] = p_dot
    return across


@njit(cache=True, nogil=True, fastmath=True)
def single_track(steer, speed, grip, fy, mz, mx, q, roll, relaxed, dt):  # type: ignore[no-untyped-def]
    """(n, 7): v, r, phi, p, v' + V r, r', p' driven by steer (n,) rad at speed (n,) m/s; RK4 of step dt."""
    n = steer.size
    y = np.zeros((n, 7))
    x, xs = np.zeros(6), np.zeros(6)
    k1, k2, k3, k4 = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6)
    across = 0.0
    size = 6 if relaxed else 4
    for k in range(n):
        d0, v0 = steer[k], speed[k]
        f0, z0, m0, g0 = fy[k], mz[k], mx[k], grip[k]
        across = _rates(x, k1, d0, v0, g0, f0, z0, m0, across, q, roll, relaxed)
        y[k, 0], y[k, 1], y[k, 2], y[k, 3] = x[0], x[1], x[2], x[3]
        y[k, 4], y[k, 5], y[k, 6] = across, k1[1], k1[3]
        if k + 1 == n:
            break
        d2, v2 = steer[k + 1], speed[k + 1]
        f2, z2, m2, g2 = fy[k + 1], mz[k + 1], mx[k + 1], grip[k + 1]
        d1, v1 = 0.5 * (d0 + d2), 0.5 * (v0 + v2)
        f1, z1, m1, g1 = 0.5 * (f0 + f2), 0.5 * (z0 + z2), 0.5 * (m0 + m2), 0.5 * (g0 + g2)
        for i in range(size):
            xs[i] = x[i] + 0.5 * dt * k1[i]
        _rates(xs, k2, d1, v1, g1, f1, z1, m1, across, q, roll, relaxed)
        for i in range(size):
            xs[i] = x[i] + 0.5 * dt * k2[i]
        _rates(xs, k3, d1, v1, g1, f1, z1, m1, across, q, roll, relaxed)
        for i in range(size):
            xs[i] = x[i] + dt * k3[i]
        _rates(xs, k4, d2, v2, g2, f2, z2, m2, across, q, roll, relaxed)
        for i in range(size):
            x[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
            if not abs(x[i]) < (1e3 if i < 4 else 1e3 * q[0] * q[12]):  # a force is told by the weight
                x[i] = 0.0
    return y


@njit(cache=True, nogil=True, fastmath=True)
def roll_only(across, yaw_rate_dot, mx, q, dt):  # type: ignore[no-untyped-def]
    """(n, 3): phi, p, p' of the sprung mass under a given lateral acceleration (n,) m/s^2."""
    n = across.size
    y = np.zeros((n, 3))
    phi = p = 0.0
    ms, h, g = q[1], q[2], q[12]
    j = q[3] + ms * h * h
    for k in range(n):
        torque = (ms * g * h - q[10]) * phi - q[11] * p - _dry(q[17], p, q[18]) + mx[k]
        p_dot = (torque + h * ms * across[k] - q[5] * yaw_rate_dot[k]) / j
        y[k, 0], y[k, 1], y[k, 2] = phi, p, p_dot
        p += dt * p_dot
        phi += dt * p
    return y


@njit(cache=True, nogil=True)
def servo(u, lag, shape, inv_rate, dt):  # type: ignore[no-untyped-def]
    """Angle (n,) of 1/(1 + lag s + shape lag^2 s^2) with a limited rate 1/inv_rate [rad/s].

    shape 0 is a first-order lag, 1/4 two equal ones, 1/2 a servo that is damped by .71. Implicit Euler in
    half steps, the input linear between samples.
    """
    d = np.empty(u.size)
    h = 0.5 * dt
    inertia = shape * lag * lag / h
    top = 1.0 / inv_rate if inv_rate > 1e-9 else 1e9
    x, w, before = u[0], 0.0, u[0]
    for k in range(u.size):
        for wanted in (0.5 * (before + u[k]), u[k]):
            w = min(max((wanted - x + inertia * w) / (inertia + lag + h), -top), top)
            x += h * w
        before = u[k]
        d[k] = x
    return d
