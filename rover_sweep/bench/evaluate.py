"""Evaluates a bench's folder, right after the bench or later."""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, hypot, isnan, nan
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.bench.bench_folder import (
    DESCRIPTION,
    TELEMETRY,
    WHEEL_CSV,
    WHEEL_TLOG,
    AngleReading,
    BenchFolder,
    BenchResult,
)
from rover_sweep.bench.by_wheel import (
    USUAL,
    Command,
    Wheel,
    arrivals,
    by_wheel,
    read_wheel,
    wheel_of_telemetry,
)
from rover_sweep.bench.static_curve import curve, static_numbers, wheel_behind_gap
from rover_sweep.bench.steering_output import SteeringOutput
from rover_sweep.data.recording import Array
from rover_sweep.data.results import LEVEL
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.errors import DataRefused, LinkError
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message, kind
from rover_sweep.vehicle.run.controls import MANUAL

# Angles read by hand at a staircase of PWM: the static curve and the play. Pure.


LEAST_READINGS = 5
LEVELS_FOR_CURVE = 3  # levels on each side that a deadband and a curvature need
# Standard deviations (priors) wider than any steering has. Without them a few noisy angles at small steps
# would bend the curve more than any linkage does.
HAND = 0.009  # rad, first guess of the noise of one angle, for the weight of the priors
NOT_BY_HAND = "servo_lag, servo_delay and servo_rate_limit cannot be read by hand: they need --wheel-imu"


@dataclass(frozen=True)
class Readings:
    """In the order in which they were taken: pwm (n,) us, angle (n,) rad left positive, NaN where none was
    read there. start: PWM [us] at which the steering began."""

    pwm: Array
    angle: Array
    start: float


def by_hand(readings: Readings, trim: float) -> BenchResult:
    """Fit the numbers; trim: SERVOn_TRIM [us], the starting value. DataRefused for too few readings."""
    from scipy.optimize import least_squares
    from scipy.stats import t as student

    read = np.isfinite(readings.angle)
    pwm, angle = readings.pwm, readings.angle
    left, right = _levels(trim - pwm[read]), _levels(pwm[read] - trim)
    names = ["k", "trim", "b", *(["e"] if left and right else [])]
    if min(left, right) >= LEVELS_FOR_CURVE:
        names += ["c3", "w"]
    if read.sum() < max(LEAST_READINGS, len(names) + 1) or np.ptp(pwm[read]) < 1:
        raise DataRefused(
            f"{read.sum()} angles were read, at {left} levels to the left and {right} to the right; at least "
            f"{max(LEAST_READINGS, len(names) + 1)} are needed, on both sides"
        )
    slope = float(np.polyfit(pwm[read] - trim, angle[read], 1)[0])
    scale = {"k": abs(slope), "trim": 10.0, "b": 0.01, "e": 0.05, "c3": 1.0, "w": 0.01}
    start = {"k": -slope, "trim": trim, "b": 0.005, "e": 0.0, "c3": 0.0, "w": 0.0}
    path = np.concatenate(([readings.start], pwm))

    def model(x: Array) -> Array:
        q = {**dict.fromkeys(scale, 0.0), **dict(zip(names, x, strict=True))}
        servo = curve(-q["k"] * (path - q["trim"]), q["e"], q["c3"], q["w"])
        return wheel_behind_gap(servo, max(q["b"], 0.0))[1:]

    low = np.array([0.0 if n == "b" else -np.inf for n in names])
    prior = np.array([1.0 / USUAL[n] if n in USUAL else 0.0 for n in names])
    free, noise = int(read.sum()) - len(names), HAND
    for _ in range(2):  # the second time with the noise that these readings have
        weight = noise * prior
        done = least_squares(
            lambda x, weight=weight: np.concatenate(((model(x) - angle)[read], weight * x)),
            [start[n] for n in names],
            x_scale=[scale[n] for n in names],
            bounds=(low, np.inf),
            diff_step=1e-4,
        )
        misfit = done.fun[: int(read.sum())]
        noise = float(np.sqrt(misfit @ misfit / free))
    covariance = noise**2 * np.linalg.pinv(done.jac.T @ done.jac)
    factor = float(student.ppf(0.5 + LEVEL / 2, free))
    reach = float(np.min([np.max(pwm[read]) - trim, trim - np.min(pwm[read])])) if left and right else 0.0
    numbers = static_numbers(names, done.x, covariance, factor, max(reach, float(np.ptp(pwm[read])) / 2))
    untold = [NOT_BY_HAND]
    if "w" not in names:
        untold.append(
            f"deadband and nonlinearity need {LEVELS_FOR_CURVE} sizes of steps, read on both sides; for "
            "example --steps 50,100,150"
        )
    if "e" not in names:
        untold.append("asymmetry needs angles on both sides")
    remarks = (
        f"reading error of an angle: {np.degrees(noise):.2g} deg (scatter about the curve)",
        "backlash includes the error with which the servo stops short: at rest the two cannot be separated",
    )
    return BenchResult("by hand", numbers, tuple(untold), remarks, noise, int(read.sum()))


def _levels(offset: Array) -> int:
    """Number of different levels above 0; offset (n,) us."""
    return len({round(x / 5.0) for x in offset.tolist() if x > 5.0})


# Checks with every message that the rover is at rest, disarmed, in MANUAL, with the throttle at rest.


MOVING = 0.5  # m/s; a GPS at rest shows up to about 0.2
FIX_3D = 3  # GPS_FIX_TYPE
ASTRAY = 12.0  # us that the output may differ from what was asked for


