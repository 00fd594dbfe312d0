"""Design of the gains: FF from the steady turn rate, P and I as fast as the worst of the family allows.

FF gives the right steady turn rate without feedback: 1 / (steady r per output). The firmware divides the
steering by the speed (MOT_SPD_SCA_BASE) and r = V delta / (L + K_us V^2), so FF changes with the speed only
by the understeer. P and I minimise the integrated error after a disturbance of the wheels (a trim error, a
slope), over all pairs whose loop keeps 6 dB and 45 deg for all parameter values within their 90 % intervals
at V/1.5, V and 1.5 V, and whose predicted step overshoots by at most 5 %. (Astrom and Hagglund 2006,
Advanced PID Control, chapter 6: maximum integral action under robustness constraints; here on the sampled
loop, with the error after a disturbance instead of the integral gain.)

A step from the present gains raises none by more than `MOST_CHANGE`, so that a wrong model cannot do much
harm at once; P and I are then the best within this bound, and keep the margins like all others. A gain is
lowered as far as the margins and the steady turn rate need.

While a turn builds up, the integrator reaches I times the lag of rover and loop, which causes overshoot. FF
is therefore reduced by half of that, at most by a fifth: the integrator supplies this part of a turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import feedback_response, simulate_loop
from rover_sweep.gains.margins import GAIN_MARGIN_DB, PHASE_MARGIN_DEG, all_margins, frequencies
from rover_sweep.gains.steering_chain import DEFAULTS, Autopilot, Gains
from rover_sweep.gains.steering_plant import SampledPlant
from rover_sweep.gains.step import disturbance_error, step_size, step_target

MOST_OVERSHOOT = 5.0  # percent
SPEED_RANGE = 1.5  # the gains are designed for V / 1.5 to 1.5 V
FF_REDUCTION, MOST_FF_REDUCTION = 0.5, 0.2  # shares of I times lag, and of FF
MOST_P, MOST_I = 2.0, 2.0  # ranges of the parameters (AR_AttitudeControl.cpp, var_info)
MOST_D, D_WORTH = 0.4, 0.7
MOST_CHANGE = 2.0  # factor by which a proposal raises a gain at once
UNBOUNDED = dict.fromkeys(("ff", "p", "i", "imax"), math.inf)
_I_ENOUGH = 0.9  # of MOST_I: D cannot improve the loop much then
_D_OF_FF = (0.02, 0.05)  # s
_P_OF_FF = np.concatenate(([0.0], np.geomspace(0.03, 6.0, 40)))  # P in units of FF
_I_OF_FF = np.geomspace(0.05, 40.0, 40)  # I in units of FF, 1/s


@dataclass(frozen=True, eq=False)
class Family:
    """Plants within the uncertainty at several speeds; the first is as identified at the design speed.

    angle_per_output: of the servo's mean and of each side [rad, positive right], the mean first.
    """

    plants: tuple[SampledPlant, ...]
    angle_per_output: tuple[float, ...]
    autopilot: Autopilot

    @property
    def nominal(self) -> SampledPlant:
        return self.plants[0]

    @property
    def lag(self) -> float:
        """Lag [s] of the measured yaw rate behind the output at low frequency."""
        w = np.array([1e-3])
        return float(-np.angle(self.nominal.response(w))[0] / w[0])

    def loop_gains(self) -> list[tuple[SampledPlant, float]]:
        """(plant, road-wheel angle [rad] per output including the speed scale) of every member."""
        scale = self.autopilot.speed_scale
        return [(p, angle * scale(p.speed)) for p in self.plants for angle in self.angle_per_output]


def feed_forward(family: Family) -> float:
    """FF [1/(rad/s)]: the output for a steady turn rate of 1 rad/s at the design speed."""
    plant = family.nominal
    return 1.0 / (plant.gain * family.angle_per_output[0] * family.autopilot.speed_scale(plant.speed))


def bound(name: str, now: float) -> float:
    """The largest value to which a proposal raises a parameter from its present one: `MOST_CHANGE` times
    that, or the firmware's default where that is more (from 0 there is no factor)."""
    return max(MOST_CHANGE * now, DEFAULTS[name])


def bounds(now: Gains) -> Gains:
    """The largest gains of a proposal. D is a small share of FF and has no bound of its own."""
    most = {name: bound(f"ATC_STR_RAT_{name.upper()}", getattr(now, name)) for name in UNBOUNDED}
    return replace(now, d=MOST_D, **most)


def unbounded(now: Gains) -> Gains:
    """Bounds that allow every gain."""
    return replace(now, d=MOST_D, **UNBOUNDED)


