"""Compiled loop of the simulation: the nonlinear single track with roll.

Axes ISO, SI units. v is the lateral velocity at the roll axis. The equations are (18) of the paper as
corrected, with nonlinear tyre slip angles:

    m (v' + V r) - h ms p'                      = Ff cos d + Fr + Fy
    Izz r' + Ixz p'                             = a Ff cos d - b Fr + Mz
    (Ixx + ms h^2) p' + Ixz r' - h ms (v' + V r) = (ms g h - k_phi) phi - b_phi p - T sgn p + Mx

A state and its slope are tuples (v, r, phi, p, lagging front force, lagging rear force).
"""

from __future__ import annotations

from math import atan, copysign, exp, pi, sin, sqrt, tan, tanh
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

SGN_WIDTH = 0.01  # rad/s, within which dry friction is smooth, times exp(ln_width)
FALLING = 1.6  # shape factor C of the magic formula; the force falls beyond its peak
FASTEST = 300.0  # 1/s, of the tyre relaxation; a faster one has no effect
FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}  # not nnan, ninf: a trial of a fit may overflow
STABLE, MOST_PARTS = 2.0, 12  # rate times step within which RK4 is stable; parts of a step
ROUNDS = 3  # of a law over the acceleration that it causes
TURN = 2.0 * pi
AT_REST = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class VehicleNumbers(NamedTuple):
    """Numbers of the single track with roll, SI units, ISO axes; an effect that is absent is 0.

    m, ms: mass and sprung mass. h: height of the sprung mass above the roll axis. Ixx, Izz, Ixz: inertia.
    a, b: CG to the front and to the rear axle. Cf, Cr: cornering stiffness. k_phi, b_phi: roll stiffness
    and damping. g: gravity. bend: third-order fall of the tyre force. inv_mu: 1 over the peak force per axle
    load. sigma: relaxation length. k_load: loss of stiffness at a_y = g. e_roll: steering
    angle per roll angle, e_rear the same of the rear axle. T_roll: dry friction torque. ln_width: ln of its
    smooth width over `SGN_WIDTH`. tyre_form: 0 tanh, 1 brush, 2 a falling peak, 3 a knee. yaw_damp [N m s]
    and yaw_damp_v [N m^2]: yaw moments -yaw_damp r and -yaw_damp_v r/V. compliance [rad/N]: angle of the
    front wheels lost per front side force. track [m^2]: square of the half track, by which the wheels of both
    sides differ in slip.
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
def tyre_force(alpha, c, load, inv_load, inv_mu, bend, form):  # type: ignore[no-untyped-def]
    """Side force [N]: -C alpha, reduced at third order (bend), saturating by a form (inv_mu)."""
    force = -c * alpha
    share = force * inv_load
    force = force / sqrt(1.0 + bend * share * share)
    if inv_mu > 1e-9:
        top = load / inv_mu
        if form == 1.0:
            z = min(abs(force) / (3.0 * top), 1.0)
            return copysign(top * z * (3.0 - z * (3.0 - z)), force)
        if form == 2.0:
            return top * sin(FALLING * atan(force / (FALLING * top)))
        if form == 3.0:
            square = (force / top) * (force / top)
            return force / (1.0 + square * square * square) ** (1.0 / 6.0)
        return top * tanh(force / top)
    return force


@njit(cache=True, nogil=True, fastmath=FAST)
def _angle(slope: float) -> float:
    """atan [rad]; below 0.2 by its series, which is exact to 1e-6 rad there."""
    if -0.2 < slope < 0.2:
        square = slope * slope
        return slope * (1.0 - square * (1.0 / 3.0 - square * (0.2 - square / 7.0)))
    return atan(slope)


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def _constants(q, roll):  # type: ignore[no-untyped-def]
    """The numbers that a slope needs, as locals: in an array that may overlap with the output, each step
    took four times as long."""
    m, ms, h, a, b, g = q[AT.m], q[AT.ms], q[AT.h], q[AT.a], q[AT.b], q[AT.g]
    inv_izz, ixz, hm = 1.0 / q[AT.Izz], q[AT.Ixz], h * ms / m
    twist = ixz * inv_izz
    load_f, load_r = m * g * b / (a + b), m * g * a / (a + b)
    j = q[AT.Ixx] + ms * h * h - hm * h * ms - ixz * twist
    inv_j = 1.0 / j if roll else 0.0  # 0 where the vehicle file has no roll
    spring, inv_width = ms * g * h - q[AT.k_phi], 1.0 / (SGN_WIDTH * exp(q[AT.ln_width]))
    body = a, b, 1.0 / m, inv_izz, ixz, hm, twist, inv_j, spring, q[AT.b_phi], q[AT.T_roll], inv_width
    tyres = q[AT.Cf], q[AT.Cr], load_f, load_r, 1.0 / load_f, 1.0 / load_r, q[AT.inv_mu], q[AT.bend]
    laws = q[AT.tyre_form], q[AT.k_load], q[AT.e_roll], q[AT.e_rear], q[AT.compliance], q[AT.track]
    return body, tyres, laws, (q[AT.yaw_damp], q[AT.yaw_damp_v], q[AT.sigma])


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def _fastest(constants, stiff_f, stiff_r):  # type: ignore[no-untyped-def]
    """(pole of the rigid tyres times the speed [m/s^2], pole of dry friction about rest [1/s])."""
    a, b, inv_m, inv_izz, _, _, _, inv_j, _, _, t_roll, inv_width = constants[0]
    rigid = (stiff_f + stiff_r) * inv_m + (a * a * stiff_f + b * b * stiff_r) * inv_izz
    return rigid, t_roll * inv_width * inv_j


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def _parts(speed, fastest, sigma, relaxed, dt):  # type: ignore[no-untyped-def]
    """Parts of the step dt [s] in which the fastest pole is stable, at most `MOST_PARTS`."""
    rate = fastest[0] / speed + fastest[1] + (min(speed / sigma, FASTEST) if relaxed else 0.0)
    wanted = rate * dt / STABLE
    return int(wanted) + 1 if wanted < MOST_PARTS else MOST_PARTS


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def _plus(x, step, dx):  # type: ignore[no-untyped-def]
    return (
        x[0] + step * dx[0],
        x[1] + step * dx[1],
        x[2] + step * dx[2],
        x[3] + step * dx[3],
        x[4] + step * dx[4],
        x[5] + step * dx[5],
    )


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def _finite(x, top_force):  # type: ignore[no-untyped-def]
    """The state, set to 0 if an unstable trial of a fit diverged."""
    return (
        x[0] if abs(x[0]) < 1e3 else 0.0,
        x[1] if abs(x[1]) < 1e3 else 0.0,
        x[2] if abs(x[2]) < 1e3 else 0.0,
        x[3] if abs(x[3]) < 1e3 else 0.0,
        x[4] if abs(x[4]) < top_force else 0.0,
        x[5] if abs(x[5]) < top_force else 0.0,
    )


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def _between(now, then, later):  # type: ignore[no-untyped-def]
    """Value at the share `later` of a step."""
    return (1.0 - later) * now + later * then


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def _slope(c, given, x, shifted, roll, relaxed):  # type: ignore[no-untyped-def]
    """(slope of the state x, v' + V r). given: steering angle, speed, grip, Fy, Mz and Mx of the instant.

    shifted: lateral acceleration over g at the start of the step, for the load transfer.
    """
    a, b, inv_m, inv_izz, ixz, hm, twist, inv_j, spring, b_phi, t_roll, inv_width = c[0]
    stiff_f, stiff_r, load_f, load_r, inv_load_f, inv_load_r, inv_mu, bend = c[1]
    form, k_load, e_roll, e_rear, compliance, track = c[2]
    yaw_damp, yaw_damp_v, sigma = c[3]
    v, r, phi, p, lag_f, lag_r = x
    d, forward, ground, fy, mz, mx = given
    d += e_roll * phi
    soft = max(1.0 - k_load * shifted * shifted, 0.05) * ground
    cf, cr = stiff_f * soft, stiff_r * soft
    inv_speed = 1.0 / forward
    turn = r * inv_speed
    both = inv_speed * (1.0 + track * turn * turn)  # mean of 1/(V - s r) and 1/(V + s r)
    alpha_f = _angle((v + a * r) * both) - d
    alpha_r = _angle((v - b * r) * both) - e_rear * phi
    if compliance != 0.0:
        # the force that takes the angle away, by linear tyres: F = -C (alpha + compliance F)
        alpha_f -= compliance * cf * alpha_f / (1.0 + compliance * cf)
    front = tyre_force(alpha_f, cf, load_f, inv_load_f, inv_mu, bend, form)
    rear = tyre_force(alpha_r, cr, load_r, inv_load_r, inv_mu, bend, form)
    df = drear = 0.0
    if relaxed:
        rate = min(forward / sigma, FASTEST)
        df, drear = rate * (front - lag_f), rate * (rear - lag_r)
        front, rear = lag_f, lag_r
    front *= 1.0 - d * d * (0.5 - d * d / 24.0)
    side = front + rear + fy
    yaw = a * front - b * rear + mz
    yaw -= (yaw_damp + yaw_damp_v * inv_speed) * r
    across = side * inv_m
    dphi = dp = 0.0
    if roll:
        torque = spring * phi - b_phi * p + mx
        if t_roll != 0.0:
            torque -= t_roll * tanh(p * inv_width)
        # lateral acceleration v' + V r and p' of the first and third equation, r' of the second
        dp = (torque + hm * side - twist * yaw) * inv_j
        across += hm * dp
        dphi = p
    dr = (yaw - ixz * dp) * inv_izz
    return (across - forward * r, dr, dphi, dp, df, drear), across


@njit(cache=True, nogil=True, fastmath=FAST)
def single_tracks(one, other, relaxed, roll, dt):  # type: ignore[no-untyped-def]
    """Two motions (7, n) in the rows v, r, phi, p, v' + V r, r', p'; SI units, RK4 of step dt [s].

    one, other: (steer, speed, grip, fy, mz, mx, q), whose lengths n may differ. steer (n,): road-wheel angle
    [rad]. speed (n,): V [m/s]. grip (n,): factor of both axles' stiffness. fy, mz, mx (n,): added side force
    [N], yaw moment and roll moment [N m]. q (26,): `VehicleNumbers`. relaxed: (bool, bool), the tyre forces
    lag by the relaxation length. roll: False holds phi and p at 0.

    A step is a chain in which each operation waits for the last one; two such chains side by side take the
    processor no longer than one does. Arrays are not handed to the functions of a step, since each would
    count their references.
    """
    steer1, speed1, grip1, fy1, mz1, mx1, q1 = one
    steer2, speed2, grip2, fy2, mz2, mx2, q2 = other
    c1, c2 = _constants(q1, roll), _constants(q2, roll)
    fastest1, fastest2 = _fastest(c1, c1[1][0], c1[1][1]), _fastest(c2, c2[1][0], c2[1][1])
    top1, top2 = 1e3 * q1[AT.m] * q1[AT.g], 1e3 * q2[AT.m] * q2[AT.g]
    inv_g = 1.0 / q1[AT.g]
    n1, n2 = steer1.size, steer2.size
    y1, y2 = np.zeros((7, n1)), np.zeros((7, n2))
    x1 = x2 = AT_REST
    shifted1 = shifted2 = 0.0
    for k in range(max(n1, n2)):
        k1, k2 = min(k, n1 - 1), min(k, n2 - 1)
        end1, end2 = min(k + 1, n1 - 1), min(k + 1, n2 - 1)
        parts1 = _parts(speed1[k1], fastest1, c1[3][2], relaxed[0], dt)
        parts2 = _parts(speed2[k2], fastest2, c2[3][2], relaxed[1], dt)
        inv_parts1, inv_parts2 = 1.0 / parts1, 1.0 / parts2
        for part in range(max(parts1, parts2)):
            sum1 = dx1 = sum2 = dx2 = AT_REST
            for stage in range(4):
                share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # of the part
                weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
                if part < parts1:
                    later, width = (part + share) * inv_parts1, dt * inv_parts1
                    x = _plus(x1, share * width, dx1)
                    given = (
                        _between(steer1[k1], steer1[end1], later),
                        _between(speed1[k1], speed1[end1], later),
                        _between(grip1[k1], grip1[end1], later),
                        _between(fy1[k1], fy1[end1], later),
                        _between(mz1[k1], mz1[end1], later),
                        _between(mx1[k1], mx1[end1], later),
                    )
                    dx1, across1 = _slope(c1, given, x, shifted1, roll, relaxed[0])
                    sum1 = _plus(sum1, weight * width, dx1)
                    if stage == 0 and part == 0 and k < n1:
                        y1[0, k], y1[1, k], y1[2, k], y1[3, k] = x1[0], x1[1], x1[2], x1[3]
                        y1[4, k], y1[5, k], y1[6, k] = across1, dx1[1], dx1[3]
                        shifted1 = across1 * inv_g
                if part < parts2:
                    later, width = (part + share) * inv_parts2, dt * inv_parts2
                    x = _plus(x2, share * width, dx2)
                    given = (
                        _between(steer2[k2], steer2[end2], later),
                        _between(speed2[k2], speed2[end2], later),
                        _between(grip2[k2], grip2[end2], later),
                        _between(fy2[k2], fy2[end2], later),
                        _between(mz2[k2], mz2[end2], later),
                        _between(mx2[k2], mx2[end2], later),
                    )
                    dx2, across2 = _slope(c2, given, x, shifted2, roll, relaxed[1])
                    sum2 = _plus(sum2, weight * width, dx2)
                    if stage == 0 and part == 0 and k < n2:
                        y2[0, k], y2[1, k], y2[2, k], y2[3, k] = x2[0], x2[1], x2[2], x2[3]
                        y2[4, k], y2[5, k], y2[6, k] = across2, dx2[1], dx2[3]
                        shifted2 = across2 * inv_g
            if part < parts1:
                x1 = _plus(x1, 1.0, sum1)
            if part < parts2:
                x2 = _plus(x2, 1.0, sum2)
        x1, x2 = _finite(x1, top1), _finite(x2, top2)
    return y1, y2


NO_LAW, TABLE, LAG, RESONATOR = -1, 0, 1, 2  # what a law does with a quantity of the state


class LawNumbers(NamedTuple):
    """Numbers of m laws that act on the body, see `table_law.TableLaw`.

    push (m, 3): side force, yaw and roll moment per y. given (m, n): known factor of y. kind (m,): NO_LAW
    where y depends on nothing but `given`. over, times (m,): index in (v' + V r, r, p, phi, beta) of the
    quantity, and of a factor, -1 for none. memory (m, 2): size, damping. x, y (m, k): the table; of a
    resonator, y[0] and y[1].
    """

    push: Any
    given: Any
    kind: Any
    over: Any
    times: Any
    memory: Any
    x: Any
    y: Any


@njit(cache=True, nogil=True, fastmath=FAST)
def _read(x, y, at):  # type: ignore[no-untyped-def]
    """The table y (k,) over x (k,) at a value, linear between its points, constant beyond."""
    if not at > x[0]:
        return y[0]
    for k in range(1, x.size):
        if at < x[k]:
            return y[k] + (at - x[k]) * (y[k] - y[k - 1]) / (x[k] - x[k - 1])
    return y[x.size - 1]


@njit(cache=True, nogil=True, fastmath=FAST)
def _forces_of_laws(laws, kept, across, x, speed, k, top):  # type: ignore[no-untyped-def]
    """(Fy, Mz, Mx) of the laws in a state x at the k-th sample, none beyond top; kept (m, 3): memories."""
    fy = mz = mx = 0.0
    state = (across, x[1], x[3], x[2], x[0] / speed)
    for j in range(laws.kind.size):
        value = laws.given[j, k]
        if laws.kind[j] == RESONATOR:
            value *= laws.y[j, 0] * kept[j, 0] + laws.y[j, 1] * kept[j, 1]
        elif laws.kind[j] != NO_LAW:
            quantity = state[laws.over[j]] - (kept[j, 0] if laws.kind[j] == LAG else 0.0)
            value *= _read(laws.x[j], laws.y[j], quantity)
        if laws.times[j] >= 0:
            value *= state[laws.times[j]]
        fy += laws.push[j, 0] * value
        mz += laws.push[j, 1] * value
        mx += laws.push[j, 2] * value
    return min(max(fy, -top), top), min(max(mz, -top), top), min(max(mx, -top), top)


@njit(cache=True, nogil=True, fastmath=FAST)
def _remember(laws, kept, across, x, speed, dt):  # type: ignore[no-untyped-def]
    """One sample on: kept (m, 3), a lagged quantity, or u, u'/w and the quantity of a resonator."""
    state = (across, x[1], x[3], x[2], x[0] / speed)
    for j in range(laws.kind.size):
        size, damping = laws.memory[j]
        if laws.kind[j] == LAG:
            kept[j, 0] += (1.0 - exp(-dt / size)) * (state[laws.over[j]] - kept[j, 0])
        elif laws.kind[j] == RESONATOR:
            # the trapezoidal rule, exact at the frequency
            half = tan(0.5 * TURN * size * dt)
            u, rate, before = kept[j, 0], kept[j, 1], kept[j, 2]
            now = state[laws.over[j]]
            new = rate * (1.0 - 2.0 * damping * half - half * half) + half * (now + before - 2.0 * u)
            new /= 1.0 + 2.0 * damping * half + half * half
            new = new if abs(new) < 1e6 else 0.0  # an unstable trial of a fit
            kept[j, 0], kept[j, 1], kept[j, 2] = u + half * (rate + new), new, now


@njit(cache=True, nogil=True, fastmath=FAST)
def single_track_with_laws(drive, laws, relaxed, roll, dt):  # type: ignore[no-untyped-def]
    """One motion as in `single_tracks`, with laws that act on the body.

    A memory holds the last sample. A law over v' + V r also changes it, so it is evaluated `ROUNDS` times.
    """
    steer, speed, grip, given_fy, given_mz, given_mx, q = drive
    c = _constants(q, roll)
    fastest = _fastest(c, c[1][0], c[1][1])
    top, inv_g = 1e3 * q[AT.m] * q[AT.g], 1.0 / q[AT.g]
    n = steer.size
    y = np.zeros((7, n))
    kept = np.zeros((laws.kind.size, 3))
    x = AT_REST
    across = recent = 0.0
    around = np.any(laws.over == 0) or np.any(laws.times == 0)
    for k in range(n):
        end = min(k + 1, n - 1)
        parts = _parts(speed[k], fastest, c[3][2], relaxed, dt)
        inv_parts = 1.0 / parts
        width = dt * inv_parts
        for part in range(parts):
            total = dx = AT_REST
            for stage in range(4):
                share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # of the part
                later, weight = (part + share) * inv_parts, 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
                at = _plus(x, share * width, dx)
                forward = _between(speed[k], speed[end], later)
                for _ in range(ROUNDS if around else 1):
                    fy, mz, mx = _forces_of_laws(laws, kept, recent, at, forward, k, top)
                    given = (
                        _between(steer[k], steer[end], later),
                        forward,
                        _between(grip[k], grip[end], later),
                        _between(given_fy[k], given_fy[end], later) + fy,
                        _between(given_mz[k], given_mz[end], later) + mz,
                        _between(given_mx[k], given_mx[end], later) + mx,
                    )
                    dx, recent = _slope(c, given, at, across * inv_g, roll, relaxed)
                total = _plus(total, weight * width, dx)
                if stage == 0 and part == 0:
                    y[0, k], y[1, k], y[2, k], y[3, k] = x[0], x[1], x[2], x[3]
                    y[4, k], y[5, k], y[6, k] = recent, dx[1], dx[3]
                    across = recent
            x = _plus(x, 1.0, total)
        x = _finite(x, top)
        _remember(laws, kept, across, (y[0, k], y[1, k], y[2, k], y[3, k]), speed[k], dt)
    return y


def must_compile(loop: Any = single_tracks) -> bool:
    """True if the next run compiles (once per machine); False also if numba does not tell."""
    try:
        return not Path(loop._cache._cache_file._index_path).is_file()
    except AttributeError:  # another version of numba
        return False
