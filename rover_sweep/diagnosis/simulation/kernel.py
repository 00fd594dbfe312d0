"""Compiled loops of the simulation: single track with roll, roll alone, and the servo.

Axes ISO, SI units. v is the lateral velocity at the roll axis. The equations are (18) of the paper as
corrected, with nonlinear tyre slip angles:

    m (v' + V r) - h ms p'                      = Ff cos d + Fr + Fy
    Izz r' + Ixz p'                             = a Ff cos d - b Fr + Mz
    (Ixx + ms h^2) p' + Ixz r' - h ms (v' + V r) = (ms g h - k_phi) phi - b_phi p - T sgn p + Mx
"""

from __future__ import annotations

from math import atan, copysign, exp, sin, sqrt, tanh
from typing import NamedTuple

import numpy as np
from numba import njit

V, R, PHI, P, FRONT, REAR = range(6)  # rows of the state: m/s, rad/s, rad, rad/s, tyre forces N
SGN_WIDTH = 0.01  # rad/s, within which dry friction is smooth, times exp(ln_width)
FALLING = 1.6  # shape factor C of the magic formula; the force falls beyond its peak
FASTEST = 300.0  # 1/s, of the tyre relaxation; a faster one has no effect at this step


class VehicleNumbers(NamedTuple):
    """Numbers of the single track with roll, SI units, ISO axes; an effect that is absent is 0.

    m, ms: mass and sprung mass. h: height of the sprung mass above the roll axis. Ixx, Izz, Ixz: inertia.
    a, b: CG to the front and to the rear axle. Cf, Cr: cornering stiffness. k_phi, b_phi: roll stiffness
    and damping. g: gravity. bend: fifth-order fall of the tyre force, see `_tyre`. inv_mu: 1 over the peak
    force per axle load. sigma: relaxation length. k_load: loss of stiffness at a_y = g. e_roll: steering
    angle per roll angle, e_rear the same of the rear axle. T_roll: dry friction torque. ln_width: ln of its
    smooth width over `SGN_WIDTH`. tyre_form: 0 tanh, 1 brush, 2 a peak that falls. yaw_damp [N m s] and
    yaw_damp_v [N m^2]: yaw moments -yaw_damp r and -yaw_damp_v r/V. compliance [rad/N]: angle of the front
    wheels that the front side force takes away.
    """

    m: float
    ms: float
    h: float
    Ixx: float
    Izz: float
    Ixz: float
    a: float
    b: float
    Cf: float
    Cr: float
    k_phi: float
    b_phi: float
    g: float
    inv_mu: float = 0.0
    sigma: float = 0.0
    k_load: float = 0.0
    e_roll: float = 0.0
    T_roll: float = 0.0
    ln_width: float = 0.0
    bend: float = 0.0
    tyre_form: float = 0.0
    e_rear: float = 0.0
    yaw_damp: float = 0.0
    yaw_damp_v: float = 0.0
    compliance: float = 0.0


AT = VehicleNumbers(*range(len(VehicleNumbers._fields)))  # index of each number in the kernel's array


@njit(cache=True, nogil=True, fastmath=True)
def _tyre(alpha: float, c: float, load: float, inv_mu: float, bend: float, form: float) -> float:
    """Side force [N]: -C alpha, less from the fifth order on (bend), saturating by a form (inv_mu)."""
    force = -c * alpha
    square = (force / load) * (force / load)
    force = force / sqrt(1.0 + 0.5 * bend * square * square)
    if inv_mu > 1e-9:
        top = load / inv_mu
        if form == 1.0:
            z = min(abs(force) / (3.0 * top), 1.0)
            return copysign(top * z * (3.0 - z * (3.0 - z)), force)
        if form == 2.0:
            return top * sin(FALLING * atan(force / (FALLING * top)))
        return top * tanh(force / top)
    return force


@njit(cache=True, nogil=True, fastmath=True)
def _angle(slope: float) -> float:
    """atan [rad]; its series below 0.2, where the series is exact to 1e-6 rad."""
    if -0.2 < slope < 0.2:
        square = slope * slope
        return slope * (1.0 - square * (1.0 / 3.0 - square * (0.2 - square / 7.0)))
    return atan(slope)


@njit(cache=True, nogil=True, fastmath=True)
def _dry(torque: float, p: float, ln_width: float) -> float:
    """Dry friction [N m] at the roll rate p [rad/s]; skips tanh when the friction is zero."""
    return torque * tanh(p / (SGN_WIDTH * exp(ln_width))) if torque != 0.0 else 0.0


