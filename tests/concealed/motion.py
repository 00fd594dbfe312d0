"""The rover's motion: nonlinear single track with roll, classical Runge-Kutta at 1 kHz, compiled by numba.

State: V_y at the roll axis, r, phi, p, V, psi, north, west, F_f, F_r (used with tyre relaxation), q, q'
(a resonance, out of the library). Equations, with s, c = sin, cos phi and c_d the bank of the ground:
  m (V_y' + V r) + m_s h (s p^2 - c phi'') = F_f cos d + F_r - m g bank
  (I_xx + m_s h^2) phi'' = m_s h c (V_y' + V r + g bank) + m_s g h s - k_phi phi - b_phi p - T sgn p
  I_zz r' = a F_f cos d - b F_r + M
Tyres without a concealed effect: F = C alpha (1 + (C alpha / (mu F_z))^4)^(-1/4), linear to fourth order.
Concealed saturation: F = C alpha (1 + 2/3 x^2)^(-1/2), x = C alpha / (mu F_z): tanh to third order.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP = 1e-3
NAMES = (
    "m",
    "ms",
    "a",
    "b",
    "h",
    "izz",
    "ixx",
    "k_phi",
    "b_phi",
    "cf",
    "cr",
    "friction",
    "sigma",
    "mu",
    "load_transfer",
    "roll_steer",
    "dry_friction",
    "drag",
    "motor_lag",
    "change_ratio",
    "change_time",
    "slope",
    "slope_heading",
    "scrub",
    "scrub_threshold",
    "flex_gain",
    "flex_w",
    "flex_zeta",
    "wind",
    "wind_heading",
)
(
    M,
    MS,
    A,
    B,
    H,
    IZZ,
    IXX,
    KPHI,
    BPHI,
    CF,
    CR,
    FRICTION,
    SIGMA,
    MU,
    TRANSFER,
    ROLL_STEER,
    DRY,
    DRAG,
    MOTOR,
    RATIO,
    CHANGE,
    SLOPE,
    SLOPE_HEADING,
    SCRUB,
    THRESHOLD,
    FLEX,
    FLEX_W,
    FLEX_Z,
    WIND,
    WIND_HEADING,
) = range(len(NAMES))
G = 9.81
SIZE = 12
ABSENT = {"mu": 0.0, "change_ratio": 1.0, "flex_w": 9.0, "flex_zeta": 0.1, "motor_lag": 0.5}
compiled: Any = numba.njit(cache=True, fastmath=False)


def vector(values: dict[str, float]) -> Array:
    """The parameters in the order of NAMES; what is not given is absent."""
    unknown = set(values) - set(NAMES)
    if unknown:
        raise ValueError(f"no such parameters of the motion: {sorted(unknown)}")
    return np.array([values.get(name, ABSENT.get(name, 0.0)) for name in NAMES])


@compiled
def tyre(stiffness: float, slip: float, load: float, friction: float, mu: float) -> float:
    """Side force [N] of an axle; mu 0: no concealed saturation."""
    force = stiffness * slip
    if mu > 0.0:
        x = force / (mu * load)
        return force / math.sqrt(1.0 + 2.0 / 3.0 * x * x)
    x = force / (friction * load)
    return force / (1.0 + x**4) ** 0.25


@compiled
def _rates(
    x: Array, q: Array, t: float, delta: float, ay: float, push: Array, speed_set: float, out: Array
) -> float:
    """Fills `out` with x'; returns V_y' + V r. push: front force, rear force, roll moment, throttle."""
    vy, r, phi, p, v = x[0], x[1], x[2], x[3], x[4]
    wheelbase = q[A] + q[B]
    scale = 1.0 - q[TRANSFER] * (ay / G) ** 2
    if t >= q[CHANGE] and q[RATIO] != 1.0:
        scale *= q[RATIO]
    d = (delta + q[ROLL_STEER] * phi) * min(1.0, abs(v) / 0.3)  # turned wheels that stand turn nothing
    forward = max(v, 0.3)
    slip_f, slip_r = d - math.atan2(vy + q[A] * r, forward), -math.atan2(vy - q[B] * r, forward)
    weight = q[M] * G
    ff0 = tyre(q[CF] * scale, slip_f, weight * q[B] / wheelbase, q[FRICTION], q[MU])
    fr0 = tyre(q[CR] * scale, slip_r, weight * q[A] / wheelbase, q[FRICTION], q[MU])
    if q[SIGMA] > 0.0:
        ff, fr = x[8], x[9]
        out[8], out[9] = (ff0 - ff) * forward / q[SIGMA], (fr0 - fr) * forward / q[SIGMA]
    else:
        ff, fr = ff0, fr0
        out[8], out[9] = 0.0, 0.0
    back = ff * math.sin(d) / q[M] - vy * r  # what turned wheels take of the speed
    ff, fr = ff * math.cos(d) + push[0], fr + push[1]
    bank = q[SLOPE] * math.cos(x[5] - q[SLOPE_HEADING])
    s, c = math.sin(phi), math.cos(phi)
    msh = q[MS] * q[H]
    side = ff + fr - q[M] * G * bank - msh * s * p * p
    moment = msh * G * (s + c * bank) - q[KPHI] * phi - q[BPHI] * p - q[DRY] * math.tanh(p / 0.01) + push[2]
    about = q[IXX] + msh * q[H]
    det = q[M] * about - (msh * c) ** 2
    lateral = (about * side + msh * c * moment) / det
    roll = (msh * c * side + q[M] * moment) / det
    yaw = q[A] * ff - q[B] * fr + _strange_moment(x, q, lateral, out)
    out[0], out[1], out[2], out[3] = lateral - v * r, yaw / q[IZZ], p, roll
    out[4] = (speed_set - v) / q[MOTOR] - back - q[DRAG] * lateral * lateral + push[3]
    out[5] = r
    out[6] = v * math.cos(x[5]) - vy * math.sin(x[5])
    out[7] = v * math.sin(x[5]) + vy * math.cos(x[5])
    return lateral


@compiled
def _strange_moment(x: Array, q: Array, lateral: float, out: Array) -> float:
    """Yaw moment [N m] of the effects out of the library; the resonance's derivatives go into out[10:12]."""
    out[10] = x[11]
    out[11] = q[FLEX_W] ** 2 * (lateral - x[10]) - 2.0 * q[FLEX_Z] * q[FLEX_W] * x[11]
    moment = q[FLEX] * x[10] + q[WIND] * math.sin(x[5] - q[WIND_HEADING]) * min(1.0, x[4])
    beyond = abs(x[1]) - q[THRESHOLD]
    if beyond > 0.0:
        moment -= q[SCRUB] * beyond * math.copysign(1.0, x[1])
    return moment


