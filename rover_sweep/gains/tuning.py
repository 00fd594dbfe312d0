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
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array, Complex
from rover_sweep.gains.controller import (
    disturbance_error,
    feedback_response,
    simulate_loop,
    step_size,
    step_target,
)
from rover_sweep.gains.steering_chain import DEFAULTS, Autopilot, Gains, SampledPlant

# Gain and phase margin, crossover and bandwidth of a sampled loop from its frequency response.


GAIN_MARGIN_DB, PHASE_MARGIN_DEG = 6.0, 45.0  # required of a proposal
POINTS = 240


@dataclass(frozen=True)
class Margins:
    """gain_db, phase_deg: margins, inf without a crossing. crossover: highest frequency [rad/s] at which the
    loop gain is 1; phase_crossover: lowest at which the phase is -180 deg; nan without one."""

    gain_db: float
    phase_deg: float
    crossover: float
    phase_crossover: float

    @property
    def enough(self) -> bool:
        """True for at least 6 dB and 45 deg."""
        return self.gain_db >= GAIN_MARGIN_DB and self.phase_deg >= PHASE_MARGIN_DEG


def frequencies(period: float, lowest: float = 0.05) -> Array:
    """Frequency grid [rad/s] for loops, up to the Nyquist frequency of a main loop of `period` [s]."""
    return np.geomspace(lowest, 0.999 * np.pi / period, POINTS)


def all_margins(loops: Complex, w: Array) -> tuple[Array, Array, Array, Array]:
    """(gain margin [dB], phase margin [deg], crossover, phase crossover [rad/s]), (n,) each, of (n, n_w)."""
    gain, phase_at = _gain_margins(loops, w)
    size = np.abs(loops)
    above = size > 1.0
    crossed = above[:, :-1] != above[:, 1:]
    margin, at = np.full(crossed.shape, np.inf), np.full(crossed.shape, -np.inf)
    row, k = np.nonzero(crossed)  # few; the powers and angles of all would take most of the time
    log, next_log = np.log(size[row, k]), np.log(size[row, k + 1])
    share = -log / (next_log - log)
    margin[row, k] = np.degrees(np.angle(-(loops[row, k] + share * (loops[row, k + 1] - loops[row, k]))))
    at[row, k] = w[k] * (w[k + 1] / w[k]) ** share
    last = np.where(crossed.any(axis=1), np.fmax.reduce(at, axis=1), np.nan)
    return gain, margin.min(axis=1), last, phase_at


def _gain_margins(loops: Complex, w: Array) -> tuple[Array, Array]:
    """Gain margins [dB] at crossings of the negative real axis, and the lowest such frequency [rad/s]."""
    re, im = loops.real, loops.imag
    crossed = (im[:, :-1] * im[:, 1:] < 0) & (np.minimum(re[:, :-1], re[:, 1:]) < 0)
    sizes, frequency = np.zeros(crossed.shape), np.full(crossed.shape, np.inf)
    row, k = np.nonzero(crossed)
    share = im[row, k] / (im[row, k] - im[row, k + 1])
    real = re[row, k] + share * (re[row, k + 1] - re[row, k])
    sizes[row, k] = np.where(real < 0, -real, 0.0)
    frequency[row, k] = np.where(real < 0, w[k] * (w[k + 1] / w[k]) ** share, np.inf)
    size, at = sizes.max(axis=1), frequency.min(axis=1)
    db = np.where(size > 0, -20 * np.log10(np.maximum(size, 1e-12)), np.inf)
    return db, np.where(np.isfinite(at), at, np.nan)


def margins(loop: Complex, w: Array) -> Margins:
    """The margins of one loop (n_w,) at w (n_w,) rad/s."""
    return Margins(*(float(found[0]) for found in all_margins(loop[None, :], w)))


def bandwidth(closed: Complex, w: Array) -> float:
    """The frequency [rad/s] at which |r / target| (n_w,) is first 3 dB below its value at the lowest one."""
    db = 20 * np.log10(np.abs(closed) / abs(closed[0]))
    below = np.flatnonzero(db < -3.0)
    if below.size == 0:
        return float(w[-1])
    k = int(below[0])
    share = (-3.0 - db[k - 1]) / (db[k] - db[k - 1])
    return float(w[k - 1] * (w[k] / w[k - 1]) ** share)


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

    def paths(self) -> Iterator[Complex]:
        """Responses (n_w,) from output to turn rate [rad/s] of every member, at `frequencies`."""
        w = frequencies(self.autopilot.period)
        return (plant.response(w) * angle for plant, angle in self.loop_gains())


def feed_forward(family: Family, plant: SampledPlant | None = None) -> float:
    """FF [1/(rad/s)]: output for a steady 1 rad/s at a plant's speed, default the design's."""
    plant = plant or family.nominal
    return 1.0 / (plant.gain * family.angle_per_output[0] * family.autopilot.speed_scale(plant.speed))