@njit(cache=True, nogil=True, fastmath=True)
def _rates(x, out, d, speed, grip, fy, mz, mx, ay, q, roll, relaxed):  # type: ignore[no-untyped-def]
    m, ms, h, a, b, g = q[AT.m], q[AT.ms], q[AT.h], q[AT.a], q[AT.b], q[AT.g]
    ixx, izz, ixz = q[AT.Ixx], q[AT.Izz], q[AT.Ixz]
    v, r, phi, p = x[V], x[R], x[PHI], x[P]
    d += q[AT.e_roll] * phi
    soft = 1.0 - q[AT.k_load] * (ay / g) * (ay / g)
    if soft < 0.05:
        soft = 0.05
    cf, cr = q[AT.Cf] * grip * soft, q[AT.Cr] * grip * soft
    alpha_f = _angle((v + a * r) / speed) - d
    alpha_r = _angle((v - b * r) / speed) - q[AT.e_rear] * phi
    if q[AT.compliance] != 0.0:
        # the force that takes the angle away, by linear tyres: F = -C (alpha + compliance F)
        alpha_f -= q[AT.compliance] * cf * alpha_f / (1.0 + q[AT.compliance] * cf)
    front = _tyre(alpha_f, cf, m * g * b / (a + b), q[AT.inv_mu], q[AT.bend], q[AT.tyre_form])
    rear = _tyre(alpha_r, cr, m * g * a / (a + b), q[AT.inv_mu], q[AT.bend], q[AT.tyre_form])
    if relaxed:
        rate = min(speed / q[AT.sigma], FASTEST)
        out[FRONT] = rate * (front - x[FRONT])
        out[REAR] = rate * (rear - x[REAR])
        front, rear = x[FRONT], x[REAR]
    cd = 1.0 - d * d * (0.5 - d * d / 24.0)
    side = front * cd + rear + fy
    yaw = a * front * cd - b * rear + mz - (q[AT.yaw_damp] + q[AT.yaw_damp_v] / speed) * r
    if not roll:
        out[V] = side / m - speed * r
        out[R] = yaw / izz
        out[PHI] = 0.0
        out[P] = 0.0
        return side / m
    friction = _dry(q[AT.T_roll], p, q[AT.ln_width])
    torque = (ms * g * h - q[AT.k_phi]) * phi - q[AT.b_phi] * p - friction + mx
    # lateral acceleration A = v' + V r and p' of the first and third equation, r' of the second
    hm = h * ms / m
    j = ixx + ms * h * h - hm * h * ms - ixz * ixz / izz
    p_dot = (torque + hm * side - ixz * yaw / izz) / j
    across = side / m + hm * p_dot
    out[V] = across - speed * r
    out[R] = (yaw - ixz * p_dot) / izz
    out[PHI] = p
    out[P] = p_dot
    return across


@njit(cache=True, nogil=True, fastmath=True)
def single_track(steer, speed, grip, fy, mz, mx, q, roll, relaxed, dt):  # type: ignore[no-untyped-def]
    """Motion (n, 7) in the columns v, r, phi, p, v' + V r, r', p'; SI units, RK4 of step dt [s].

    steer (n,): road-wheel angle [rad]. speed (n,): V [m/s]. grip (n,): factor of both axles' stiffness.
    fy, mz, mx (n,): added side force [N], yaw moment and roll moment [N m]. q (25,): `VehicleNumbers`.
    roll: False holds phi and p at 0. relaxed: the tyre forces lag by the relaxation length.
    """
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
        y[k, 0], y[k, 1], y[k, 2], y[k, 3] = x[V], x[R], x[PHI], x[P]
        y[k, 4], y[k, 5], y[k, 6] = across, k1[R], k1[P]
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
            if not abs(x[i]) < (1e3 if i < FRONT else 1e3 * q[AT.m] * q[AT.g]):  # unstable trial of a fit
                x[i] = 0.0
    return y


@njit(cache=True, nogil=True, fastmath=True)
def roll_only(across, yaw_rate_dot, mx, q, dt):  # type: ignore[no-untyped-def]
    """(n, 3): phi, p, p' of the sprung mass [rad, rad/s, rad/s^2].

    across (n,): given lateral acceleration [m/s^2]. yaw_rate_dot (n,): r' [rad/s^2]. mx (n,): added roll
    moment [N m]. q (25,): `VehicleNumbers`. dt: step [s].
    """
    n = across.size
    y = np.zeros((n, 3))
    phi = p = 0.0
    ms, h, g = q[AT.ms], q[AT.h], q[AT.g]
    j = q[AT.Ixx] + ms * h * h
    for k in range(n):
        friction = _dry(q[AT.T_roll], p, q[AT.ln_width])
        torque = (ms * g * h - q[AT.k_phi]) * phi - q[AT.b_phi] * p - friction + mx[k]
        p_dot = (torque + h * ms * across[k] - q[AT.Ixz] * yaw_rate_dot[k]) / j
        y[k, 0], y[k, 1], y[k, 2] = phi, p, p_dot
        p += dt * p_dot
        phi += dt * p
    return y


@njit(cache=True, nogil=True)
def servo(u, lag, shape, inv_rate, dt):  # type: ignore[no-untyped-def]
    """Road-wheel angle (n,) rad behind the servo 1/(1 + lag s + shape lag^2 s^2) with a rate limit.

    u (n,): wanted angle [rad]. lag [s]. inv_rate: 1 over the rate limit [s/rad], 0 for no limit. dt: step
    [s]. shape 0 is a first-order lag, 1/4 two equal first-order lags, 1/2 a damping ratio of 0.71.
    Integrated by implicit Euler in half steps, with the input linear between samples.
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
