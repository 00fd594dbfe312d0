"""A model with effects, driven by the recorded steering and speed of a run: the log that it predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import exp, pi, sin, sqrt
from typing import Any

import numpy as np
from numba import njit
from scipy.fft import irfft, next_fast_len, rfft

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array, LowPass
from rover_sweep.diagnosis.effects.effect import (
    FilterEffect,
    ForceEffect,
    GripEffect,
    SensorEffect,
    ServoEffect,
    StateForceEffect,
    SteeringEffect,
    Values,
    VehicleEffect,
)
from rover_sweep.diagnosis.simulation import candidates as lumped_baseline
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import FINE, RATE, Experiment
from rover_sweep.diagnosis.simulation.single_track import (
    AT,
    FAST,
    VehicleNumbers,
    single_track_with_laws,
    single_tracks,
)
from rover_sweep.diagnosis.simulation.table_law import law_numbers

# The road-wheel angle of a run: the commanded one through delay, command, servo, linkage and trim.


STEP = 1.0 / RATE
WHEEL = ("scale", "delay", "lag", "lag_shape", "trim")  # coordinates of the wheel angle


def wheel_angle(run: Experiment, model: Model, x: Values) -> Array:
    """Road-wheel angle (n,) rad from the commanded one through delay, command, servo, linkage and trim.

    The run caches the last eight, since most Jacobian columns share one. Do not write to the result.
    """
    limits = {name: value for e in model.of(ServoEffect) for name, value in e.numbers(x).items()}
    acting = model.of(SteeringEffect)
    laws = tuple((e.act, *e.coordinates(x).items()) for e in acting)
    key = (laws, tuple(limits.items()), *(x.get(name, 0.0) for name in WHEEL))
    found = run.angles.get(key)
    if found is None:
        if len(run.angles) >= 8:
            run.angles.clear()
        d = late(run.fine_steer * (1.0 + x.get("scale", 0.0)), x.get("delay", 0.0) * FINE * RATE)
        for effect in (e for e in acting if e.before_servo):
            d = effect.act(d, effect.coordinates(x))
        lag, shape = max(x.get("lag", 0.0), 0.0), x.get("lag_shape", 0.0)
        d = servo(d, lag, shape, limits.get("inv_rate", 0.0), STEP / FINE)[::FINE].copy()
        for effect in (e for e in acting if not e.before_servo):
            d = effect.act(d, effect.coordinates(x))
        found = run.angles[key] = d - x.get("trim", 0.0)
    return found


def late(u: Array, shift: float) -> Array:
    """u (n,) delayed by `shift` samples, a cubic through four samples between them."""
    if shift == 0.0:
        return u
    whole = int(np.floor(shift))
    x = shift - whole
    padded = np.pad(u, (abs(whole) + 2, abs(whole) + 2), "edge")
    first = abs(whole) + 2 - whole  # of u[k - whole] in the padded signal
    at = [padded[first - j : first - j + u.size] for j in (-1, 0, 1, 2)]
    weights = (
        -x * (x - 1.0) * (x - 2.0) / 6.0,
        (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
        -(x + 1.0) * x * (x - 2.0) / 2.0,
        (x + 1.0) * x * (x - 1.0) / 6.0,
    )
    return np.asarray(sum(w * part for w, part in zip(weights, at, strict=True)))


SENSED = {"bias_ay", "imu_x", "imu_z", "ay_lag", "p_lag", "vy_lag", "vy_gain", "heading"}  # act on a log only


def motion(run: Experiment, model: Model, x: Values) -> dict[str, Array]:
    """The motion {name: (n,)}, ISO axes, SI units.

    t, V (speed), psi (heading), delta (road-wheel angle), v_dot_x (V'), ms_h (ms h), v (lateral velocity at
    the roll axis), r, phi, p, across (v' + V r), r_dot, p_dot, weight (see `_weight`).
    """
    return motions([(run, x)], model)[0]


def motions(drives: Sequence[tuple[Experiment, Values]], model: Model) -> list[dict[str, Array]]:
    """The `motion` of each run with its coordinates; two of them take as long as one."""
    bases = []
    for run, x in drives:
        scale, delta = 1.0 + x.get("vscale", 0.0), wheel_angle(run, model, x)
        more = x.get("speed_share", 1.0) - run.share
        speed = scale * (run.speed + more * run.unsure)
        v_dot_x = scale * (run.acceleration + more * run.unsure_acceleration)
        bases.append({"t": run.t, "psi": run.heading, "delta": delta, "V": speed, "v_dot_x": v_dot_x})
    if model.lumped:
        return [_lumped(base, model, x) for (_, x), base in zip(drives, bases, strict=True)]
    cars = [_car(run, model, x, base) for (run, x), base in zip(drives, bases, strict=True)]
    if not model.slip:
        return [_without_slip(model, car) for car in cars]
    pairs = [cars[k : k + 2] for k in range(0, len(cars), 2)]
    return [found for pair in pairs for found in _with_slip(model, pair)]


@dataclass(frozen=True, eq=False)
class _Car:
    """The rover in one drive: coordinates x, numbers q, factor of grip (n,), and known motion."""

    x: Values
    base: dict[str, Array]
    q: VehicleNumbers
    grip: Array


def _car(run: Experiment, model: Model, x: Values, base: dict[str, Array]) -> _Car:
    q = vehicle_numbers(model, x)
    grip = np.ones(run.t.size)
    known = base | {"driven": run.driven + run.t}
    for effect in model.of(GripEffect):
        if not effect.in_one_run or model.happened_in in ("", run.name):
            grip = grip * effect.act(known, effect.coordinates(x))
        elif effect.later and model.happened_order < run.order:
            grip = grip * effect.later(effect.coordinates(x))
    return _Car(x, base | {"ms_h": np.full(run.t.size, q.ms * q.h)}, q, grip)  # kg m, about the roll axis


def _with_slip(model: Model, pair: Sequence[_Car]) -> list[dict[str, Array]]:
    """The motions of one or two cars on tyres."""
    forces, laws = model.of(ForceEffect), model.of(StateForceEffect)
    drives = []
    for car in pair:
        pushed = _pushed(forces, car.base, car.x, model.rover.mass)
        drives.append((car.base["delta"], car.base["V"], car.grip, *pushed, np.array(car.q)))
    relaxed = [car.q.sigma > 1e-6 for car in pair]
    if laws:
        both = tuple(
            single_track_with_laws(drive, law_numbers(laws, car.base, car.x), late, model.roll, STEP)
            for drive, car, late in zip(drives, pair, relaxed, strict=True)
        )
    else:
        both = single_tracks(drives[0], drives[-1], (relaxed[0], relaxed[-1]), model.roll, STEP)
    names = ("v", "r", "phi", "p", "across", "r_dot", "p_dot")
    found = [car.base | dict(zip(names, y, strict=True)) for car, y in zip(pair, both, strict=False)]
    return [y | {"weight": _weight(model, y, car.x)} for car, y in zip(pair, found, strict=True)]


def _lumped(base: dict[str, Array], model: Model, x: Values) -> dict[str, Array]:
    rover = model.rover
    base = base | {"ms_h": np.full(base["t"].size, (rover.sprung_mass or 0.0) * (rover.h or 0.0))}
    weight = _weight(model, base, x)
    return base | lumped_baseline.motion(base["delta"], base["V"], weight, x, STEP) | {"weight": weight}


def _weight(model: Model, found: Mapping[str, Array], x: Values) -> Array:
    """Lateral part of the weight per mass (n,) m/s^2, which an accelerometer does not measure."""
    heavy = tuple(e for e in model.of(ForceEffect) if e.weight)
    return np.asarray(_pushed(heavy, found, x, model.rover.mass)[0] / model.rover.mass)


def _pushed(forces: tuple[ForceEffect, ...], found: Mapping[str, Array], x: Values, mass: float) -> Array:
    """Side force [N], yaw and roll moment [N m] (3, n) of these effects in a motion."""
    out = np.zeros((3, found["t"].size))
    for effect in forces:
        for row, part in zip(out, effect.act(found, effect.coordinates(x), mass), strict=True):
            row += part
    return out


def _without_slip(model: Model, car: _Car) -> dict[str, Array]:
    """Kinematic motion without sideslip, as in ArduPilot's SITL rover: r = V tan(d)/L, a_y = V r."""
    rover, base, x = model.rover, car.base, car.x
    length = exp(x["ln_L_eff"]) if "ln_L_eff" in x else rover.wheelbase
    r = base["V"] * np.tan(base["delta"]) / length
    r_dot = np.gradient(r, STEP)
    across = base["V"] * r
    zero = np.zeros(r.size)
    y = roll_only(across, r_dot, np.array(car.q), STEP) if model.roll else np.zeros((r.size, 3))
    return base | {
        "v": zero,
        "r": r,
        "r_dot": r_dot,
        "across": across,
        "phi": y[:, 0],
        "p": y[:, 1],
        "p_dot": y[:, 2],
        "weight": _weight(model, base, x),
    }


def vehicle_numbers(model: Model, x: Values) -> VehicleNumbers:
    """Numbers of the compiled kernel at the coordinates x."""
    rover = model.rover
    da = x.get("da", 0.0)
    stiffness, split = exp(x.get("ln_C", 0.0)), 0.5 * x.get("ln_ratio", 0.0)
    numbers = VehicleNumbers(
        m=rover.mass,
        ms=rover.sprung_mass or 0.0,
        h=(rover.h or 0.0) * exp(x.get("ln_h", 0.0)),
        Ixx=(rover.roll_inertia or 0.0) * exp(x.get("ln_Ixx", 0.0)),
        Izz=exp(x.get("ln_Izz", 0.0)),
        Ixz=rover.roll_yaw_inertia,
        a=rover.a + da,
        b=rover.b - da,
        Cf=stiffness * exp(split),
        Cr=stiffness * exp(-split),
        k_phi=exp(x.get("ln_k_phi", 0.0)),
        b_phi=exp(x.get("ln_b_phi", 0.0)),
        g=GRAVITY,
        bend=x.get("bend", 0.0),
        track=x.get("track", 0.0),
    )
    added: dict[str, float] = {}
    for effect in model.of(VehicleEffect):
        added |= effect.numbers(x)
    q, inertia = numbers._replace(**added), rover.yaw_inertia or rover.mass * rover.a * rover.b
    # these coordinates have no unit
    return q._replace(
        compliance=q.compliance / q.Cf, yaw_damp=q.yaw_damp * inertia, yaw_damp_v=q.yaw_damp_v * inertia
    )


def sensed(run: Experiment, model: Model, x: Values, moved: Mapping[str, Array]) -> Mapping[str, Array]:
    """{channel: (n,)} of the sensors before any low-pass: r, p, and ay, vy at the IMU."""
    # the V_y of the derivatives is the measured one, at the IMU
    x0, z0 = (0.0, 0.0) if model.lumped else (model.rover.imu_x, model.rover.imu_z)
    ahead, above = x0 + x.get("imu_x", 0.0), z0 + x.get("imu_z", 0.0)
    body = tuple(moved[n] for n in ("V", "across", "weight", "v", "r", "p", "phi", "r_dot", "p_dot"))
    errors = tuple(float(x.get(name, 0.0)) for name in ("bias_ay", "vy_gain", "heading", "vy_lag"))
    ay, vy = at_the_imu(body, (float(ahead), float(above)), errors, STEP)
    out: Mapping[str, Array] = {"r": moved["r"], "p": moved["p"], "ay": ay, "vy": vy}
    for effect in model.of(SensorEffect):
        out = effect.act(out, moved, effect.coordinates(x))
    return out


@dataclass(frozen=True, eq=False)
class Sensors:
    """Low-passes and lags of the channels of a run, at the frequencies of its padded Fourier transform.

    size: length of the padded run. w (k,): rad/s. known: {channel: response (k,)} of the known filters. lags:
    {lag [s]: response (k,)} of the last eight.
    """

    size: int
    w: Array
    known: Mapping[str, Any]
    lags: dict[float, Any] = field(default_factory=dict)

    @staticmethod
    def of(run: Experiment) -> Sensors:
        """The filters of a run, padded by two seconds; shared by runs of one length with the same filters."""
        known = tuple((c, run.filters[c]) for c in run.measured if c in run.filters)
        return _sensors(next_fast_len(run.t.size + int(2 * RATE), real=True), known)

    def through(
        self, signals: Mapping[str, Array], speed: Array, model: Model, x: Values
    ) -> dict[str, Array]:
        """{channel: (n,)}: the signals through filters and lags, as a log has them; speed (n,) m/s."""
        found = model.of(FilterEffect)
        hidden = [e.response(self.w, e.coordinates(x)) for e in found]
        seen = [h["r"] for e, h in zip(found, hidden, strict=True) if e.heading and "r" in h]
        if seen and "vy" in signals:
            signals = {
                **signals,
                "vy": signals["vy"] + self._turned(signals["r"], speed, np.prod(seen, axis=0)),
            }
        out = dict(signals)
        paths = {}
        for channel in signals:
            path = self.known.get(channel, 1.0) * self._lag(channel, x)
            for responses in hidden:
                path = path * responses.get(channel, 1.0)
            if np.ndim(path) > 0:
                paths[channel] = path
        if paths:
            lines = rfft(np.stack([padded_by_line(signals[c], self.size) for c in paths]), overwrite_x=True)
            for line, path in zip(lines, paths.values(), strict=True):
                line *= path
            filtered = irfft(lines, self.size, overwrite_x=True)
            out |= {c: y[: signals[c].size] for c, y in zip(paths, filtered, strict=True)}
        return out

    def _turned(self, r: Array, speed: Array, path: Any) -> Array:
        """V_y (n,) from a heading integrated from the filtered r (n,): V (psi - psi_f).

        path (k,): the filter's response H; psi - psi_f has the transform R (1 - H)/(j w).
        """
        late = np.zeros(self.w.size, complex)
        late[1:] = (1.0 - path[1:]) / (1j * self.w[1:])
        late[0] = late[1].real
        return speed * irfft(rfft(padded_by_line(r, self.size)) * late, self.size)[: r.size]

    def _lag(self, channel: str, x: Values) -> Any:
        lag = {"ay": "ay_lag", "p": "p_lag"}.get(channel)
        lag_s = x.get(lag, 0.0) if lag else 0.0
        if lag_s == 0.0:
            return 1.0
        response = self.lags.get(lag_s)
        if response is None:  # most columns of a Jacobian have the same lag
            if len(self.lags) >= 8:
                self.lags.clear()
            response = self.lags[lag_s] = np.exp(-1j * self.w * lag_s)
        return response


@lru_cache(maxsize=16)
def _sensors(size: int, known: tuple[tuple[str, LowPass], ...]) -> Sensors:
    w: Array = np.asarray(2 * pi * np.fft.rfftfreq(size, STEP), np.float64)
    return Sensors(size, w, {c: low_pass.response(w) for c, low_pass in known})


def motion_coordinates(model: Model, x: Values) -> dict[str, float]:
    """The coordinates that the motion depends on, without those of the sensors."""
    sensing = tuple(f"{e.id}." for e in model.acting if isinstance(e, SensorEffect | FilterEffect))
    return {n: v for n, v in x.items() if n not in SENSED and not n.startswith(sensing)}


def logged(
    run: Experiment, model: Model, x: Values, moved: Mapping[str, Array] | None = None
) -> dict[str, Array]:
    """The log that the model predicts: {channel: (n,)} of the measured channels.

    moved: the `motion`, where it is known.
    """
    moved = motion(run, model, x) if moved is None else moved
    shown = sensed(run, model, x, moved)
    signals = {"r": shown["r"], **{c: shown[c] for c in run.measured}}
    logs = Sensors.of(run).through(signals, moved["V"], model, x)
    return {c: logs[c] for c in run.measured}


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A model with its coordinates x {coordinate: value, SI units}."""

    model: Model
    x: Mapping[str, float]

    def log(self, run: Experiment) -> dict[str, Array]:
        """The simulated log of the run {channel: (n,)}, SI units."""
        return logged(run, self.model, self.x)


# Compiled loops of the simulation beside the single track: roll alone, lagged velocity, and the servo.
#
# Axes ISO, SI units.


@njit(cache=True, nogil=True, fastmath=FAST)
def roll_only(across, yaw_rate_dot, q, dt):  # type: ignore[no-untyped-def]
    """(n, 3): phi, p, p' of the sprung mass [rad, rad/s, rad/s^2].

    across (n,): given lateral acceleration [m/s^2]. yaw_rate_dot (n,): r' [rad/s^2]. q (26,):
    `VehicleNumbers`, of which dry friction needs tyres that slip. dt: step [s].
    """
    n = across.size
    y = np.zeros((n, 3))
    phi = p = 0.0
    ms, h, g = q[AT.ms], q[AT.h], q[AT.g]
    j = q[AT.Ixx] + ms * h * h
    for k in range(n):
        end = min(k + 1, n - 1)
        sum_phi = sum_p = dphi = dp = 0.0
        for stage in range(4):
            later = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # share of the step
            kept = 1.0 - later
            phi1, p1 = phi + later * dt * dphi, p + later * dt * dp
            torque = (ms * g * h - q[AT.k_phi]) * phi1 - q[AT.b_phi] * p1
            torque += h * ms * (kept * across[k] + later * across[end])
            torque -= q[AT.Ixz] * (kept * yaw_rate_dot[k] + later * yaw_rate_dot[end])
            dphi, dp = p1, torque / j
            if stage == 0:
                y[k, 0], y[k, 1], y[k, 2] = phi, p, dp
            weight = dt / 6.0 if stage in (0, 3) else dt / 3.0
            sum_phi += weight * dphi
            sum_p += weight * dp
        phi, p = phi + sum_phi, p + sum_p
    return y


@njit(cache=True, nogil=True, fastmath=FAST)
def _sine(angle: float) -> float:
    """sin(angle [rad]); below 0.2 by its series, which is exact to 3e-9 there."""
    if -0.2 < angle < 0.2:
        square = angle * angle
        return angle * (1.0 - square * (1.0 / 6.0 - square / 120.0))
    return sin(angle)


@njit(cache=True, nogil=True, fastmath=FAST)
def at_the_imu(body, place, errors, dt):  # type: ignore[no-untyped-def]
    """(a_y [m/s^2], V_y [m/s]), each (n,), that an IMU and its estimator show.

    body: V, v' + V r, weight, v, r, p, phi, r', p', each (n,), see `simulator.motion`. place: (x, z) of the
    IMU [m]. errors: (bias of a_y [m/s^2], relative error of V_y, error of the heading [rad], lag of V_y
    [s]). dt: step [s].

    The lag acts in earth axes, so in a turn it takes T V r from V_y as well. It uses the trapezoidal rule,
    which keeps its delay; its state is kept in body axes, which turn by r dt.
    """
    speed, across, weight, v, r, p, phi, r_dot, p_dot = body
    ahead, above = place
    bias, gain, heading, lag = errors
    ay, vy = np.empty(r.size), np.empty(r.size)
    lags = lag > 1e-5
    keep = (2.0 * lag - dt) / (2.0 * lag + dt) if lags else 0.0
    new = 0.5 * (1.0 - keep)
    x = before_x = speed[0]  # of the lagged velocity, and of the velocity one step before
    y = before_y = v[0] + ahead * r[0] - above * p[0]
    for k in range(r.size):
        ay[k] = across[k] - weight[k] + ahead * r_dot[k] - above * p_dot[k] + GRAVITY * _sine(phi[k]) + bias
        side = v[k] + ahead * r[k] - above * p[k]
        if lags and k > 0:
            s = _sine(0.5 * (r[k - 1] + r[k]) * dt)
            c = sqrt(1.0 - s * s)
            sum_x, sum_y = keep * x + new * before_x, keep * y + new * before_y
            x = c * sum_x + s * sum_y + new * speed[k]
            y = c * sum_y - s * sum_x + new * side
            before_x, before_y = speed[k], side
        vy[k] = (y if lags else side) * (1.0 + gain) + speed[k] * heading
    return ay, vy


@njit(cache=True, nogil=True)
def padded_by_line(y, size):  # type: ignore[no-untyped-def]
    """y (n,), then a straight line back to y[0]: (size,)."""
    out = np.empty(size)
    n = y.size
    out[:n] = y
    slope = (y[0] - y[n - 1]) / max(size - n - 1, 1)
    for k in range(size - n):
        out[n + k] = y[n - 1] + slope * k
    return out


@njit(cache=True, nogil=True)
def weigh_into(line, bins, weight, out):  # type: ignore[no-untyped-def]
    """Fill out (2 k,) with the real, then the imaginary parts of the bins (k,) of a spectrum, weighted."""
    k = bins.size
    for n in range(k):
        at = line[bins[n]]
        out[n], out[k + n] = at.real * weight[n], at.imag * weight[n]


@njit(cache=True, nogil=True)
def summed_with_loss(u, keep):  # type: ignore[no-untyped-def]
    """y (n,) with y[k] = keep y[k - 1] + u[k], from rest."""
    out = np.empty(u.size)
    y = 0.0
    for k in range(u.size):
        y = keep * y + u[k]
        out[k] = y
    return out


@njit(cache=True, nogil=True)
def servo(u, lag, shape, inv_rate, dt):  # type: ignore[no-untyped-def]
    """Road-wheel angle (n,) rad behind the servo 1/(1 + lag s + shape lag^2 s^2) with a rate limit.

    u (n,): wanted angle [rad]. lag [s]. inv_rate: 1 over the rate limit [s/rad], 0 for no limit. dt: step
    [s]. shape 0 is a first-order lag, 1/4 two equal first-order lags, 1/2 a damping ratio of 0.71.
    Integrated by implicit Euler in half steps, with the input linear between samples.
    """
    d = np.empty(u.size)
    h = 0.5 * dt
    inertia = shape * lag * lag / h
    top = 1.0 / inv_rate if inv_rate > 1e-9 else 1e9
    x, w, before = u[0], 0.0, u[0]
    for k in range(u.size):
        for wanted in (0.5 * (before + u[k]), u[k]):
            w = min(max((wanted - x + inertia * w) / (inertia + lag + h), -top), top)
            x += h * w
        before = u[k]
        d[k] = x
    return d
