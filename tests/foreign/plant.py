"""The foreign plant: the numbers of a rover, tyres, chassis, steering, and their integration at 1 kHz.

All compiled functions are in this file, so that numba's cache sees each change.

`Numbers` is a NamedTuple of floats, so that one kernel is compiled for every rover. A size of zero switches
its law off. A field that ends in `form` chooses among forms of one law.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray


class Numbers(NamedTuple):
    """SI units, ISO 8855 axes; angles are road-wheel angles. The defaults switch every effect off."""

    # body, axles and suspension
    m: float
    ms: float  # sprung mass, CG at height h above the roll axis
    a: float
    b: float
    track: float
    Izz: float
    Ixx: float  # sprung mass about its own CG
    h: float
    kphi: float
    bphi: float
    roll_axis: float  # height above the ground; loads the wheels directly
    Cf: float  # N/rad of an axle
    Cr: float
    ackermann: float  # 0: parallel steering, 1: Ackermann's angles
    # servo: w = clip(gain (target - angle), rate), motor_lag w' = ...
    gain: float  # 1/s
    motor_lag: float  # s
    rate: float  # rad/s
    rate_form: float
    # drive
    tau_drive: float  # s
    most_drive: float  # m/s^2
    rolling: float  # rolling resistance over weight
    # steering effects
    trim: float = 0.0
    deadband: float = 0.0
    deadband_form: float = 0.0
    stiction: float = 0.0
    stiction_form: float = 0.0
    play: float = 0.0
    play_form: float = 0.0
    play_tau: float = 0.5
    curve: float = 0.0
    curve_form: float = 0.0
    asymmetry: float = 0.0
    asymmetry_form: float = 0.0
    speed_gain: float = 0.0
    speed_ref: float = 1.0
    resonance_w: float = 0.0
    resonance_z: float = 0.15
    compliance: float = 0.0
    compliance_form: float = 0.0
    compliance_lag: float = 0.004  # s: a linkage yields at once
    rear_share: float = 0.0
    roll_steer_front: float = 0.0
    roll_steer_rear: float = 0.0
    # tyres
    tyre_form: float = 0.0
    mu: float = 10.0
    load_form: float = 0.0
    load_k: float = 0.0
    sigma: float = 0.0
    sigma_form: float = 0.0
    tyre_dead_zone: float = 0.0
    tyre_left_right: float = 0.0
    slip_speed: float = 0.0  # stiffness goes with the speed over speed_ref to this power
    lift: float = 0.0  # factor on the load transfer of an axle whose inner wheel lifts
    lift_form: float = 0.0
    # moments on the body
    yaw_c: float = 0.0
    diff_c: float = 0.0
    yaw_c2: float = 0.0
    friction: float = 0.0
    friction_form: float = 0.0
    bump: float = 0.0  # rad: roll at which the stops touch
    bump_k: float = 0.0  # N m/rad beyond it
    wind_x: float = 0.0  # centre of pressure ahead of the CG
    wind_z: float = 0.0  # and above the roll axis
    # ground
    slope: float = 0.0
    slope_heading: float = 0.0  # downhill
    # loose load: a share of the mass that moves across the rover
    loose: float = 0.0
    loose_form: float = 0.0
    loose_w: float = 8.0
    loose_z: float = 0.15


# ---- Side force of one wheel from its slip angle.
# Forms (tyre_form): 0 linear; 1 Fiala, the brush with parabolic pressure (Fiala 1954; Pacejka 2012, 3.1); 2
# Magic Formula with a shape factor of 1.6, which falls past its peak (Pacejka 2012, 4.E1); 3 tanh; 4 Dugoff
# (Dugoff et al. 1970); 5 arctangent; 6 exponential.
# load_form: how the stiffness follows the wheel load: 1 a parabola, 2 a power law, 3 sin(2 atan) (Pacejka
# 2012, 4.E25), 4 none of it is lost down to half of the nominal load, all where the wheel lifts.

SHAPE = 1.6


@njit(cache=True)
def side_force(alpha: float, stiffness: float, limit: float, form: float) -> float:
    """Side force [N] against the slip angle `alpha` [rad]: odd, slope -stiffness at zero, below `limit`."""
    s = math.tan(max(-1.4, min(1.4, alpha)))
    z = stiffness * abs(s) / limit
    if form == 0.0:
        return -stiffness * alpha
    if form == 1.0:
        share = z - z * z / 3 + z * z * z / 27 if z < 3.0 else 1.0
    elif form == 2.0:
        share = math.sin(SHAPE * math.atan(z / SHAPE))
    elif form == 3.0:
        share = math.tanh(z)
    elif form == 4.0:
        share = z if z < 0.5 else 1.0 - 0.25 / z
    elif form == 5.0:
        share = 2 / math.pi * math.atan(math.pi / 2 * z)
    else:
        share = 1.0 - math.exp(-z)
    return -math.copysign(limit * share, alpha)


@njit(cache=True)
def load_factor(load: float, nominal: float, k: float, form: float) -> float:
    """Stiffness at a wheel load over that at the nominal load, 1 at the nominal load, 0 at zero load."""
    f = max(load, 0.0) / nominal
    if form == 1.0:
        return max(0.0, f - k * (f - 1.0) ** 2) if f < 1.0 + 0.5 / max(k, 1e-9) else 1.0 + 0.25 / max(k, 1e-9)
    if form == 2.0:
        return f ** (1.0 - k)
    if form == 3.0:
        c = 1.0 / max(k, 1e-9)  # load of the largest stiffness, over the nominal load
        return math.sin(2 * math.atan(f / c)) / math.sin(2 * math.atan(1.0 / c))
    if form == 4.0:
        return min(1.0, 2 * f)
    return 1.0


@njit(cache=True)
def dead_zone(alpha: float, half: float) -> float:
    """The slip angle beyond a zone without force."""
    return math.copysign(max(abs(alpha) - half, 0.0), alpha)


# ---- Equations of motion: an unsprung frame on four wheels that carries a body rolling about a fixed axis.
# Lagrange's equations with finite roll angles. Coordinates: velocities u (forward), v (left) of the point of
# the roll axis below the CG and yaw rate r, in the frame that yaws and does not roll; roll angle phi,
# positive where the left side rises. The CG of the body lies at y = -h sin(phi), z = h cos(phi).
# state: 0 u, 1 v, 2 r, 3 phi, 4 phi', 5 heading, 6 to 9 slip angle or force share of each wheel that lags, 10
# and 11 place and speed of the loose load (left).
# loose_form 0 on a spring beside the CG, 1 a pendulum that hangs from the CG, 2 on a bed at its height
# with dry friction, between stops. lift_form 0 front axle, 1 rear axle.

Array = NDArray[np.float64]
STATES = 12
GRAVITY = 9.81
BED_FRICTION, BED_WAY, STOP_W = 0.12, 0.12, 60.0  # of a sliding load; its way in tracks; rad/s
CREEP = 0.1  # m/s: below it tyres resist in proportion to the sliding speed
# columns of a step's surroundings
SURFACE, SHIFT, WIND_X, WIND_Y, ROAD_Y, ROAD_YAW, ROAD_ROLL = range(7)


@njit(cache=True)
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


@njit(cache=True)
def _wheel_angle(k: int, delta: float, phi: float, left: float, base: float, n: Numbers) -> float:
    if k >= 2:
        return n.roll_steer_rear * phi + n.rear_share * delta
    # Ackermann: cot(outer) - cot(inner) = track / base, here to second order
    return delta * (1.0 + n.ackermann * delta * left / base) + n.roll_steer_front * phi


@njit(cache=True)
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


@njit(cache=True)
def bump_moment(phi: float, n: Numbers) -> float:
    """Roll moment [N m] of the stops, against phi."""
    if n.bump <= 0.0:
        return 0.0
    return n.bump_k * math.copysign(max(abs(phi) - n.bump, 0.0), phi)


@njit(cache=True)
def _dry(p: float, n: Numbers) -> float:
    """Friction moment in the suspension. Forms: 0 tanh, 1 Stribeck (more at rest), 2 progressive, sqrt."""
    if n.friction <= 0.0:
        return 0.0
    if n.friction_form == 1.0:
        return n.friction * math.tanh(p / 0.01) * (1.0 + 0.5 * math.exp(-((p / 0.05) ** 2)))
    if n.friction_form == 2.0:
        return n.friction * p / math.sqrt(p * p + 0.03**2)
    return n.friction * math.tanh(p / 0.02)


# ---- From the delayed command to the road-wheel angle, once per step of the integrator.
#
# state: 0 servo angle, 1 servo rate, 2 held target, 3 moving, 4 angle behind the play, 5 Bouc-Wen's z, 6 and
# 7 resonant linkage, 8 angle lost to compliance. Forms: deadband 0 offset beyond the zone, 1 jump at its
# edge, 2 soft, w tanh(e/w). stiction 0 the target is held until the command has moved by s, then follows all
# the way; 1 with memory: the servo starts at an error of s and goes on until it has arrived; 2 without
# memory: it drives only at an error above s. play 0 the play operator, 1 with a spring that draws the wheel
# to the middle of the gap, 2 Bouc-Wen, 3 Dahl. curve 0 cubic, 1 crank and rod, sin, 2 exponent of the
# transmitter, 3 tanh. asymmetry 0 two gains, 1 quadratic. rate 0 a limit, 1 a motor that weakens with its
# speed, tanh. compliance 0 in proportion to the front side force, 1 to its moment about the steering axis
# with a pneumatic trail that vanishes as the tyre slides.

STEERING_STATES = 9


@njit(cache=True)
def steering_step(
    state: NDArray[np.float64],
    u: float,
    speed: float,
    front_force: float,
    front_slip: float,
    n: Numbers,
    dt: float,
) -> float:
    """Advances `state` by `dt` and returns the road-wheel angle [rad]."""
    target = _without_deadband(u - n.trim, n.deadband, n.deadband_form)
    target = _after_stiction(state, target, n)
    wanted = _limited(n.gain * (target - state[0]), n)
    if n.stiction > 0.0 and n.stiction_form > 0.0 and state[3] == 0.0:
        wanted = 0.0
    state[1] += dt / n.motor_lag * (wanted - state[1])
    before = state[0]
    state[0] += dt * state[1]
    angle = _after_play(state, before, n, dt)
    angle = _bent(angle, n) * (1.0 - n.speed_gain * (speed - n.speed_ref) / n.speed_ref)
    if n.resonance_w > 0.0:
        state[7] += dt * (
            n.resonance_w**2 * (angle - state[6]) - 2 * n.resonance_z * n.resonance_w * state[7]
        )
        state[6] += dt * state[7]
        angle = state[6]
    if n.compliance > 0.0:
        lever = 1.0
        if n.compliance_form == 1.0:
            lever = 0.5 + 0.5 * max(0.0, 1.0 - abs(front_slip) / 0.25)
        state[8] += dt / n.compliance_lag * (n.compliance * lever * front_force - state[8])
        angle -= state[8]
    return angle


@njit(cache=True)
def _limited(wanted: float, n: Numbers) -> float:
    if n.rate_form == 1.0:
        return n.rate * math.tanh(wanted / n.rate)
    return max(-n.rate, min(n.rate, wanted))


@njit(cache=True)
def _without_deadband(e: float, w: float, form: float) -> float:
    if w <= 0.0:
        return e
    if form == 1.0:
        return e if abs(e) > w else 0.0
    if form == 2.0:
        return e - w * math.tanh(e / w)
    return math.copysign(max(abs(e) - w, 0.0), e)


@njit(cache=True)
def _after_stiction(state: NDArray[np.float64], target: float, n: Numbers) -> float:
    """The target that the servo follows; state[3] says whether it moves."""
    if n.stiction <= 0.0:
        return target
    if n.stiction_form == 0.0:
        if abs(target - state[2]) > n.stiction:
            state[2] = target
        return state[2]
    error = abs(target - state[0])
    if n.stiction_form == 1.0:
        if error > n.stiction:
            state[3] = 1.0
        elif error < 0.1 * n.stiction:
            state[3] = 0.0
    else:
        state[3] = 1.0 if error > n.stiction else 0.0
    return target


@njit(cache=True)
def _after_play(state: NDArray[np.float64], before: float, n: Numbers, dt: float) -> float:
    angle, b = state[0], n.play
    if b <= 0.0:
        return angle
    if n.play_form <= 1.0:
        free = state[4]
        if n.play_form == 1.0:
            free += dt / n.play_tau * (angle - free)
        state[4] = max(angle - b, min(angle + b, free))
        return state[4]
    d, z = angle - before, state[5]
    if n.play_form == 2.0:  # Bouc-Wen with n = 2, beta = gamma
        state[5] += (d - 0.5 * (abs(d) * abs(z) * z + d * z * z)) / b
    else:  # Dahl 1968
        state[5] += (d - abs(d) * z) / b
    state[5] = max(-1.0, min(1.0, state[5]))
    return angle - b * state[5]


@njit(cache=True)
def _bent(angle: float, n: Numbers) -> float:
    c = n.curve
    if c != 0.0:
        if n.curve_form == 0.0:
            angle *= 1.0 - c * angle * angle
        elif n.curve_form == 1.0:
            k = math.sqrt(6.0 * abs(c))
            angle = math.sin(k * angle) / k
        elif n.curve_form == 2.0:
            angle *= 1.0 - 0.3 * c * abs(angle)
        else:
            k = math.sqrt(3.0 * abs(c))
            angle = math.tanh(k * angle) / k
    e = n.asymmetry
    if e != 0.0:
        angle *= 1.0 + (math.copysign(e, angle) if n.asymmetry_form == 0.0 else 8.0 * e * angle)
    return angle


# ---- Integration of a run at 1 kHz: Heun's method for the chassis, semi-implicit Euler for the steering.

DT = 1e-3  # s
COLUMNS = ("u", "v", "r", "phi", "p", "psi", "v_dot", "r_dot", "p_dot", "delta", "gy", "shift")


@njit(cache=True)
def integrated(command: Array, wanted: Array, around: Array, start: Array, n: Numbers) -> Array:
    """(steps, 12) of COLUMNS from rest or from `start` (12,), at every DT.

    command (steps,) [rad] as the servo gets it; wanted (steps,) [m/s]; around (steps, 7) as in `derivative`.
    """
    steps = command.size
    out = np.empty((steps, 12))
    x, servo = start.copy(), np.zeros(STEERING_STATES)
    one, two, middle = np.zeros(15), np.zeros(15), np.zeros(STATES)
    delta = 0.0
    derivative(x, delta, around[0], wanted[0], n, one)
    for k in range(steps):
        new = steering_step(servo, command[k], x[0], one[12], one[13], n, DT)
        derivative(x, delta, around[k], wanted[k], n, one)
        for i in range(6):
            out[k, i] = x[i]
        out[k, 6], out[k, 7], out[k, 8] = one[1], one[2], one[4]
        out[k, 9], out[k, 10], out[k, 11] = delta, one[14], around[k, SHIFT]
        for i in range(STATES):
            middle[i] = x[i] + DT * one[i]
        derivative(middle, new, around[k], wanted[k], n, two)
        for i in range(STATES):
            x[i] += DT / 2 * (one[i] + two[i])
        delta = new
    return out
