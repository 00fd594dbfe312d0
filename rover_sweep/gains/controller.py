"""AC_PID as in the firmware: simulated in time for many gains at once, and as a frequency response.

`libraries/AC_PID/AC_PID.cpp` update_all of ArduRover 4.6.3, in its order: target low-pass, error, error
low-pass, derivative and its low-pass, integrator (only towards zero while the limit flag of the last tick is
set, limited to IMAX, zero if I is zero), sum; then the feed-forward of the filtered target is added. A
low-pass is x += dt / (dt + 1/(2 pi f)) (new - x) (`AP_Math.cpp` calc_lowpass_alpha_dt), off at 0 Hz. The
first call after a pause of 0.2 s only sets the filters. SMAX, PDMX and the notches are off by default and
not modelled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.gains.steering_chain import Autopilot, Gains, SampledPlant


def low_pass_share(cutoff_hz: float, dt: float) -> float:
    """The weight (0..1) of the new value in a low-pass with a tick of dt [s]."""
    return 1.0 if cutoff_hz <= 0 else dt / (dt + 1.0 / (2 * np.pi * cutoff_hz))


class RatePid:
    """AC_PID for n controllers in parallel: p, i, ff are arrays (n,), everything else is shared."""

    def __init__(self, gains: Gains, dt: float, p: Array, i: Array, ff: Array) -> None:
        self.p, self.i, self.ff, self.gains, self.dt = p, i, ff, gains, dt
        shares = (low_pass_share(hz, dt) for hz in (gains.fltt, gains.flte, gains.fltd))
        self.share_t, self.share_e, self.share_d = shares
        self.target = self.error = self.derivative = self.integrator = np.zeros_like(p)
        self.fresh = True

    def update(self, target: float, measured: Array, limit: NDArray[np.bool_]) -> Array:
        """Output (n,) for a target and measurements (n,) [rad/s]; limit (n,): flags of the last tick."""
        if self.fresh:
            self.fresh = False
            self.target = np.full_like(self.p, target)
            self.error = self.target - measured
            change = np.zeros_like(self.p)
        else:
            before, last = self.target, self.error
            self.target = before + self.share_t * (target - before)
            self.error = last + self.share_e * (self.target - measured - last)
            self.derivative = self.derivative + self.share_d * (
                (self.error - last) / self.dt - self.derivative
            )
            change = (self.target - before) / self.dt
        self._integrate(limit)
        fed = self.target * self.ff + change * self.gains.dff
        return self.error * self.p + self.derivative * self.gains.d + self.integrator + fed

    def _integrate(self, limit: NDArray[np.bool_]) -> None:
        free = ~limit | (self.integrator * self.error < 0)
        grown = np.clip(self.integrator + self.error * self.i * self.dt, -self.gains.imax, self.gains.imax)
        self.integrator = np.where(self.i == 0, 0.0, np.where(free, grown, self.integrator))


@dataclass(frozen=True, eq=False)
class SimulatedDrive:
    """A simulated drive of n controllers: t (m,) [s], target (m,) after the firmware's limits, measured yaw
    rate (m, n) [rad/s, positive right], steering (m, n) as a share of its travel."""

    t: Array
    target: Array
    rate: Array
    steering: Array


def simulate_loop(
    autopilot: Autopilot,
    plant: SampledPlant,
    angle_per_output: float,
    wanted: Array,
    p: Array,
    i: Array,
    ff: Array,
    gains: Gains | None = None,
    disturbance: Array | None = None,
    outer: Callable[[float], float] | None = None,
) -> SimulatedDrive:
    """Simulate the firmware's loop around a plant that starts straight ahead.

    wanted (m,): requested turn rate [rad/s] in each main loop. p, i, ff (n,): n controllers in parallel;
    gains: their shared values (filters, D, IMAX). disturbance (m,): added to the road-wheel angle [rad].
    outer: an outer loop, which makes a request from the turn rate of a single controller; added to wanted.
    """
    shared, dt = gains or autopilot.gains, autopilot.period
    pid = RatePid(shared, dt, p, i, ff)
    scale = autopilot.speed_scale(plant.speed)
    held = np.full(p.shape, not autopilot.integrates(plant.speed))
    targets, now = np.empty_like(wanted), 0.0
    pushed = np.zeros_like(wanted) if disturbance is None else disturbance
    x, limit = np.zeros((len(plant.a), p.size)), np.zeros(p.shape, dtype=bool)
    rate, steering = np.empty((wanted.size, p.size)), np.empty((wanted.size, p.size))
    for k, want in enumerate(wanted):
        rate[k] = plant.c @ x
        asked = float(want) if outer is None else float(want) + outer(float(rate[k, 0]))
        now = targets[k] = limited_target(autopilot, plant.speed, asked, now)
        out = pid.update(now, rate[k], limit) * scale
        limit = held | (np.abs(out) >= 1.0)
        steering[k] = np.clip(out, -1.0, 1.0)
        felt = (
            steering[k - plant.delay_steps] * angle_per_output
            if k >= plant.delay_steps
            else np.zeros(p.shape)
        )
        x = plant.a @ x + plant.b[:, None] * (felt + pushed[k])
    return SimulatedDrive(np.arange(wanted.size, dtype=np.float64) * dt, targets, rate, steering)


def limited_target(autopilot: Autopilot, speed: float, want: float, now: float) -> float:
    """The firmware's limited target [rad/s] in one main loop for a requested turn rate; now: the last target.

    The change is limited first, then the size.
    """
    most, step = autopilot.rate_limit(speed), autopilot.accel_max * autopilot.period
    reached = min(max(want, now - step), now + step) if step > 0 else want
    return min(max(reached, -most), most)


def feedback_response(gains: Gains, p: Array, i: Array, dt: float, w: Array) -> NDArray[np.complex128]:
    """Response (n, n_w) of the controllers from error (target - measured) to output at w (n_w,) rad/s."""
    z = np.exp(-1j * w * dt)
    error, derived = (_low_pass(hz, dt, z) for hz in (gains.flte, gains.fltd))
    d = gains.d * derived * (1 - z) / dt
    return np.asarray(error * (p[:, None] + i[:, None] * dt / (1 - z) + d))


def forward_response(gains: Gains, ff: float, dt: float, w: Array) -> NDArray[np.complex128]:
    """Response (n_w,) of the feed-forward, from the filtered target to the output, at w (n_w,) rad/s."""
    return np.asarray(ff + gains.dff * (1 - np.exp(-1j * w * dt)) / dt, complex)


def target_response(gains: Gains, dt: float, w: Array) -> NDArray[np.complex128]:
    """Response (n_w,) of the target's low-pass at w (n_w,) rad/s."""
    return _low_pass(gains.fltt, dt, np.exp(-1j * w * dt))


