"""A model with effects, driven by the recorded steering and speed of a run: the log that it predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, pi
from typing import Any

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import (
    CommandEffect,
    DriftEffect,
    FilterEffect,
    ForceEffect,
    GripEffect,
    LinkageEffect,
    SensorEffect,
    ServoEffect,
    SpeedGripEffect,
    StateForceEffect,
    VehicleEffect,
)
from rover_sweep.diagnosis.simulation import candidates as lumped_baseline
from rover_sweep.diagnosis.simulation.experiment import FINE, RATE, Experiment
from rover_sweep.diagnosis.simulation.kernel import at_the_imu, padded_by_line, roll_only, servo
from rover_sweep.diagnosis.simulation.single_track import (
    VehicleNumbers,
    single_track_with_laws,
    single_tracks,
)
from rover_sweep.diagnosis.simulation.structure import Structure, Values
from rover_sweep.diagnosis.simulation.table_law import law_numbers

# The road-wheel angle of a run: the commanded one through delay, command, servo, linkage and trim.


STEP = 1.0 / RATE
WHEEL = ("scale", "delay", "lag", "lag_shape", "trim")  # coordinates of the wheel angle


def wheel_angle(run: Experiment, structure: Structure, x: Values) -> Array:
    """Road-wheel angle (n,) rad from the commanded one through delay, command, servo, linkage and trim.

    The run keeps the last eight, since most columns of a Jacobian share theirs; it must not be written to.
    """
    limits = {name: value for e in structure.of(ServoEffect) for name, value in e.numbers(x).items()}
    acting = (*structure.of(CommandEffect), *structure.of(LinkageEffect))
    laws = tuple((e.act, *e.coordinates(x).items()) for e in acting)
    key = (laws, tuple(limits.items()), *(x.get(name, 0.0) for name in WHEEL))
    found = run.angles.get(key)
    if found is None:
        if len(run.angles) >= 8:
            run.angles.clear()
        found = run.angles[key] = _wheel_angle(run, structure, x, limits.get("inv_rate", 0.0))
    return found


def _wheel_angle(run: Experiment, structure: Structure, x: Values, inv_rate: float) -> Array:
    d = late(run.fine_steer * (1.0 + x.get("scale", 0.0)), x.get("delay", 0.0) * FINE * RATE)
    for effect in structure.of(CommandEffect):
        d = effect.act(d, effect.coordinates(x))
    lag, shape = max(x.get("lag", 0.0), 0.0), x.get("lag_shape", 0.0)
    d = servo(d, lag, shape, inv_rate, STEP / FINE)[::FINE].copy()
    for linkage in structure.of(LinkageEffect):
        d = linkage.act(d, linkage.coordinates(x))
    return d - x.get("trim", 0.0)


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


def motion(run: Experiment, structure: Structure, x: Values) -> dict[str, Array]:
    """The motion {name: (n,)}, ISO axes, SI units.

    t, V (speed), psi (heading), delta (road-wheel angle), v_dot_x (V'), ms_h (ms h), v (lateral velocity at
    the roll axis), r, phi, p, across (v' + V r), r_dot, p_dot, weight (see `_weight`).
    """
    return motions([(run, x)], structure)[0]


def motions(drives: Sequence[tuple[Experiment, Values]], structure: Structure) -> list[dict[str, Array]]:
    """The `motion` of each run with its coordinates; two of them take as long as one."""
    bases = []
    for run, x in drives:
        scale, delta = 1.0 + x.get("vscale", 0.0), wheel_angle(run, structure, x)
        more = x.get("speed_share", 1.0) - run.share
        speed = scale * (run.speed + more * run.unsure)
        v_dot_x = scale * (run.acceleration + more * run.unsure_acceleration)
        bases.append({"t": run.t, "psi": run.heading, "delta": delta, "V": speed, "v_dot_x": v_dot_x})
    if structure.lumped:
        return [_lumped(base, structure, x) for (_, x), base in zip(drives, bases, strict=True)]
    cars = [_car(run, structure, x, base) for (run, x), base in zip(drives, bases, strict=True)]
    if not structure.slip:
        return [_without_slip(structure, car) for car in cars]
    pairs = [cars[k : k + 2] for k in range(0, len(cars), 2)]
    return [found for pair in pairs for found in _with_slip(structure, pair)]


@dataclass(frozen=True, eq=False)
class _Car:
    """What moves in one drive: its coordinates x, numbers q, factor of grip (n,), and what is known of it."""

    x: Values
    base: dict[str, Array]
    q: VehicleNumbers
    grip: Array

    def driven_by(self, pushed: Array) -> tuple[Array, ...]:
        """The input of `single_tracks` with added forces and moments pushed (3, n)."""
        return (self.base["delta"], self.base["V"], self.grip, *pushed, np.array(self.q))


def _car(run: Experiment, structure: Structure, x: Values, base: dict[str, Array]) -> _Car:
    q = vehicle_numbers(structure, x)
    grip = np.ones(run.t.size)
    for effect in structure.of(GripEffect):
        if structure.happened_in in ("", run.name):
            grip = grip * effect.act(run.t, effect.coordinates(x))
        elif effect.later and structure.happened_order < run.order:
            grip = grip * effect.later(effect.coordinates(x))
    for tyre in structure.of(SpeedGripEffect):
        grip = grip * tyre.act(base["V"], tyre.coordinates(x))
    for drift in structure.of(DriftEffect):
        grip = grip * drift.act(run.driven + run.t, drift.coordinates(x))
    return _Car(x, base | {"ms_h": np.full(run.t.size, q.ms * q.h)}, q, grip)  # kg m, about the roll axis


def _with_slip(structure: Structure, pair: Sequence[_Car]) -> list[dict[str, Array]]:
    """The motions of one or two cars on tyres."""
    forces, laws = structure.of(ForceEffect), structure.of(StateForceEffect)
    drives = [car.driven_by(_pushed(forces, car.base, car.x, structure.rover.mass)) for car in pair]
    relaxed = [car.q.sigma > 1e-6 for car in pair]
    if laws:
        both = tuple(
            single_track_with_laws(drive, law_numbers(laws, car.base, car.x), late, structure.roll, STEP)
            for drive, car, late in zip(drives, pair, relaxed, strict=True)
        )
    else:
        both = single_tracks(drives[0], drives[-1], (relaxed[0], relaxed[-1]), structure.roll, STEP)
    names = ("v", "r", "phi", "p", "across", "r_dot", "p_dot")
    found = [car.base | dict(zip(names, y, strict=True)) for car, y in zip(pair, both, strict=False)]
    return [y | {"weight": _weight(structure, y, car.x)} for car, y in zip(pair, found, strict=True)]


def _lumped(base: dict[str, Array], structure: Structure, x: Values) -> dict[str, Array]:
    rover = structure.rover
    base = base | {"ms_h": np.full(base["t"].size, (rover.sprung_mass or 0.0) * (rover.h or 0.0))}
    weight = _weight(structure, base, x)
    return base | lumped_baseline.motion(base["delta"], base["V"], weight, x, STEP) | {"weight": weight}


def _weight(structure: Structure, found: Mapping[str, Array], x: Values) -> Array:
    """Lateral part of the weight per mass (n,) m/s^2, which an accelerometer does not measure."""
    heavy = tuple(e for e in structure.of(ForceEffect) if e.weight)
    return np.asarray(_pushed(heavy, found, x, structure.rover.mass)[0] / structure.rover.mass)


def _pushed(forces: tuple[ForceEffect, ...], found: Mapping[str, Array], x: Values, mass: float) -> Array:
    """Side force [N], yaw and roll moment [N m] (3, n) of these effects in a motion."""
    out = np.zeros((3, found["t"].size))
    for effect in forces:
        for row, part in zip(out, effect.act(found, effect.coordinates(x), mass), strict=True):
            row += part
    return out


def _without_slip(structure: Structure, car: _Car) -> dict[str, Array]:
    """Kinematic motion without sideslip, as in ArduPilot's SITL rover: r = V tan(d)/L, a_y = V r."""
    rover, base, x = structure.rover, car.base, car.x
    length = exp(x["ln_L_eff"]) if "ln_L_eff" in x else rover.wheelbase
    r = base["V"] * np.tan(base["delta"]) / length
    r_dot = np.gradient(r, STEP)
    across = base["V"] * r
    zero = np.zeros(r.size)
    y = roll_only(across, r_dot, zero, np.array(car.q), STEP) if structure.roll else np.zeros((r.size, 3))
    return base | {
        "v": zero,
        "r": r,
        "r_dot": r_dot,
        "across": across,
        "phi": y[:, 0],
        "p": y[:, 1],
        "p_dot": y[:, 2],
        "weight": _weight(structure, base, x),
    }


def vehicle_numbers(structure: Structure, x: Values) -> VehicleNumbers:
    """Numbers of the compiled kernel at the coordinates x."""
    rover = structure.rover
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
    for effect in structure.of(VehicleEffect):
        added |= effect.numbers(x)
    q, inertia = numbers._replace(**added), rover.yaw_inertia or rover.mass * rover.a * rover.b
    # these coordinates have no unit
    return q._replace(
        compliance=q.compliance / q.Cf, yaw_damp=q.yaw_damp * inertia, yaw_damp_v=q.yaw_damp_v * inertia
    )


def sensed(
    run: Experiment, structure: Structure, x: Values, moved: Mapping[str, Array]
) -> Mapping[str, Array]:
    """{channel: (n,)} of the sensors before any low-pass: r, p, and ay, vy at the IMU."""
    rover = structure.rover
    ahead = rover.imu_x + x.get("imu_x", 0.0)
    above = rover.imu_z + x.get("imu_z", 0.0)
    body = tuple(moved[n] for n in ("V", "across", "weight", "v", "r", "p", "phi", "r_dot", "p_dot"))
    errors = tuple(float(x.get(name, 0.0)) for name in ("bias_ay", "vy_gain", "heading", "vy_lag"))
    ay, vy = at_the_imu(body, (float(ahead), float(above)), errors, STEP)
    out: Mapping[str, Array] = {"r": moved["r"], "p": moved["p"], "ay": ay, "vy": vy}
    for effect in structure.of(SensorEffect):
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
        """The filters of a run, padded by two seconds."""
        size = next_fast_len(run.t.size + int(2 * RATE), real=True)
        w: Array = np.asarray(2 * pi * np.fft.rfftfreq(size, STEP), np.float64)
        return Sensors(size, w, {c: run.filters[c].response(w) for c in run.measured if c in run.filters})

    def through(
        self, signals: Mapping[str, Array], speed: Array, structure: Structure, x: Values
    ) -> dict[str, Array]:
        """{channel: (n,)}: the signals through filters and lags, as a log has them; speed (n,) m/s."""
        found = structure.of(FilterEffect)
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
        """V_y (n,) that a heading shows which is integrated from r (n,) through a filter: V (psi - psi_f).

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


def motion_coordinates(structure: Structure, x: Values) -> dict[str, float]:
    """The coordinates that the motion depends on, without those of the sensors."""
    sensing = tuple(f"{e.id}." for e in structure.effects if isinstance(e, SensorEffect | FilterEffect))
    return {n: v for n, v in x.items() if n not in SENSED and not n.startswith(sensing)}


def logged(
    run: Experiment,
    structure: Structure,
    x: Values,
    sensors: Sensors,
    moved: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    """The log that the model predicts: {channel: (n,)} of the measured channels.

    moved: the `motion`, where it is known.
    """
    moved = motion(run, structure, x) if moved is None else moved
    shown = sensed(run, structure, x, moved)
    logs = sensors.through({"r": shown["r"], **{c: shown[c] for c in run.measured}}, moved["V"], structure, x)
    return {c: logs[c] for c in run.measured}
