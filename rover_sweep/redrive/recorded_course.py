"""The course of a recorded drive, to be driven again."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Array, Log
from sitl.redrive.course import AppletState, Course

SMOOTHING_S = 0.3  # of the estimated speed, to remove its noise
LONGEST_GAP = 5  # loops without a record; longer gaps are filled
SLOWEST_HZ, FASTEST_HZ = 20.0, 400.0


def course_of(log: Log) -> Course:
    """The drive in a log. DataRefused if steering, gyro or speed are missing or hardly overlap."""
    for name, what in (("r", "gyro"), ("speed", "speed")):
        if name not in log.signals or log.signals[name].t.size < 2:
            raise DataRefused(f"{log.name}: no {what} was recorded, which a redrive needs")
    pwm = next((s for s in log.steering if s.unit == "us" and s.t.size > 1), None)
    if pwm is None:
        raise DataRefused(
            f"{log.name}: no steering output in us was recorded; log SWEP, RCOU or SERVO_OUTPUT_RAW"
        )
    t = _loops(log, pwm)
    if t.size < 100:
        raise DataRefused(
            f"{log.name}: too short: only {t.size} main loops have steering, gyro and speed; 100 are needed"
        )
    psi, steering = log.signals.get("psi"), _staircase(pwm, t)
    return Course(
        t=t,
        steering=steering,
        asked_t=pwm.t if pwm.hold else t,
        asked=pwm.x if pwm.hold else steering,
        speed=_smooth(np.interp(t, log.signals["speed"].t, log.signals["speed"].x), t),
        heading=float(np.interp(t[0], psi.t, psi.x)) if psi is not None else 0.0,
        applet=_applet(log, pwm, t),
        marks=tuple((at, text) for at, text in log.marks if t[0] <= at <= t[-1]),
        parameters={"INS_GYRO_FILTER": _cutoff(log, "r"), "INS_ACCEL_FILTER": _cutoff(log, "ay")}
        | dict(log.parameters),
    )


def _loops(log: Log, pwm: Signal) -> Array:
    """Times (n,) s of the main loops in which steering, gyro and speed are recorded.

    The time stamps of the gyro with gaps filled, or every 10 ms if raw gyro samples were logged.
    """
    gyro, speed = log.signals["r"], log.signals["speed"]
    start = max(pwm.t[0], gyro.t[0], speed.t[0])
    end = min(pwm.t[-1], gyro.t[-1], speed.t[-1])
    if end <= start:
        return np.empty(0)
    if not SLOWEST_HZ <= gyro.rate <= FASTEST_HZ:
        return np.arange(start, end, 0.01)
    t = gyro.t[(gyro.t >= start) & (gyro.t <= end)]
    period = 1.0 / gyro.rate
    gaps = np.flatnonzero(np.diff(t) > LONGEST_GAP * period)
    filled = [np.arange(t[k] + period, t[k + 1] - 0.5 * period, period) for k in gaps]
    return np.sort(np.concatenate((t, *filled)))


def _staircase(pwm: Signal, t: Array) -> Array:
    """PWM (n,) us on the servo from each loop on.

    A held output reaches the servo at the next loop. A continuous one is sampled at the middle of the loop.
    """
    if pwm.hold:
        k = np.searchsorted(pwm.t, t, "right") - 1
        return pwm.x[np.clip(k, 0, pwm.t.size - 1)].astype(float)
    return np.interp(t + 0.5 * float(np.median(np.diff(t))), pwm.t, pwm.x)


def _smooth(x: Array, t: Array) -> Array:
    width = max(1, round(SMOOTHING_S / float(np.median(np.diff(t)))) | 1)
    padded = np.pad(x, width // 2, mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def _applet(log: Log, pwm: Signal, t: Array) -> AppletState | None:
    if log.applet is None or not pwm.hold:
        return None
    rows = log.applet
    inside = (rows.t >= t[0]) & (rows.t <= t[-1])
    at = rows.t[inside]
    out = pwm.x[np.clip(np.searchsorted(pwm.t, at, "right") - 1, 0, pwm.t.size - 1)]
    return AppletState(at, rows.run[inside], rows.state[inside], rows.clock[inside], out)


def _cutoff(log: Log, channel: str) -> float:
    """Cut-off of the known low-pass of a channel [Hz], 0 if it has none."""
    return log.filters[channel].cutoff_hz if channel in log.filters else 0.0
