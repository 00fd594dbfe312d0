"""The demands of a manoeuvre on servo, space, tyres, sampling rates and filters, before it is driven.

Numbers only; `rover_sweep.design.advice` adds the sentences.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, LowPass, Note
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Manoeuvre, Sweep, ThrottleSweep, long_periods
from rover_sweep.spectra.response import default_windows

HORN_DEG_PER_US = 0.09  # a hobby servo turns its horn by about 90 deg from 1000 to 2000 us
SERVO_60_DEG = (0.1, 0.2)  # s, typical data-sheet times for 60 deg without load, fast and slow
FRICTION = (0.5, 0.9)  # loose or wet ground, clean dry asphalt
LEAST_SAMPLES, GOOD_SAMPLES = 10, 20  # per period of the highest frequency
APPLET_RATE = 84.0  # Hz, at which the applet sets the servo; measured on ArduRover 4.6.3
SERVO_FRAMES = 50.0  # Hz, default of SERVO_RATE
FILTER_MARGIN = 5.0  # cut-off over highest frequency: 16 deg of lag and no loss of gain
TRIM_ERROR = 10.0  # us; nobody steers during a sweep, so a trim error curves the whole path
DOUBLET_PEAK = 2.331  # rad: a doublet's spectrum peaks where w times pulse is this, tan(x/2) = x

LANE = 4.0  # m, width for a pilot who steers straight ahead


@dataclass(frozen=True)
class Windows:
    """Window lengths of the identification [s]; lowest: the frequency that the longest resolves [rad/s].

    t_min, t_max: 20 (2 pi/w_max) and min(T_rec/2, T_F/5) (Tischler & Remple 2012, chapter 10); lengths: those
    that `identify` uses, longer than t_max where that does not resolve w_min.
    """

    t_min: float
    t_max: float
    lengths: tuple[float, ...]
    lowest: float


@dataclass(frozen=True)
class ServoDemand:
    """Peak rates: us_s at the servo output [us/s], None for the steps of a doublet; horn_deg_s [deg/s].

    step_s: time of a typical servo (fast, slow) from one peak to the other [s]. wheel_deg: peak
    road-wheel angle [deg], wheel_deg_s: its peak rate [deg/s], None without a vehicle file.
    """

    us_s: float | None
    horn_deg_s: float | None
    step_s: tuple[float, float]
    wheel_deg: float | None
    wheel_deg_s: float | None


@dataclass(frozen=True)
class Space:
    """Ground needed at `speed` [m/s], from the kinematic path; forward, back, left, right of the start [m].

    farthest: largest distance from the start with a trim error of up to +-TRIM_ERROR [m]. heading_deg: span
    of the heading; heading_end_deg: final minus initial heading, left positive.
    yaw_rate_deg_s, ay: peaks [deg/s, m/s^2]; radius: turning radius at the amplitude [m].
    """

    speed: float
    forward: float
    back: float
    left: float
    right: float
    farthest: float
    path: float
    heading_deg: float
    heading_end_deg: float
    yaw_rate_deg_s: float
    ay: float
    radius: float

    @property
    def length(self) -> float:
        """Extent along the initial heading, m."""
        return self.forward + self.back

    @property
    def width(self) -> float:
        """Extent across the initial heading, m."""
        return self.left + self.right


@dataclass(frozen=True)
class Rates:
    """Sampling: least and good rate of log and telemetry [Hz]; stream: the fastest that `loop` allows [Hz].

    loop_needed: the lowest usual SCHED_LOOP_RATE [Hz] that gives the good rate, None if none does.
    """

    least: float
    good: float
    loop: float
    stream: float
    loop_needed: int | None


@dataclass(frozen=True)
class FilterLoss:
    """Gain and lag of a sensor's low-pass at the highest frequency; advised_hz: better cut-off [Hz]."""

    parameter: str
    cutoff_hz: float
    gain: float
    lag_deg: float
    lag_ms: float
    advised_hz: float