def beside_integrator(right: float, i: Array, lag: float) -> Array:
    """FF (n,) for integrators (n,), less what they supply while a turn builds up. right: FF of a steady turn;
    lag [s]: of rover and loop."""
    return np.asarray(np.maximum(right - FF_REDUCTION * i * lag, (1 - MOST_FF_REDUCTION) * right))


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
        other = _best_pair(family, replace(keep, d=rounded_down(min(share * right, MOST_D))), most)
        if other is not None and (found is None or other[1] < D_WORTH * found[1]):
            found = other
    if found is None:
        return None
    made, rate = found[0], family.autopilot.rate_limit(family.nominal.speed)
    return replace(made, imax=min(integrator_limit(family, made.ff, rate), most.imax))


def _best_pair(family: Family, shared: Gains, most: Gains) -> tuple[Gains, float] | None:
    """(gains, disturbance error [rad]) of the best P and I up to `most` with D and filters of `shared`."""
    right = feed_forward(family)
    p, i = _robust_pairs(family, shared, most)
    if p.size == 0:
        return None
    ff = np.minimum(beside_integrator(right, i, family.lag), most.ff)
    damped = overshoots(family, shared, p, i, ff) <= MOST_OVERSHOOT
    if not damped.any():
        return None
    p, i, ff = p[damped], i[damped], ff[damped]
    error = disturbance_error(family.autopilot, family.nominal, family.angle_per_output[0], p, i, shared)
    k = int(np.argmin(error))
    return replace(shared, ff=round(float(ff[k]), 3), p=rounded_down(p[k]), i=rounded_down(i[k])), float(
        error[k]
    )


def _robust_pairs(family: Family, shared: Gains, most: Gains) -> tuple[Array, Array]:
    """P (n,) and I (n,) of the offered pairs up to `most` that keep both margins."""
    right = feed_forward(family)
    offered_p = np.unique(np.minimum(_P_OF_FF * right, min(MOST_P, most.p)))
    offered_i = np.unique(np.minimum(_I_OF_FF * right, min(MOST_I, most.i)))
    p, i = (grid.ravel() for grid in np.meshgrid(offered_p, offered_i))
    keeps = robust(family.paths(), shared, family.autopilot.period, p, i)
    return p[keeps], i[keeps]


def why_none(family: Family, keep: Gains, most: Gains) -> str:
    """Which requirement no P and I meets, where `design_gains` finds none."""
    p, _ = _robust_pairs(family, replace(keep, d=0.0), most)
    if p.size:
        return (
            f"every P and I that keeps {GAIN_MARGIN_DB:g} dB and {PHASE_MARGIN_DEG:g} deg overshoots a step "
            f"by more than {MOST_OVERSHOOT:g} %, {_held_fixed(family, keep)}"
        )
    return (
        f"no P and I keep {GAIN_MARGIN_DB:g} dB and {PHASE_MARGIN_DEG:g} deg for all parameter values within "
        f"their intervals, {_held_fixed(family, keep)}"
    )


def _held_fixed(family: Family, keep: Gains) -> str:
    """What the design did not change, as it may be the cause."""
    loop, right = family.autopilot, feed_forward(family)
    filters = {"FLTT": keep.fltt, "FLTE": keep.flte, "FLTD": keep.fltd}
    known = ", ".join(f"ATC_STR_RAT_{name} {hz:g} Hz" for name, hz in filters.items() if hz)
    return (
        f"with these held fixed: FF at {right:.3g} less what the integrator supplies, "
        f"{f'{known}, ' if known else ''}INS_GYRO_FILTER {loop.gyro_hz:g} Hz, SCHED_LOOP_RATE "
        f"{loop.loop_hz:g} Hz, MOT_SPD_SCA_BASE {loop.scale_base:g} m/s; D was tried up to "
        f"{_D_OF_FF[-1] * right:.2g}"
    )


def robust(
    paths: Iterable[Complex], shared: Gains, period: float, p: Array, i: Array, most_crossover: float = np.inf
) -> np.ndarray:
    """Mask (n,) of the pairs of P and I that keep both margins for a whole family.

    paths: from controller to measurement, (n_w,) at `frequencies(period)`; most_crossover [rad/s]: limit for
    the first path, measured up to it.
    """
    keeps = np.ones(p.size, dtype=bool)
    w = frequencies(period)
    for path in paths:
        left = np.flatnonzero(keeps)
        if left.size == 0:
            break
        feedback = feedback_response(shared, p[left], i[left], period, w)
        gain, phase, crossover, _ = all_margins(feedback * path, w)
        keeps[left] = (gain >= GAIN_MARGIN_DB) & (phase >= PHASE_MARGIN_DEG) & ~(crossover > most_crossover)
        most_crossover = np.inf
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


def rounded_down(value: float) -> float:
    """Rounded down to three decimals, so that rounding never reduces a margin."""
    return float(np.floor(value * 1000) / 1000)


def speeds_around(speed: float) -> Sequence[float]:
    """V, V / 1.5 and 1.5 V, m/s."""
    return speed, speed / SPEED_RANGE, speed * SPEED_RANGE
