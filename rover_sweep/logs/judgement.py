"""Checks of recordings: which are refused, and the warnings on the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import Note, Recording, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.applet import OLD_STATE, OVERRIDE_STATES, applet_runs, is_old
from rover_sweep.logs.log import (
    LOOP,
    STEERING,
    THRUST_LEFT,
    THRUST_RIGHT,
    Log,
    output_channel,
    output_channels,
)
from rover_sweep.logs.wave import HOLE, MOVING_SPEED, active_threshold, hole_notes
from rover_sweep.quality.faults import NO_EXCITATION, with_faults
from rover_sweep.quality.relations import ALL_CHANNELS, relations, stretched_by_applet, stretched_by_arrival
from rover_sweep.quality.rovers import at_both_stops

BOAT, BALANCE_BOT = 2, 3  # FRAME_CLASS (ArduRover 4.6 parameters)
GAP = 3.0  # sampling intervals; a longer interval is a gap
UNLOGGED = 0.25  # s; an output that is logged only while the applet runs has shorter intervals
UNEVEN = 0.2  # standard deviation of the sampling interval over its median
SLOWEST, FASTEST = 1.0, 20e3  # Hz; outside, the unit of time is wrong
SLOWEST_CAR = 0.15  # m/s; small cars are also driven so slowly, and a table is no log of a pushed rover
COARSE = 20.0  # Hz, 5 times the w_max of the paper (25 rad/s)
# rad/s (2000 deg/s), m/s^2: full scale of the usual sensors
GYRO_RANGE, ACCEL_RANGE = 34.9, 16 * STANDARD_GRAVITY


def refuse_useless(log: Log) -> None:
    """Raise DataRefused for a log that cannot hold a usable run, with the value found and what to do."""
    if log.vehicle not in ("rover", "boat", ""):
        raise DataRefused(
            f"{log.name} is the log of a {log.vehicle} ({log.firmware or 'by its heartbeat'}): "
            "only rovers with steered wheels can be identified"
        )
    _refuse_without_wheels(log)
    missing = [
        name for channel, name in (("speed", "speed"), ("r", "yaw rate")) if channel not in log.signals
    ]
    if missing:
        raise DataRefused(
            f"{log.name} holds no {' and no '.join(missing)}: log the IMU and the EKF "
            "(LOG_BITMASK, or the message rates of the link)"
        )
    _refuse_odd_clock(log)
    speed = log.signals["speed"].x
    fastest = float(np.percentile(np.abs(speed), 99)) if speed.size else 0.0
    if fastest < (MOVING_SPEED if log.parameters or log.marks else SLOWEST_CAR):
        raise DataRefused(
            f"{log.name}: the rover never drove (speed up to {fastest:.2f} m/s); give a log of a drive"
        )
    if not log.steering:
        other = ".BIN" if log.arrivals is not None else ".tlog"
        raise DataRefused(
            f"{log.name} holds no steering output (SWEP, SERVO_OUTPUT_RAW or RCOU), or the output was off: "
            f"give also the {other} of the same drive"
        )


def _refuse_without_wheels(log: Log) -> None:
    left, right = (output_channel(log.parameters, function) for function in (THRUST_LEFT, THRUST_RIGHT))
    frame = round(log.parameters.get("FRAME_CLASS", 0))
    seen, possible = "", "only rovers with steered wheels can be identified"
    if left and right and output_channel(log.parameters, STEERING) is None:
        seen = f"SERVO{left}_FUNCTION is 73 and SERVO{right}_FUNCTION is 74: skid steering"
    elif log.parameters.get("SKID_STEER_OUT"):
        seen = "SKID_STEER_OUT is 1: skid steering"
    elif frame in (BOAT, BALANCE_BOT):
        seen = f"FRAME_CLASS is {frame}, a {'boat' if frame == BOAT else 'balance bot'}"
    elif log.vehicle == "boat":
        seen = "the heartbeat is that of a boat"
    if seen.endswith("skid steering"):
        possible = (
            "the bicycle and roll-yaw models do not apply; the lumped model does, from a .csv with the "
            "turning command as pwm, r, ay and p (docs/questions.md)"
        )
    if seen:
        raise DataRefused(f"{log.name} comes from a vehicle without steered wheels ({seen}): {possible}")


def _refuse_odd_clock(log: Log) -> None:
    rate = log.signals["r"].rate
    if rate and rate <= SLOWEST and log.arrivals is not None:
        raise DataRefused(
            f"{log.name}: the yaw rate was received only every {1 / rate:.3g} s; request the streams of the "
            "IMU at 20 Hz or more, or give the vehicle's log (.BIN)"
        )
    if rate and not SLOWEST < rate < FASTEST:
        unit = "ms" if 1 / rate < 100.0 else "us"
        advice = (
            f'is the time in {unit}? give time = {{column = "..", unit = "{unit}"}}'
            if rate < 1
            else "give it in s"
        )
        raise DataRefused(
            f"{log.name}: according to its time the yaw rate was sampled every {1 / rate:.3g} s; {advice}"
        )


def refuse_unexcited(log: Log) -> None:
    """Raise DataRefused for a log of driving in which no run was found."""
    steering, speed = log.steering[0], log.signals["speed"]
    v = np.abs(speed.x)
    slowest = min(MOVING_SPEED, SLOWEST_CAR + 0.5 * float(np.max(v)))
    x = steering.x[np.interp(steering.t, speed.t, v, left=0.0, right=0.0) > slowest]
    seen = f"{np.min(x):.4g} to {np.max(x):.4g} {steering.unit}" if x.size else "not recorded"
    raise DataRefused(
        f"{log.name}: no steering excitation while driving (steering {seen}, "
        "never alternating for some seconds); drive a sweep or a doublet"
    )


def with_notes(run: Recording, log: Log) -> Recording:
    """The run with notes on gaps, sampling, saturation, low steering rate, biases, clocks and faults."""
    notes = (
        *run.notes,
        *hole_notes(run),
        *_unexcited(run),
        *_sampling(run),
        *_unlogged(run, log),
        *_stops(run, log),
        *at_both_stops(run),
        *_full_scale(run),
        *_steering(run, log),
        *_biases(run),
        *_clock(run, log),
    )
    return with_faults(replace(run, notes=tuple(dict.fromkeys(notes))))


def _unexcited(run: Recording) -> Iterator[Note]:
    """The fault of a run without steering; a trial that is a run as a whole may be one."""
    steering = _steering_of(run)
    least = active_threshold(steering)
    if not np.ptp(steering.x) > least:
        yield Note(
            "warning",
            f"no excitation: the steering stays within {least:g} {steering.unit} of "
            f"{np.median(steering.x):.4g} {steering.unit}, so the run shows no response; drive a sweep",
            NO_EXCITATION,
            ALL_CHANNELS,
        )


def _steering_of(run: Recording) -> Signal:
    return run.manoeuvre("delta" if "delta" in run else "pwm")


def _sampling(run: Recording) -> Iterator[Note]:
    """Gaps and uneven sampling, reported once for channels of one message."""
    reported = set()
    for name in ("r", "ay", "p", "vy"):
        if name in run and (message := run[name].source.split(".")[0] or name) not in reported:
            reported.add(message)
            yield from _gaps(message, run.manoeuvre(name))
    steering = _steering_of(run)
    if not steering.hold:
        yield from _gaps(steering.source, steering)


def _unlogged(run: Recording, log: Log) -> Iterator[Note]:
    """Pauses of a logged output: shown by RCOU, which `joined_steering` uses there, or assumed constant."""
    steering = _steering_of(run)
    if not steering.hold:
        return
    steps = np.diff(steering.t)
    longest = float(np.max(steps, initial=0.0))
    if HOLE >= longest > UNLOGGED:
        doubt = ", though the servo may have gone back to trim: log RCOU (LOG_BITMASK), which shows it"
        yield Note(
            "warning",
            f"The steering output ({steering.source}) was not logged for {longest:.2f} s at "
            f"{steering.t[int(np.argmax(steps))]:.1f} s; it is assumed constant there"
            f"{doubt if log.applet is not None else ''}",
        )
    pauses: list[tuple[float, float]] = []  # in which the applet steered and logged nothing
    for rows in applet_runs(log.applet) if log.applet is not None else ():
        steers = rows.state == OLD_STATE if is_old(rows) else np.isin(rows.state, list(OVERRIDE_STATES))
        t = rows.t[steers & (rows.t >= run.span[0]) & (rows.t <= run.span[1])]
        pauses += [(float(t[k]), float(t[k + 1])) for k in np.flatnonzero(np.diff(t) > UNLOGGED)]
    pauses = [(a, b) for a, b in pauses if np.any((steering.t > a + LOOP) & (steering.t < b))]
    if pauses:
        a, b = max(pauses, key=lambda pause: pause[1] - pause[0])
        inside = [log.steering[0].between(*pause).x[:-1] for pause in pauses]
        moved = max(float(np.max(np.abs(x - x[0]))) for x in inside)
        away = moved > active_threshold(steering)
        yield Note(
            "warning" if away else "info",
            f"The applet did not log the steering in {len(pauses)} pause{'s' * (len(pauses) > 1)}, "
            f"the longest of {b - a:.2f} s at {a:.1f} s; RCOU, which is used there, shows that the servo "
            f"{f'moved by up to {moved:.0f} us' if away else 'kept its position'}",
        )


def _gaps(source: str, signal: Signal) -> Iterator[Note]:
    if signal.t.size < 3:
        yield Note("warning", f"{source} has only {signal.t.size} samples in the run")
        return
    steps = np.diff(signal.t)
    usual = float(np.median(steps))
    gaps = (steps > GAP * usual) & (steps <= max(HOLE, GAP * usual))  # longer ones are reported as holes
    if np.any(gaps):
        worst = int(np.argmax(np.where(gaps, steps, 0.0)))
        yield Note(
            "warning",
            f"{source} has {int(gaps.sum())} gaps (more than {1e3 * GAP * usual:.0f} ms), "
            f"the longest {steps[worst]:.2f} s at {signal.t[worst]:.1f} s",
        )
    spread = float(np.std(steps[steps <= GAP * usual])) / usual
    if spread > UNEVEN:
        yield Note(
            "info", f"{source} is sampled unevenly: every {1e3 * usual:.1f} ms +- {100 * spread:.0f} %"
        )


def _stops(run: Recording, log: Log) -> Iterator[Note]:
    """Steering at the end of the servo's travel."""
    if log.limits is None or "pwm" not in run:
        return
    low, high = log.limits
    x = run.manoeuvre("pwm").x
    share = float(np.mean((x <= low) | (x >= high))) if x.size else 0.0
    if share > 0:
        yield Note(
            "warning",
            f"Steering is at its end stop ({low:.0f} or {high:.0f} us) in {100 * share:.1f} % of the "
            "samples: reduce the amplitude",
        )