def design_gains(family: Family, keep: Gains, most: Gains) -> Gains | None:
    """The best FF, P, I, D and IMAX up to `most` with the filters of `keep`; None if no P and I keep the
    margins.

    D is used only if it reduces the disturbance error below `D_WORTH` times that without D, as with a slow
    gyro filter.
    """
    right = min(feed_forward(family), most.ff)
    found = _best_pair(family, replace(keep, d=0.0), most)
    enough = found is not None and found[0].i >= _I_ENOUGH * min(MOST_I, most.i)
    for share in () if enough else _D_OF_FF:
        other = _best_pair(family, replace(keep, d=_rounded_down(min(share * right, MOST_D))), most)
        if other is not None and (found is None or other[1] < D_WORTH * found[1]):
            found = other
    if found is None:
        return None
    made, rate = found[0], family.autopilot.rate_limit(family.nominal.speed)
    return replace(made, imax=min(integrator_limit(family, made.ff, rate), most.imax))


def _best_pair(family: Family, shared: Gains, most: Gains) -> tuple[Gains, float] | None:
    """(gains, disturbance error [rad]) of the best P and I up to `most` with D and filters of `shared`."""
    right = feed_forward(family)
    offered_p = np.unique(np.minimum(_P_OF_FF * right, min(MOST_P, most.p)))
    offered_i = np.unique(np.minimum(_I_OF_FF * right, min(MOST_I, most.i)))
    p, i = (grid.ravel() for grid in np.meshgrid(offered_p, offered_i))
    keeps = robust(family, shared, p, i)
    p, i = p[keeps], i[keeps]
    if p.size == 0:
        return None
    ff = np.maximum(right - FF_REDUCTION * i * family.lag, (1 - MOST_FF_REDUCTION) * right)
    ff = np.minimum(ff, most.ff)
    damped = overshoots(family, shared, p, i, ff) <= MOST_OVERSHOOT
    if not damped.any():
        return None
    p, i, ff = p[damped], i[damped], ff[damped]
    error = disturbance_error(family.autopilot, family.nominal, family.angle_per_output[0], p, i, shared)
    k = int(np.argmin(error))
    return replace(shared, ff=round(float(ff[k]), 3), p=_rounded_down(p[k]), i=_rounded_down(i[k])), float(
        error[k]
    )


def robust(family: Family, shared: Gains, p: Array, i: Array) -> np.ndarray:
    """Mask (n,) of the pairs of P and I that keep both margins for the whole family."""
    keeps = np.ones(p.size, dtype=bool)
    w = frequencies(family.autopilot.period)
    for plant, angle in family.loop_gains():
        left = np.flatnonzero(keeps)
        if left.size == 0:
            break
        feedback = feedback_response(shared, p[left], i[left], family.autopilot.period, w)
        gain, phase, _, _ = all_margins(feedback * plant.response(w) * angle, w)
        keeps[left] = (gain >= GAIN_MARGIN_DB) & (phase >= PHASE_MARGIN_DEG)
    return keeps


def overshoots(family: Family, shared: Gains, p: Array, i: Array, ff: Array) -> Array:
    """Predicted overshoot (n,) [%] of the step of `step_of`."""
    loop, plant, angle = family.autopilot, family.nominal, family.angle_per_output[0]
    size = step_size(loop, plant, angle)
    driven = simulate_loop(loop, plant, angle, step_target(loop, size), p, i, ff, shared)
    return np.asarray(100 * (driven.rate.max(axis=0) / size - 1.0))


def integrator_limit(family: Family, ff: float, most_rate: float, trim: float = 0.03) -> float:
    """IMAX: the output that compensates the family's error in FF at the largest turn rate [rad/s] and a trim
    error of `trim` [rad], plus a quarter; in steps of 0.05, from 0.1 to 1."""
    needed = []
    for plant, angle in family.loop_gains():
        right = 1.0 / (plant.gain * angle)
        needed.append(abs(right - ff) * most_rate + trim / abs(angle))
    return float(min(max(np.ceil(1.25 * max(needed) / 0.05) * 0.05, 0.1), 1.0))


def _rounded_down(value: float) -> float:
    """Rounded down to three decimals, so that rounding never reduces a margin."""
    return float(np.floor(value * 1000) / 1000)


def speeds_around(speed: float) -> Sequence[float]:
    """V, V / 1.5 and 1.5 V, m/s."""
    return speed, speed / SPEED_RANGE, speed * SPEED_RANGE
