"""Identifies the response of the speed to the throttle, and judges it. A poor result is returned with
reasons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, ThrottleRun, stretches
from rover_sweep.data.results import NORMAL_90, ByName, Quantity
from rover_sweep.identification.speed_fit import PERIOD, SpeedFit, SpeedNoise, fit_speed, grid_of

# Drag with the throttle at neutral, from the coasting after a sweep, and the dead zone that follows from
# it.


NEUTRAL = 0.006  # share of full throttle: 2 us of 400
SETTLING = 0.15  # s after the delay, in which the motor controller may still act
SLOWEST, SHORTEST = 0.3, 0.4  # m/s, s
STEP = 0.04  # s


@dataclass(frozen=True)
class Coasting:
    """Deceleration [m/s^2] at `speed` [m/s], the middle of a coasting of `seconds` [s], with 90 % interval.
    dead_zone: width of the motor controller's dead zone (throttle, share of full), with interval; None if the
    drag is lower than when driving, so the motor freewheels."""

    speed: float
    deceleration: float
    interval: tuple[float, float]
    seconds: float
    dead_zone: float | None = None
    dead_zone_interval: tuple[float, float] | None = None


def coasting(runs: Sequence[ThrottleRun], found: SpeedFit) -> Coasting | None:
    """The longest coasting of the runs; None without 0.4 s of it above 0.3 m/s."""
    coasted = [s for run in runs if (s := _stretch(run, found.model.delay)) is not None]
    if not coasted:
        return None
    t, v = max(coasted, key=lambda s: s[0].size)
    middle = float(0.5 * (v.max() + v.min()))
    rate, error = _rate_at(t, v, middle, found.model.lag, found.noise)
    ends = rate - NORMAL_90 * error, rate + NORMAL_90 * error
    model = found.model
    # under drive v' = (K u - K u_drag - v) / T; coasting with the same drag gives u_drag
    dragging = (model.lag * rate - middle) / model.gain
    zone = model.offset - dragging
    # error of offset - (T a - v) / K, from those of the fit (d/d log K, d/d log T) and of the coasting
    slope = np.array([dragging, -model.lag * rate / model.gain, 0.0, 1.0])
    variance = slope @ found.covariance @ slope + (model.lag * error / model.gain) ** 2
    spread = NORMAL_90 * float(np.sqrt(variance))
    freewheels = dragging + spread < 0
    return Coasting(
        middle,
        rate,
        ends,
        float(t[-1] - t[0]),
        None if freewheels else zone,
        None if freewheels else (zone - spread, zone + spread),
    )


def _stretch(run: ThrottleRun, delay: float) -> tuple[Array, Array] | None:
    """Times (n,) [s] and speeds (n,) with the throttle at neutral, after the sweep and above walking pace."""
    last = min(run.speed.t[-1], run.pwm.t[-1])
    t = np.arange(run.span[1], last, STEP)
    if t.size < 2:
        return None
    u = (run.pwm.x[np.searchsorted(run.pwm.t, t, "right") - 1] - run.neutral_us) / run.travel_us
    off = np.abs(u) <= NEUTRAL
    if not off.any():
        return None
    first = int(np.argmax(off))
    released = np.flatnonzero(~off[first:])
    end = first + int(released[0]) if released.size else t.size
    t = t[first:end]
    t = t[t >= t[0] + delay + SETTLING] if t.size else t
    v = run.speed.on(t) if t.size > 1 else np.empty(0)
    slow = np.flatnonzero(v < SLOWEST)
    n = int(slow[0]) if slow.size else v.size
    return (t[:n], v[:n]) if n * STEP >= SHORTEST else None


def _rate_at(t: Array, v: Array, speed: float, lag: float, noise: SpeedNoise) -> tuple[float, float]:
    """Deceleration [m/s^2] at a speed, and its standard error: v = (v0 + q) e^(-s/lag) - q, linear in both.

    The curve's shape is taken from the drive's lag; the rate in the middle hardly depends on it.
    """
    s = t - t[0]
    decay = np.exp(-s / lag)
    a = np.column_stack((decay, decay - 1.0))
    (v0, q), *_ = np.linalg.lstsq(a, v, rcond=None)
    weights = np.linalg.pinv(a)[1]  # of the samples in q
    variance = float(weights @ noise.covariance_times(weights, STEP))
    return float((speed + q) / lag), float(np.sqrt(variance) / lag)


# Coherence between throttle and speed: whether the throttle caused the speed that was recorded.


GOOD = 0.6  # Tischler & Remple 2012
WINDOWS = 5  # lengths of the sweep in a run, for the averages


@dataclass(frozen=True, eq=False)
class ThrottleCoherence:
    """w (n,) [rad/s]; coherence (n,); gain (n,) [m/s per full throttle], phase (n,) [rad] as measured; band:
    usable (lowest, highest) [rad/s], None without one."""

    w: Array
    coherence: Array
    gain: Array
    phase: Array
    band: tuple[float, float] | None


def throttle_coherence(runs: Sequence[ThrottleRun]) -> ThrottleCoherence:
    """By Welch's averages over all runs, in the swept range."""
    from scipy.signal import csd, welch

    length = min(int(grid_of(run).size) for run in runs) // WINDOWS * 2
    u_u = v_v = u_v = np.zeros(length // 2 + 1)
    f = np.zeros(length // 2 + 1)
    for run in runs:
        t = grid_of(run)
        u, v = run.drive(t), run.speed.on(t)
        options = {"fs": 1 / PERIOD, "nperseg": length, "noverlap": length * 3 // 4, "detrend": "linear"}
        f, power = welch(u, **options)
        u_u = u_u + power
        v_v = v_v + welch(v, **options)[1]
        u_v = u_v + csd(u, v, **options)[1]
    low, high = (min(r.swept[0] for r in runs), max(r.swept[1] for r in runs))
    w = 2 * np.pi * f
    used = (w >= max(low, w[1])) & (w <= high)
    response = u_v[used] / u_u[used]
    coherence = np.abs(u_v[used]) ** 2 / (u_u[used] * v_v[used])
    # usable: the longest stretch in log frequency
    bands = [(float(w[used][a]), float(w[used][b])) for a, b in stretches(coherence >= GOOD) if b > a]
    band = max(bands, key=lambda band: band[1] / band[0], default=None)
    return ThrottleCoherence(w[used], coherence, np.abs(response), np.unwrap(np.angle(response)), band)


LEAST_SPAN = 0.05  # share of full throttle that must be swept, peak to peak
LEAST_SPEED_SPAN = 0.15  # m/s, peak to peak: several times the noise of an EKF on GPS
GOOD_FIT, FAIR_FIT = 0.9, 0.7  # share of the speed's variation
WIDE = 0.35  # relative half-width of an interval above which a parameter is not identified
LEAST_BAND = 4.0  # highest over lowest usable frequency


@dataclass(frozen=True, eq=False)
class SpeedResult:
    """The response of the speed to the throttle.

    level: "good", "acceptable", "poor" or "none"; reasons: why not better, with what to do. fit, coherence,
    coasting: None if there is none. speeds: (lowest, mean, highest) of the sweeps [m/s]; throttles: lowest
    and highest throttle of the sweeps (share of full).
    """

    runs: tuple[ThrottleRun, ...]
    level: str
    reasons: tuple[str, ...]
    speeds: tuple[float, float, float]
    throttles: tuple[float, float]
    fit: SpeedFit | None = None
    coherence: ThrottleCoherence | None = None
    coasting: Coasting | None = None


def identify_speed(runs: Sequence[ThrottleRun]) -> SpeedResult:
    """The result of all throttle sweeps of one rover together; ValueError without a run."""
    if not runs:
        raise ValueError("there is no throttle sweep")
    v = np.concatenate([run.speed.on(grid_of(run)) for run in runs])
    u = np.concatenate([run.drive(grid_of(run)) for run in runs])
    speeds = (float(v.min()), float(v.mean()), float(v.max()))
    throttles = (float(u.min()), float(u.max()))
    if why := _unexcited(throttles, speeds):
        return SpeedResult(tuple(runs), "none", (why,), speeds, throttles)
    fit, found = fit_speed(runs), throttle_coherence(runs)
    level, reasons = _judged(runs, fit, found)
    return SpeedResult(
        tuple(runs),
        level,
        reasons,
        speeds,
        throttles,
        fit,
        found,
        coasting(runs, fit) if level != "none" else None,
    )


def _unexcited(throttles: tuple[float, float], speeds: tuple[float, float, float]) -> str:
    swept, moved = throttles[1] - throttles[0], speeds[2] - speeds[0]
    if swept < LEAST_SPAN:
        return (
            f"no excitation: the throttle was swept by {100 * swept:.1f} % of its travel peak to peak, "
            f"at least {100 * LEAST_SPAN:.0f} % are needed; raise SWP_AMP"
        )
    if moved < LEAST_SPEED_SPAN:
        return (
            f"the speed changed by {moved:.2f} m/s peak to peak, which is hardly above the noise; "
            "raise SWP_AMP or lower SWP_WMIN"
        )
    return ""


def _judged(
    runs: Sequence[ThrottleRun], fit: SpeedFit, found: ThrottleCoherence
) -> tuple[str, tuple[str, ...]]:
    """The level, and the reasons for less than good."""
    bad = [f"the fitted {name} is at its bound" for name in fit.at_bound if name != "delay"]
    if found.band is None or found.band[1] < LEAST_BAND * found.band[0]:
        band = (
            "nowhere" if found.band is None else f"from {found.band[0]:.2g} to {found.band[1]:.2g} rad/s only"
        )
        bad.append(
            f"low coherence: throttle and speed are coherent {band}; sweep with more amplitude, on level "
            "ground, without turning"
        )
    if fit.fit < FAIR_FIT:
        bad.append(
            f"the law explains {100 * fit.fit:.0f} % of the speed's variation, at least 70 % are needed"
        )
    for name in ("gain", "lag"):
        low, high = fit.intervals[name]
        if high - low > 2 * WIDE * getattr(fit.model, name):
            bad.append(f"the {name} is not identified: 90 % interval {low:.3g} to {high:.3g}; sweep longer")
    if bad:
        return "poor", tuple(bad)
    fair = [f"{run.name} was stopped early ({run.stopped})" for run in runs if run.stopped]
    if fit.fit < GOOD_FIT:
        fair.append(f"the law explains {100 * fit.fit:.0f} % of the speed's variation; 90 % would be good")
    return ("acceptable", tuple(fair)) if fair else ("good", ())


# The numbers of an identified speed response by name, with 90 % intervals: law, drag and dead zone.


SHARE = "of full throttle"


def speed_parameters(result: SpeedResult) -> ByName[Quantity]:
    """gain, lag, delay, offset and drag; with a coasting also coasting_drag and, if certain, dead_zone.

    Empty if no law was fitted.
    """
    if result.fit is None:
        return ByName()
    model, ends, mean = result.fit.model, result.fit.intervals, result.speeds[1]
    drag, drag_ends = driving_drag(result.fit, mean)
    found = [
        Quantity("gain", "m/s per full throttle", model.gain, *ends["gain"], "steady speed per throttle"),
        Quantity("lag", "s", model.lag, *ends["lag"], "time constant of the speed"),
        Quantity("delay", "s", model.delay, *ends["delay"], "dead time, with that of the EKF's speed"),
        Quantity(
            "offset", SHARE, model.offset, *ends["offset"], "throttle before it moves: dead zone and drag"
        ),
        Quantity("drag", "m/s^2", drag, *drag_ends, f"drive and road, driving at {mean:.2f} m/s"),
    ]
    if (rolled := result.coasting) is not None:
        words = f"at {rolled.speed:.2f} m/s with neutral throttle"
        found.append(Quantity("coasting_drag", "m/s^2", rolled.deceleration, *rolled.interval, words))
        if rolled.dead_zone is not None and rolled.dead_zone_interval is not None:
            zone, low, high = (max(v, 0.0) for v in (rolled.dead_zone, *rolled.dead_zone_interval))
            words = "dead zone of the motor controller"
            found.append(Quantity("dead_zone", SHARE, zone, low, high, words))
    return ByName(found)


def driving_drag(fit: SpeedFit, speed: float) -> tuple[float, tuple[float, float]]:
    """(v + K u0) / T [m/s^2]: deceleration by drive and road while it drives at a speed [m/s]; 90 % interval.

    u0 includes the dead zone, so this is an upper bound of the drag.
    """
    m = fit.model
    value = (speed + m.gain * m.offset) / m.lag
    slope = np.array([m.gain * m.offset / m.lag, -value, 0.0, m.gain / m.lag])  # log K, log T, delay, u0
    spread = NORMAL_90 * float(np.sqrt(slope @ fit.covariance @ slope))
    return value, (value - spread, value + spread)