@dataclass(frozen=True)
class Design:
    """A manoeuvre and its demands. w_top: highest frequency of interest [rad/s]; duration of a run [s]."""

    manoeuvre: Manoeuvre
    runs: int
    duration: float
    w_top: float
    long_periods: float | None
    windows: Windows | None
    servo: ServoDemand
    space: Space | None
    rates: Rates
    filters: tuple[FilterLoss, ...]
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True, eq=False)
class Path:
    """Track from the start, x forward, y left [m]; psi heading [rad], r yaw rate [rad/s]; all (n,)."""

    t: Array
    x: Array
    y: Array
    psi: Array
    r: Array


def make_design(
    manoeuvre: Manoeuvre,
    vehicle: Vehicle | None = None,
    speed: float | None = None,
    runs: int = 2,
    loop_rate: float = 50.0,
    gyro_filter: float = 4.0,
    accel_filter: float = 10.0,
) -> Design:
    """A Design without its notes. speed [m/s]; runs: sweeps identified together; rates and cut-offs in Hz.

    The defaults of loop_rate and filters are those of ArduRover. UsageError when speed and vehicle are given
    but the vehicle file has no [steering].
    """
    sweep = manoeuvre if isinstance(manoeuvre, Sweep) else None
    banded = manoeuvre if isinstance(manoeuvre, Sweep | Multisine) else None
    # the final frequency of a sweep, the highest line of a multisine, the main lobe of a doublet
    if isinstance(manoeuvre, Sweep):
        top = float(manoeuvre.rate(manoeuvre.t_rec))
    elif isinstance(manoeuvre, Multisine):
        top = manoeuvre.base * float(manoeuvre.lines[-1])
    else:
        top = 2 * math.pi / manoeuvre.pulse
    return Design(
        manoeuvre=manoeuvre,
        runs=runs,
        duration=manoeuvre.duration,
        w_top=top,
        long_periods=long_periods(sweep) if sweep else None,
        windows=windows(banded, runs) if banded else None,
        servo=servo_demand(manoeuvre, vehicle),
        space=space(manoeuvre, vehicle, speed) if vehicle and speed else None,
        rates=rates(top, loop_rate),
        filters=(
            filter_effect("INS_GYRO_FILTER", gyro_filter, top),
            filter_effect("INS_ACCEL_FILTER", accel_filter, top),
        ),
    )


def wave(manoeuvre: Manoeuvre, rate: float = 200.0) -> tuple[Array, Array]:
    """(t, offset) of the override, s and us, (n,) each at `rate` Hz."""
    t = np.arange(int(manoeuvre.duration * rate) + 1) / rate
    return t, manoeuvre.wave(t)


def wave_spectrum(manoeuvre: Manoeuvre, w: Array) -> Array:
    """Amplitude spectrum |integral of wave e^-jwt dt| at w [rad/s], us s, (n_w,)."""
    t, x = wave(manoeuvre)
    step = t[1] - t[0]
    return np.array([abs(np.dot(x, np.exp(-1j * frequency * t))) * step for frequency in w])


def spectrum_grid(design: Design, points: int) -> Array:
    """Log-spaced frequencies (points,) [rad/s]: slightly more than a swept band, or a doublet's lobes."""
    m = design.manoeuvre
    if isinstance(m, Sweep | Multisine):
        return np.geomspace(m.w_min / 1.5, m.w_max * 1.5, points)
    return np.geomspace(0.2 / m.pulse, 8 / m.pulse, points)


def windows(sweep: Sweep | Multisine, runs: int) -> Windows:
    """Window lengths for `runs` such sweeps or multisines identified together."""
    driven = sweep.duration - 2 * sweep.straight
    t_max = min(sweep.t_rec / 2, runs * driven / 5)
    lengths = default_windows(sweep.w_min, sweep.w_max, runs * driven, sweep.t_rec)
    return Windows(20 * 2 * math.pi / sweep.w_max, t_max, lengths, 2 * math.pi / max(lengths))


def servo_demand(manoeuvre: Manoeuvre, vehicle: Vehicle | None) -> ServoDemand:
    """Peak rates of the manoeuvre at servo, horn and wheel."""
    slew = manoeuvre.peak_slew if isinstance(manoeuvre, Sweep | Multisine) else None
    swing = 2 * manoeuvre.amplitude * HORN_DEG_PER_US / 60
    scale = math.degrees(abs(vehicle.rad_per_us.value)) if vehicle and vehicle.rad_per_us else None
    return ServoDemand(
        us_s=slew,
        horn_deg_s=slew and slew * HORN_DEG_PER_US,
        step_s=(swing * SERVO_60_DEG[0], swing * SERVO_60_DEG[1]),
        wheel_deg=scale and scale * manoeuvre.peak,
        wheel_deg_s=scale and slew and scale * slew,
    )