def _low_pass(cutoff_hz: float, dt: float, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    share = low_pass_share(cutoff_hz, dt)
    return np.asarray(share / (1 - (1 - share) * z))


# Predicted responses of the loop: to a step of the target turn rate, and to a disturbance of the wheels.


SECONDS = 4.0
BEFORE = 0.2  # s of straight driving before a step
SETTLED = 0.05  # of the step
PUSH = 0.02  # rad, disturbance of the road-wheel angle, as by a trim error of 1 deg
LARGEST_SHARE = 0.5  # of the turn rate that steering and limits allow


@dataclass(frozen=True)
class Step:
    """size [rad/s] of the target; rise [s]: time from 10 to 90 %; overshoot [% of size]; settling [s]: time
    from the request until it stays within 5 % of the size; nan if not reached. lag [s]: integral of (limited
    target - rate) / size; used: largest share of the steering's travel."""

    size: float
    rise: float
    overshoot: float
    settling: float
    lag: float
    used: float


def step_size(autopilot: Autopilot, plant: SampledPlant, angle_per_output: float) -> float:
    """Half of the turn rate [rad/s] that steering and limits allow at this speed, at most 0.6."""
    reach = abs(plant.gain * angle_per_output)
    return min(LARGEST_SHARE * min(reach, autopilot.rate_limit(plant.speed)), 0.6)


def step_target(autopilot: Autopilot, size: float) -> Array:
    """The requested turn rate (m,) [rad/s] of a step after `BEFORE` s, one value per main loop."""
    t = np.arange(round(SECONDS / autopilot.period)) * autopilot.period
    return np.where(t >= BEFORE, size, 0.0)


def step_of(autopilot: Autopilot, plant: SampledPlant, angle_per_output: float, gains: Gains) -> Step:
    """The predicted step response with all limits of the firmware."""
    size = step_size(autopilot, plant, angle_per_output)
    driven = simulated_step(autopilot, plant, angle_per_output, gains, size)
    return step_metrics(
        driven.t - BEFORE, driven.target, driven.rate[:, 0], size, float(np.abs(driven.steering).max())
    )


def simulated_step(
    autopilot: Autopilot, plant: SampledPlant, angle_per_output: float, gains: Gains, size: float
) -> SimulatedDrive:
    """The simulated step."""
    p, i, ff = (np.array([g]) for g in (gains.p, gains.i, gains.ff))
    return simulate_loop(autopilot, plant, angle_per_output, step_target(autopilot, size), p, i, ff, gains)


def step_metrics(t: Array, target: Array, rate: Array, size: float, used: float = math.nan) -> Step:
    """The Step of a recorded or simulated step from 0 to size; t (m,) [s] since the request."""
    share = rate / size
    after = t >= 0
    outside = np.flatnonzero(np.abs(share - 1.0) > SETTLED)
    last = int(outside[-1]) if outside.size else 0
    settling = float(t[last + 1]) if last + 1 < t.size else math.nan
    behind = float(np.sum((target - rate)[after]) / size * np.mean(np.diff(t)))
    return Step(
        size,
        _first(t, share, 0.9) - _first(t, share, 0.1),
        100 * max(float(share.max()) - 1.0, 0.0),
        settling,
        behind,
        used,
    )


def _first(t: Array, share: Array, level: float) -> float:
    """The interpolated time [s] at which the share first passes a level; nan if never."""
    above = np.flatnonzero((share[1:] >= level) & (share[:-1] < level))
    if above.size == 0:
        return math.nan
    k = int(above[0])
    return float(t[k] + (level - share[k]) / (share[k + 1] - share[k]) * (t[k + 1] - t[k]))


def disturbance_error(
    autopilot: Autopilot, plant: SampledPlant, angle_per_output: float, p: Array, i: Array, shared: Gains
) -> Array:
    """Integral of abs(error) (n,) [rad] over SECONDS after a disturbance of the wheels by PUSH."""
    still = np.zeros(round(SECONDS / autopilot.period))
    push = np.full(still.size, PUSH)
    driven = simulate_loop(autopilot, plant, angle_per_output, still, p, i, np.zeros_like(p), shared, push)
    return np.asarray(np.abs(driven.rate).sum(axis=0) * autopilot.period)
