"""Compiled loops of the simulation: single track with roll, roll alone, and the servo.

Axes ISO, SI units. v is the lateral velocity at the roll axis. The equations are (18) of the paper as
corrected, with nonlinear tyre slip angles:

    m (v' + V r) - h ms p'                      = Ff cos d + Fr + Fy
    Izz r' + Ixz p'                             = a Ff cos d - b Fr + Mz
    (Ixx + ms h^2) p' + Ixz r' - h ms (v' + V r) = (ms g h - k_phi) phi - b_phi p - T sgn p + Mx
"""

from __future__ import annotations

from math import atan, copysign, cos, exp, sin, sqrt, tanh
from typing import NamedTuple

import numpy as np
from numba import njit

V, R, PHI, P = range(4)  # rows of a state of the lumped model: m/s, rad/s, rad, rad/s
SGN_WIDTH = 0.01  # rad/s, within which dry friction is smooth, times exp(ln_width)
FALLING = 1.6  # shape factor C of the magic formula; the force falls beyond its peak
FASTEST = 300.0  # 1/s, of the tyre relaxation; a faster one has no effect
FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}  # not nnan, ninf: a trial of a fit may overflow
STABLE, MOST_PARTS = 2.0, 12  # rate times step within which RK4 is stable; parts of a step