@compiled
def drive(q: Array, delta: Array, speed_set: Array, push: Array, heading: float) -> Array:
    """States and their derivatives over time, (n, 24): x in [:12], x' in [12:].

    delta (n,) road-wheel angle [rad], speed_set (n,) [m/s], push (n, 4), each on the clock of STEP.
    """
    n = delta.size
    out = np.zeros((n, 2 * SIZE))
    x = np.zeros(SIZE)
    x[5] = heading
    k1, k2, k3, k4 = np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE)
    ay = 0.0
    for k in range(n):
        t = k * STEP
        nxt = min(k + 1, n - 1)
        middle, aim = 0.5 * (delta[k] + delta[nxt]), speed_set[k]
        ay_now = _rates(x, q, t, delta[k], ay, push[k], aim, k1)
        out[k, :SIZE] = x
        out[k, SIZE:] = k1
        _rates(x + 0.5 * STEP * k1, q, t, middle, ay, push[k], aim, k2)
        _rates(x + 0.5 * STEP * k2, q, t, middle, ay, push[k], aim, k3)
        _rates(x + STEP * k3, q, t, delta[nxt], ay, push[k], aim, k4)
        x = x + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        ay = ay_now
    return out


@compiled
def servo(
    u: Array, lag: float, second: float, rate: float, deadband: float, gap: float, cubic: float, uneven: float
) -> Array:
    """Road-wheel angle (n,) [rad] behind servo and linkage, from the command u (n,) [rad].

    Two real lags in a row, lag + second [s] in all (the second only smooths); rate [rad/s] bounds the
    slope; then the linkage: deadband half width, backlash half gap, cubic term, left/right unevenness.
    """
    out = np.empty(u.size)
    slow = fast = held = 0.0
    toward, smooth = 1.0 - math.exp(-STEP / lag), 1.0 - math.exp(-STEP / second)
    for k in range(u.size):
        fast += smooth * (u[k] - fast)
        move = toward * (fast - slow)
        slow += min(max(move, -rate * STEP), rate * STEP)
        d = slow
        if deadband > 0.0:
            d = math.copysign(max(abs(d) - deadband, 0.0), d)
        if gap > 0.0:
            held = min(max(held, d - gap), d + gap)
            d = held
        d *= 1.0 + cubic * d * d
        out[k] = d * (1.0 + uneven if d > 0.0 else 1.0 - uneven)
    return out
