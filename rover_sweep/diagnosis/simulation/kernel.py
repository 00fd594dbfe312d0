"""Compiled loops of the simulation beside the single track: roll alone, lagged velocity, and the servo.

Axes ISO, SI units.
"""

from __future__ import annotations

from math import exp, sin, sqrt, tanh

import numpy as np
from numba import njit

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.diagnosis.simulation.single_track import AT, FAST, SGN_WIDTH


@njit(cache=True, nogil=True, fastmath=FAST)
def _dry(torque: float, p: float, ln_width: float) -> float:
    """Dry friction [N m] at the roll rate p [rad/s]; skips tanh when the friction is zero."""
    return torque * tanh(p / (SGN_WIDTH * exp(ln_width))) if torque != 0.0 else 0.0


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


@njit(cache=True, nogil=True, fastmath=FAST)
def _sine(angle: float) -> float:
    """sin(angle [rad]); its series below 0.2, where the series is exact to 3e-9."""
    if -0.2 < angle < 0.2:
        square = angle * angle
        return angle * (1.0 - square * (1.0 / 6.0 - square / 120.0))
    return sin(angle)


@njit(cache=True, nogil=True, fastmath=FAST)
def at_the_imu(body, place, errors, dt):  # type: ignore[no-untyped-def]
    """(a_y [m/s^2], V_y [m/s]), each (n,), that an IMU and its estimator show.

    body: V, v' + V r, weight, v, r, p, phi, r', p', each (n,), see `simulator.motion`. place: (x, z) of the
    IMU [m]. errors: (bias of a_y [m/s^2], relative error of V_y, error of the heading [rad], lag of V_y
    [s]). dt: step [s].

    The lag acts in earth axes, so in a turn it takes T V r from V_y as well. It is that of the trapezoidal
    rule, whose delay equals it; its state is kept in body axes, which turn by r dt.
    """
    speed, across, weight, v, r, p, phi, r_dot, p_dot = body
    ahead, above = place
    bias, gain, heading, lag = errors
    ay, vy = np.empty(r.size), np.empty(r.size)
    lags = lag > 1e-5
    keep = (2.0 * lag - dt) / (2.0 * lag + dt) if lags else 0.0
    new = 0.5 * (1.0 - keep)
    x = before_x = speed[0]  # of the lagged velocity, and of the velocity one step before
    y = before_y = v[0] + ahead * r[0] - above * p[0]
    for k in range(r.size):
        ay[k] = across[k] - weight[k] + ahead * r_dot[k] - above * p_dot[k] + GRAVITY * _sine(phi[k]) + bias
        side = v[k] + ahead * r[k] - above * p[k]
        if lags and k > 0:
            s = _sine(0.5 * (r[k - 1] + r[k]) * dt)
            c = sqrt(1.0 - s * s)
            sum_x, sum_y = keep * x + new * before_x, keep * y + new * before_y
            x = c * sum_x + s * sum_y + new * speed[k]
            y = c * sum_y - s * sum_x + new * side
            before_x, before_y = speed[k], side
        vy[k] = (y if lags else side) * (1.0 + gain) + speed[k] * heading
    return ay, vy


@njit(cache=True, nogil=True)
def padded_by_line(y, size):  # type: ignore[no-untyped-def]
    """y (n,) and a straight line back to its begin, (size,)."""
    out = np.empty(size)
    n = y.size
    out[:n] = y
    slope = (y[0] - y[n - 1]) / max(size - n - 1, 1)
    for k in range(size - n):
        out[n + k] = y[n - 1] + slope * k
    return out


@njit(cache=True, nogil=True)
def weigh_into(line, bins, weight, out):  # type: ignore[no-untyped-def]
    """Fill out (2 k,) with the real, then the imaginary parts of the bins (k,) of a spectrum, weighted."""
    k = bins.size
    for n in range(k):
        at = line[bins[n]]
        out[n], out[k + n] = at.real * weight[n], at.imag * weight[n]


@njit(cache=True, nogil=True)
def summed_with_loss(u, keep):  # type: ignore[no-untyped-def]
    """y (n,) with y[k] = keep y[k - 1] + u[k], from rest; keep: what a step leaves."""
    out = np.empty(u.size)
    y = 0.0
    for k in range(u.size):
        y = keep * y + u[k]
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