def simulated_track(manoeuvre: Manoeuvre, vehicle: Vehicle, speed: float, trim_error: float = 0.0) -> Path:
    """The track with the kinematic yaw rate r = V tan(delta)/(a + b); speed m/s, trim_error us.

    Sideslip and servo lag are neglected; at high frequency they make the true path slightly smaller.
    """
    t, offset = wave(manoeuvre)
    _, scale = vehicle.steering()
    r = speed * np.tan(-(offset + trim_error) * scale) / vehicle.wheelbase
    psi = _integral(t, r)
    return Path(t, _integral(t, speed * np.cos(psi)), _integral(t, speed * np.sin(psi)), psi, r)


def space(manoeuvre: Manoeuvre, vehicle: Vehicle, speed: float) -> Space:
    """Ground, yaw rate and lateral acceleration of the manoeuvre at `speed` m/s.

    A throttle sweep is driven straight ahead.
    """
    if isinstance(manoeuvre, ThrottleSweep):
        length = speed * manoeuvre.duration
        return Space(speed, length, 0.0, LANE / 2, LANE / 2, length, length, 0.0, 0.0, 0.0, 0.0, math.inf)
    path = simulated_track(manoeuvre, vehicle, speed)
    bent = [simulated_track(manoeuvre, vehicle, speed, error) for error in (-TRIM_ERROR, TRIM_ERROR)]
    r = float(np.max(np.abs(path.r)))
    return Space(
        speed=speed,
        forward=float(path.x.max()),
        back=0.0 - float(path.x.min()),
        left=float(path.y.max()),
        right=0.0 - float(path.y.min()),
        farthest=max(float(np.hypot(p.x, p.y).max()) for p in (path, *bent)),
        path=speed * manoeuvre.duration,
        heading_deg=math.degrees(float(np.ptp(path.psi))),
        heading_end_deg=math.degrees(float(path.psi[-1])),
        yaw_rate_deg_s=math.degrees(r),
        ay=speed * r,
        radius=speed / r,
    )


def rates(w_top: float, loop_rate: float) -> Rates:
    """Rates for w_top [rad/s] under SCHED_LOOP_RATE [Hz]."""
    least, good = (n * w_top / (2 * math.pi) for n in (LEAST_SAMPLES, GOOD_SAMPLES))
    enough = (loop for loop in (50, 100, 200, 300, 400) if fastest_stream(loop) >= good)
    return Rates(least, good, loop_rate, fastest_stream(loop_rate), next(enough, None))


def fastest_stream(loop_rate: float) -> float:
    """Highest rate [Hz] that ArduPilot accepts in SET_MESSAGE_INTERVAL at a SCHED_LOOP_RATE [Hz].

    0.8 of the loop rate, its interval cut to whole ms (GCS_MAVLINK::cap_message_interval). Measured on
    ArduRover 4.6.3: 40 Hz at loop 50, 333 Hz at loop 400.
    """
    return 1000.0 / max(1, int(1250.0 / loop_rate))


def filter_effect(parameter: str, cutoff_hz: float, w_top: float) -> FilterLoss:
    """Gain and lag of ArduPilot's second-order low-pass at w_top [rad/s]; advised in steps of 5 Hz."""
    h = complex(LowPass(cutoff_hz).response(np.array([w_top]))[0])
    lag = -math.degrees(math.atan2(h.imag, h.real))
    advised = 5 * math.ceil(FILTER_MARGIN * w_top / (2 * math.pi) / 5 - 0.01)
    return FilterLoss(parameter, cutoff_hz, abs(h), lag, 1000 * math.radians(lag) / w_top, float(advised))


def _integral(t: Array, x: Array) -> Array:
    return np.concatenate(([0.0], np.cumsum((x[1:] + x[:-1]) / 2 * np.diff(t))))