class VehicleNumbers(NamedTuple):
    """Numbers of the single track with roll, SI units, ISO axes; an effect that is absent is 0.

    m, ms: mass and sprung mass. h: height of the sprung mass above the roll axis. Ixx, Izz, Ixz: inertia.
    a, b: CG to the front and to the rear axle. Cf, Cr: cornering stiffness. k_phi, b_phi: roll stiffness
    and damping. g: gravity. bend: fifth-order fall of the tyre force, see `_tyre`. inv_mu: 1 over the peak
    force per axle load. sigma: relaxation length. k_load: loss of stiffness at a_y = g. e_roll: steering
    angle per roll angle, e_rear the same of the rear axle. T_roll: dry friction torque. ln_width: ln of its
    smooth width over `SGN_WIDTH`. tyre_form: 0 tanh, 1 brush, 2 a peak that falls. yaw_damp [N m s] and
    yaw_damp_v [N m^2]: yaw moments -yaw_damp r and -yaw_damp_v r/V. compliance [rad/N]: angle of the front
    wheels that the front side force takes away. track [m^2]: square
    of the half track, by which the wheels of both sides differ in slip.
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
    track: float = 0.0


AT = VehicleNumbers(*range(len(VehicleNumbers._fields)))  # index of each number in the kernel's array


@njit(cache=True, nogil=True, fastmath=FAST)
def _tyre(alpha, c, load, inv_load, inv_mu, half_bend, form):  # type: ignore[no-untyped-def]
    """Side force [N]: -C alpha, less from the fifth order on (bend), saturating by a form (inv_mu)."""
    force = -c * alpha
    square = (force * inv_load) * (force * inv_load)
    force = force / sqrt(1.0 + half_bend * square * square)
    if inv_mu > 1e-9:
        top = load / inv_mu
        if form == 1.0:
            z = min(abs(force) / (3.0 * top), 1.0)
            return copysign(top * z * (3.0 - z * (3.0 - z)), force)
        if form == 2.0:
            return top * sin(FALLING * atan(force / (FALLING * top)))
        return top * tanh(force / top)
    return force


@njit(cache=True, nogil=True, fastmath=FAST)
def _angle(slope: float) -> float:
    """atan [rad]; its series below 0.2, where the series is exact to 1e-6 rad."""
    if -0.2 < slope < 0.2:
        square = slope * slope
        return slope * (1.0 - square * (1.0 / 3.0 - square * (0.2 - square / 7.0)))
    return atan(slope)


@njit(cache=True, nogil=True, fastmath=FAST)
def _dry(torque: float, p: float, ln_width: float) -> float:
    """Dry friction [N m] at the roll rate p [rad/s]; skips tanh when the friction is zero."""
    return torque * tanh(p / (SGN_WIDTH * exp(ln_width))) if torque != 0.0 else 0.0


@njit(cache=True, nogil=True, fastmath=FAST)
def single_track(steer, speed, grip, fy, mz, mx, q, roll, relaxed, dt):  # type: ignore[no-untyped-def]
    """Motion (n, 7) in the columns v, r, phi, p, v' + V r, r', p'; SI units, RK4 of step dt [s].

    steer (n,): road-wheel angle [rad]. speed (n,): V [m/s]. grip (n,): factor of both axles' stiffness.
    fy, mz, mx (n,): added side force [N], yaw moment and roll moment [N m]. q (26,): `VehicleNumbers`.
    roll: False holds phi and p at 0. relaxed: the tyre forces lag by the relaxation length.

    The numbers are local and the quotients of constants are computed once: with them in an array that may
    overlap with the output, each step took four times as long.
    """
    m, ms, h, a, b, g = q[AT.m], q[AT.ms], q[AT.h], q[AT.a], q[AT.b], q[AT.g]
    izz, ixz, stiff_f, stiff_r, k_load = q[AT.Izz], q[AT.Ixz], q[AT.Cf], q[AT.Cr], q[AT.k_load]
    e_roll, e_rear, compliance = q[AT.e_roll], q[AT.e_rear], q[AT.compliance]
    inv_mu, half_bend, form, b_phi = q[AT.inv_mu], 0.5 * q[AT.bend], q[AT.tyre_form], q[AT.b_phi]
    track = q[AT.track]
    yaw_damp, yaw_damp_v, sigma, t_roll = q[AT.yaw_damp], q[AT.yaw_damp_v], q[AT.sigma], q[AT.T_roll]
    load_f, load_r = m * g * b / (a + b), m * g * a / (a + b)
    inv_load_f, inv_load_r = 1.0 / load_f, 1.0 / load_r
    inv_m, inv_izz, inv_g, hm = 1.0 / m, 1.0 / izz, 1.0 / g, h * ms / m
    twist = ixz * inv_izz
    j = q[AT.Ixx] + ms * h * h - hm * h * ms - ixz * twist
    inv_j = 1.0 / j if roll else 0.0  # 0 where the vehicle file has no roll
    spring = ms * g * h - q[AT.k_phi]
    inv_width = 1.0 / (SGN_WIDTH * exp(q[AT.ln_width]))
    top_motion, top_force = 1e3, 1e3 * m * g

    n = steer.size
    y = np.zeros((n, 7))
    v = r = phi = p = lag_f = lag_r = across = shifted = 0.0
    rubbing = t_roll * inv_width * inv_j  # 1/s, of dry friction about rest
    rigid = (stiff_f + stiff_r) * inv_m + (a * a * stiff_f + b * b * stiff_r) * inv_izz
    for k in range(n):
        last = k + 1 == n
        end = k if last else k + 1
        fastest = rigid / speed[k] + rubbing + (min(speed[k] / sigma, FASTEST) if relaxed else 0.0)
        wanted = fastest * dt / STABLE
        parts = 1 if last else (int(wanted) + 1 if wanted < MOST_PARTS else MOST_PARTS)
        width = dt / parts
        for part in range(parts):
            sum_v = sum_r = sum_phi = sum_p = sum_f = sum_rear = 0.0
            dv = dr = dphi = dp = df = drear = 0.0
            for stage in range(4):
                share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # of the part
                later = (part + share) / parts  # share of the step
                kept = 1.0 - later
                d = kept * steer[k] + later * steer[end]
                forward = kept * speed[k] + later * speed[end]
                ground = kept * grip[k] + later * grip[end]
                step = share * width
                v1, r1, phi1, p1 = v + step * dv, r + step * dr, phi + step * dphi, p + step * dp

                d += e_roll * phi1
                soft = max(1.0 - k_load * shifted * shifted, 0.05) * ground
                cf, cr = stiff_f * soft, stiff_r * soft
                inv_speed = 1.0 / forward
                turn = r1 * inv_speed
                both = inv_speed * (1.0 + track * turn * turn)  # mean of 1/(V - s r) and 1/(V + s r)
                alpha_f = _angle((v1 + a * r1) * both) - d
                alpha_r = _angle((v1 - b * r1) * both) - e_rear * phi1
                if compliance != 0.0:
                    # the force that takes the angle away, by linear tyres: F = -C (alpha + compliance F)
                    alpha_f -= compliance * cf * alpha_f / (1.0 + compliance * cf)
                front = _tyre(alpha_f, cf, load_f, inv_load_f, inv_mu, half_bend, form)
                rear = _tyre(alpha_r, cr, load_r, inv_load_r, inv_mu, half_bend, form)
                if relaxed:
                    f1, rear1 = lag_f + step * df, lag_r + step * drear
                    rate = min(forward / sigma, FASTEST)
                    df, drear = rate * (front - f1), rate * (rear - rear1)
                    front, rear = f1, rear1
                front *= 1.0 - d * d * (0.5 - d * d / 24.0)
                side = front + rear + kept * fy[k] + later * fy[end]
                yaw = a * front - b * rear + kept * mz[k] + later * mz[end]
                yaw -= (yaw_damp + yaw_damp_v * inv_speed) * r1
                if roll:
                    torque = spring * phi1 - b_phi * p1 + kept * mx[k] + later * mx[end]
                    if t_roll != 0.0:
                        torque -= t_roll * tanh(p1 * inv_width)
                    # lateral acceleration v' + V r and p' of the first and third equation, r' of the second
                    dp = (torque + hm * side - twist * yaw) * inv_j
                    across = side * inv_m + hm * dp
                    dr = (yaw - ixz * dp) * inv_izz
                    dphi = p1
                else:
                    across = side * inv_m
                    dr = yaw * inv_izz
                dv = across - forward * r1

                if stage == 0 and part == 0:
                    y[k, 0], y[k, 1], y[k, 2], y[k, 3] = v, r, phi, p
                    y[k, 4], y[k, 5], y[k, 6] = across, dr, dp
                    shifted = (
                        across * inv_g
                    )  # the load that has moved: of the step's start, so no loop arises
                    if last:
                        break
                weight = width / 6.0 if stage in (0, 3) else width / 3.0
                sum_v += weight * dv
                sum_r += weight * dr
                sum_phi += weight * dphi
                sum_p += weight * dp
                sum_f += weight * df
                sum_rear += weight * drear
            v, r, phi, p = v + sum_v, r + sum_r, phi + sum_phi, p + sum_p
            lag_f, lag_r = lag_f + sum_f, lag_r + sum_rear
        # an unstable trial of a fit
        v = v if abs(v) < top_motion else 0.0
        r = r if abs(r) < top_motion else 0.0
        phi = phi if abs(phi) < top_motion else 0.0
        p = p if abs(p) < top_motion else 0.0
        lag_f = lag_f if abs(lag_f) < top_force else 0.0
        lag_r = lag_r if abs(lag_r) < top_force else 0.0
    return y


@njit(cache=True, nogil=True, fastmath=FAST)
def roll_only(across, yaw_rate_dot, mx, q, dt):  # type: ignore[no-untyped-def]
    """(n, 3): phi, p, p' of the sprung mass [rad, rad/s, rad/s^2].

    across (n,): given lateral acceleration [m/s^2]. yaw_rate_dot (n,): r' [rad/s^2]. mx (n,): added roll
    moment [N m]. q (26,): `VehicleNumbers`. dt: step [s].
    """
    n = across.size
    y = np.zeros((n, 3))
    phi = p = 0.0
    ms, h, g = q[AT.ms], q[AT.h], q[AT.g]
    j = q[AT.Ixx] + ms * h * h
    for k in range(n):
        end = min(k + 1, n - 1)
        sum_phi = sum_p = dphi = dp = 0.0
        for stage in range(4):
            later = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # share of the step
            kept = 1.0 - later
            phi1, p1 = phi + later * dt * dphi, p + later * dt * dp
            torque = (
                (ms * g * h - q[AT.k_phi]) * phi1 - q[AT.b_phi] * p1 - _dry(q[AT.T_roll], p1, q[AT.ln_width])
            )
            torque += kept * mx[k] + later * mx[end] + h * ms * (kept * across[k] + later * across[end])
            torque -= q[AT.Ixz] * (kept * yaw_rate_dot[k] + later * yaw_rate_dot[end])
            dphi, dp = p1, torque / j
            if stage == 0:
                y[k, 0], y[k, 1], y[k, 2] = phi, p, dp
            weight = dt / 6.0 if stage in (0, 3) else dt / 3.0
            sum_phi += weight * dphi
            sum_p += weight * dp
        phi, p = phi + sum_phi, p + sum_p
    return y


@njit(cache=True, nogil=True)
def lagged_over_ground(forward, across, r, lag, dt):  # type: ignore[no-untyped-def]
    """Lateral velocity (n,) m/s of a velocity that lags by `lag` [s] over ground.

    forward, across (n,): velocity in body axes [m/s]. r (n,): yaw rate [rad/s]. dt: step [s]. The lag is that
    of the trapezoidal rule, whose delay equals it; its state is kept in body axes, which turn by r dt.
    """
    out = np.empty(r.size)
    keep = (2.0 * lag - dt) / (2.0 * lag + dt)
    new = 0.5 * (1.0 - keep)
    x, y = forward[0], across[0]  # of the lagged velocity
    before_x, before_y = x, y  # of the velocity one step before
    out[0] = y
    for k in range(1, r.size):
        turn = 0.5 * (r[k - 1] + r[k]) * dt
        c, s = cos(turn), sin(turn)
        sum_x = keep * x + new * before_x
        sum_y = keep * y + new * before_y
        x = c * sum_x + s * sum_y + new * forward[k]
        y = c * sum_y - s * sum_x + new * across[k]
        before_x, before_y = forward[k], across[k]
        out[k] = y
    return out


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
