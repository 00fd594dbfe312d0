"""Judgement on recordings: what must be refused, and what must be said about the rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rover_sweep.errors import DataRefused
from rover_sweep.identify.recording import Note, Recording, Signal
from rover_sweep.logs.log import STEERING, THRUST_LEFT, THRUST_RIGHT, Log, output_channel
from rover_sweep.logs.runs import find_runs
from rover_sweep.logs.wave import MOVING_SPEED

GAP = 3.0  # a gap is that many sampling intervals
GYRO_RANGE, ACCEL_RANGE = 34.9, 16 * 9.80665  # rad/s (2000 deg/s), m/s^2: full scale of the usual sensors


def refuse_useless(log: Log) -> None:
    """Raise DataRefused where no run can be in the log, with the value seen and what to do."""
    _refuse_foreign(log)
    if not log.has_motion:
        missing = " and ".join(n for n, c in (("speed", "speed"), ("yaw rate", "r")) if c not in log.signals)
        raise DataRefused(
            f"{log.name} holds no {missing}: set LOG_BITMASK (or the message rates) to record the IMU and the EKF"
        )
    if not log.steering:
        raise DataRefused(
            f"{log.name} holds no steering output (SWEP, SERVO_OUTPUT_RAW or RCOU): give the .tlog of the same drive too"
        )
    _refuse_static(log)
    if not find_runs(log):
        _refuse_unexcited(log)


def _refuse_foreign(log: Log) -> None:
    if log.vehicle not in ("rover", ""):
        raise DataRefused(
            f"{log.name} is the log of a {log.vehicle} ({log.firmware or 'by its heartbeat'}), not of a rover with steered wheels"
        )
    left, right = (output_channel(log.parameters, f) for f in (THRUST_LEFT, THRUST_RIGHT))
    if (left and right and output_channel(log.parameters, STEERING) is None) or log.parameters.get(
        "SKID_STEER_OUT"
    ):
        raise DataRefused(
            f"{log.name} comes from a vehicle without steered wheels (SERVO{left}_FUNCTION 73 and SERVO{right}_FUNCTION 74: "
            "left and right thrust); only steered rovers can be identified"
        )  # fmt: skip


def _refuse_static(log: Log) -> None:
    speed = log.signals["speed"].x
    fastest = float(np.percentile(np.abs(speed), 99)) if speed.size else 0.0
    if fastest < MOVING_SPEED:
        raise DataRefused(
            f"{log.name}: the rover never drove (speed up to {fastest:.2f} m/s); record a sweep while driving"
        )


def _refuse_unexcited(log: Log) -> None:
    steering, speed = log.steering[0], log.signals["speed"]
    moving = np.interp(steering.t, speed.t, speed.x, left=0.0, right=0.0) > MOVING_SPEED
    x = steering.x[moving]
    seen = f"{np.min(x):.4g} to {np.max(x):.4g} {steering.unit}" if x.size else "nothing"
    raise DataRefused(
        f"{log.name}: no steering excitation while driving (steering {seen}); drive a sweep or a doublet"
    )


def judged(run: Recording, log: Log) -> Recording:
    """The run with its notes on gaps, jitter, saturation and coarse steering."""
    notes = [*run.notes, *_sampling(run), *_saturation(run, log), *_context(run)]
    return replace(run, notes=tuple(dict.fromkeys(notes)))


def _sampling(run: Recording) -> Iterator[Note]:
    for name in ("r", "ay", "p", "pwm", "delta"):
        if name in run:
            yield from _gaps(name, run.manoeuvre(name))


def _gaps(name: str, signal: Signal) -> Iterator[Note]:
    if signal.t.size < 3:
        yield Note("warning", f"{name} has {signal.t.size} samples in the run")
        return
    steps = np.diff(signal.t)
    usual = float(np.median(steps))
    long = np.flatnonzero(steps > GAP * usual)
    if long.size:
        worst = int(np.argmax(steps))
        yield Note(
            "warning",
            f"{name} ({signal.source}) has {long.size} gaps, the longest {steps[worst]:.2f} s at {signal.t[worst]:.1f} s",
        )
    spread = float(np.std(steps[steps <= GAP * usual])) / usual
    if spread > 0.2:
        yield Note(
            "info",
            f"{name} ({signal.source}) is sampled unevenly: {1e3 * usual:.1f} ms +- {100 * spread:.0f} %",
        )


def _saturation(run: Recording, log: Log) -> Iterator[Note]:
    if log.limits and "pwm" in run:
        low, high = log.limits
        x = run.manoeuvre("pwm").x
        share = float(np.mean((x <= low) | (x >= high))) if x.size else 0.0
        if share > 0.001:
            yield Note(
                "warning",
                f"Steering is at its stop ({low:.0f} or {high:.0f} us) {100 * share:.1f} % of the time: lower the amplitude",
            )
    for name, full in (("r", GYRO_RANGE), ("p", GYRO_RANGE), ("ay", ACCEL_RANGE)):
        if (
            name in run
            and run.manoeuvre(name).x.size
            and (peak := float(np.max(np.abs(run.manoeuvre(name).x)))) > 0.98 * full
        ):
            yield Note(
                "warning", f"{name} reaches {peak:.1f}, the sensor's full scale: mount the autopilot softer"
            )


def _context(run: Recording) -> Iterator[Note]:
    steering = run["pwm"] if "pwm" in run else run["delta"]
    if steering.rate < 20:
        yield Note(
            "warning",
            f"Steering comes from {steering.source} at {steering.rate:.0f} Hz: good up to {np.pi * steering.rate * 0.8:.0f} rad/s for "
            "smooth waves, and steps are known to half a sample only; give the .tlog too, or log with the applet",
        )  # fmt: skip
    if not run.standstill:
        yield Note("info", "No standstill was recorded: biases of gyro and accelerometer are unknown")