def _full_scale(run: Recording) -> Iterator[Note]:
    for name, full in (("r", GYRO_RANGE), ("p", GYRO_RANGE), ("ay", ACCEL_RANGE)):
        peak = float(np.max(np.abs(run.manoeuvre(name).x), initial=0.0)) if name in run else 0.0
        if peak > 0.98 * full:
            deg = ', or give unit = "deg/s" if these are degrees' if run[name].unit == "rad/s" else ""
            yield Note(
                "warning",
                f"{name} reaches {peak:.1f} {run[name].unit}, the sensor's full scale: "
                f"mount the autopilot on softer material{deg}",
            )


def _steering(run: Recording, log: Log) -> Iterator[Note]:
    """Steering recorded too slowly; four-wheel steering, which looks like two servos on one axle."""
    steering = _steering_of(run)
    if not steering.hold and 0 < steering.rate < COARSE:
        yield Note(
            "warning",
            f"Steering ({steering.source}) was recorded at {steering.rate:.0f} Hz: it resolves a smooth wave "
            f"up to {0.8 * np.pi * steering.rate:.0f} rad/s, and the time of a step only to "
            f"{500 / steering.rate:.0f} ms; no LOG_BITMASK logs it faster: give also the .tlog, "
            "or log with the applet",
        )
    outputs = output_channels(log.parameters, STEERING)
    if len(outputs) > 1:
        names = " and ".join(f"SERVO{n}_FUNCTION" for n in outputs)
        yield Note(
            "warning",
            f"{names} are {STEERING}: several outputs steer. If they turn front and rear wheels (four-wheel "
            "steering), use only the lumped model (identify --models lumped, diagnose --baseline lumped)",
        )


def _biases(run: Recording) -> Iterator[Note]:
    if not run.standstill:
        of = "biases of gyro and accelerometer are" if "ay" in run else "bias of the gyro is"
        yield Note("info", f"No standstill was recorded, so the {of} not known")


def _clock(run: Recording, log: Log) -> Iterator[Note]:
    """Faults of the run's clock, compared with the applet's or the telemetry recorder's."""
    if log.applet is not None:
        for own in applet_runs(log.applet):
            inside = (own.t >= run.span[0]) & (own.t <= run.span[1]) & (own.clock > 0)
            yield from stretched_by_applet(own.t[inside], own.clock[inside])
    elif log.arrivals is not None:
        t, arrival = log.arrivals
        inside = (t >= run.span[0]) & (t <= run.span[1])
        yield from stretched_by_arrival(t[inside], arrival[inside], relations(run).heading)
