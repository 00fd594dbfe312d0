"""From the delayed command to the road-wheel angle, once per step of the integrator.

state: 0 servo angle, 1 servo rate, 2 held target, 3 moving, 4 angle behind the play, 5 Bouc-Wen's z, 6 and 7
resonant linkage, 8 angle lost to compliance. Forms:
deadband 0 offset beyond the zone, 1 jump at its edge, 2 soft, w tanh(e/w).
stiction 0 the target is held until the command has moved by s, then follows all the way; 1 with memory: the
servo starts at an error of s and goes on until it has arrived; 2 without memory: it drives only at an error
above s.
play 0 the play operator, 1 with a spring that draws the wheel to the middle of the gap, 2 Bouc-Wen, 3 Dahl.
curve 0 cubic, 1 crank and rod, sin, 2 exponent of the transmitter, 3 tanh.
asymmetry 0 two gains, 1 quadratic.
rate 0 a limit, 1 a motor that weakens with its speed, tanh.
compliance 0 in proportion to the front side force, 1 to its moment about the steering axis with a pneumatic
trail that vanishes as the tyre slides.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.foreign.numbers import Numbers

STATES = 9


@njit
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


@njit
def _limited(wanted: float, n: Numbers) -> float:
    if n.rate_form == 1.0:
        return n.rate * math.tanh(wanted / n.rate)
    return max(-n.rate, min(n.rate, wanted))


@njit
def _without_deadband(e: float, w: float, form: float) -> float:
    if w <= 0.0:
        return e
    if form == 1.0:
        return e if abs(e) > w else 0.0
    if form == 2.0:
        return e - w * math.tanh(e / w)
    return math.copysign(max(abs(e) - w, 0.0), e)


@njit
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


@njit
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


@njit
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