class NotAtStandstill(LinkError):
    """The steering must not move, and is released; the sentence says why."""


@dataclass
class Standstill:
    """A listener of the link. pwm: steering output [us]; speed [m/s]; throttle: stick [us]; NaN: unknown."""

    link: Link
    output: SteeringOutput
    pwm: float = nan
    speed: float = nan
    throttle: float = nan

    def __call__(self, message: Message) -> None:
        name = kind(message)
        if name == "SERVO_OUTPUT_RAW":
            self.pwm = float(getattr(message, f"servo{self.output.servo}_raw"))
        elif name == "RC_CHANNELS":
            self.throttle = float(getattr(message, f"chan{self.output.throttle_channel}_raw"))
        elif name == "GPS_RAW_INT":
            fixed = message.fix_type >= FIX_3D and message.vel != 65535
            self.speed = 0.01 * message.vel if fixed else nan
        elif name == "LOCAL_POSITION_NED":
            self.speed = hypot(message.vx, message.vy)

    @property
    def why_not(self) -> str:
        """Why the steering must not move, in a sentence; '' if it may."""
        if self.link.armed:
            return "the rover is armed; disarm it for the bench, so that its motor cannot turn"
        if self.link.mode != MANUAL:
            return f"the rover is not in MANUAL (mode {self.link.mode})"
        if self.speed > MOVING:
            return f"the rover moves ({self.speed:.1f} m/s); it must be at rest, front wheels off the ground"
        if isnan(self.pwm) or isnan(self.throttle):
            return "the rover does not send SERVO_OUTPUT_RAW and RC_CHANNELS; is the link too slow?"
        if self.throttle == 0:
            return "the rover has no radio; the pilot must be able to stop the bench with the mode switch"
        if abs(self.throttle - self.output.throttle_trim) > self.output.throttle_zone:
            return (
                f"the throttle stick is not at rest ({self.throttle:.0f} us, rest "
                f"{self.output.throttle_trim:.0f}); this program does not touch it, center it on the radio"
            )
        return ""

    def require(self) -> None:
        """NotAtStandstill if the steering must not move, or must stop."""
        if why := self.why_not:
            raise NotAtStandstill(why)


def evaluate(
    folder: BenchFolder, vehicle: Vehicle | None, wheel: Path | None = None, same_clock: bool | None = None
) -> BenchResult:
    """The result of a bench. wheel: a file of the wheel's IMU, else the folder's; same_clock: whether it
    is on the rover's clock, as the folder says if None. DataRefused for too few data."""
    content = folder.description()
    trim = float(content["steering_output"]["trim"])
    sign = copysign(1.0, vehicle.rad_per_us.value) if vehicle and vehicle.rad_per_us else None
    used = content.get("wheel")
    if wheel is None and not used:
        return by_hand(_in_order(folder.readings()), trim)
    if vehicle is not None and vehicle.trim_us is not None:
        trim = vehicle.trim_us.value
    command, ahead = _command(folder, content, trim)
    if same_clock is None:
        same_clock = bool(used and used.get("same_clock"))
    return by_wheel(command, _wheel(folder, wheel, same_clock, ahead), sign)


def _in_order(readings: tuple[AngleReading, ...]) -> Readings:
    """The readings in order, each with its measured PWM, or without one, with the commanded PWM."""
    if not readings:
        raise DataRefused("no angle was read in this bench, so there is nothing to evaluate")
    pwm = np.array([r.pwm for r in readings])
    return Readings(pwm, np.array([r.angle for r in readings]), readings[0].pwm - readings[0].offset)


def _command(folder: BenchFolder, content: dict[str, Any], trim: float) -> tuple[Command, float]:
    """The steering output on the rover's clock, and the lag of that clock behind ours [s]."""
    from rover_sweep.logs.readers.tlog import open_tlog
    from rover_sweep.logs.readers.vehicle_clock import CLOCKS, sessions

    path = folder.path / TELEMETRY
    if not path.is_file():
        raise DataRefused(f"{folder.path} has no {TELEMETRY}: the steering was not recorded")
    log = open_tlog(path, frozenset({"SERVO_OUTPUT_RAW", *CLOCKS}))
    held = [s for s in sessions(log.messages) if "SERVO_OUTPUT_RAW" in s.messages]
    if not held:
        raise DataRefused(f"{path} has no SERVO_OUTPUT_RAW with a clock: the steering was not recorded")
    session = held[-1]
    frames = session.messages["SERVO_OUTPUT_RAW"]
    t = session.seconds("SERVO_OUTPUT_RAW")
    servo = content["steering_output"]["servo"]
    pwm = frames.rows[f"servo{servo}_raw"].astype(float)
    ahead = float(np.min(arrivals(path, frames.order) - t))
    keep = np.concatenate(([True], np.diff(t) > 0)) & (pwm > 0)
    if keep.sum() < 2:
        raise DataRefused(f"{path} holds no PWM of SERVO{servo}, which steers according to {DESCRIPTION}")
    return Command(t[keep], pwm[keep], trim), ahead


def _wheel(folder: BenchFolder, given: Path | None, same_clock: bool, ahead: float) -> Wheel:
    if given is not None:
        return read_wheel(given, same_clock)
    if (folder.path / WHEEL_TLOG).is_file():
        return wheel_of_telemetry(folder.path / WHEEL_TLOG, ahead)
    if not (folder.path / WHEEL_CSV).is_file():
        raise DataRefused(
            f"{folder.path} has no record of the wheel; give it with "
            f"`bench --from {folder.path} --wheel-imu FILE`"
        )
    return read_wheel(folder.path / WHEEL_CSV, same_clock)
