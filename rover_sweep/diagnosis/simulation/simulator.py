"""A model with effects, driven by the recorded steering and speed of a run: the log that it predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp, pi
from typing import Any, TypeVar

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect
from rover_sweep.diagnosis.effects.kinds import (
    CommandEffect,
    DriftEffect,
    FilterEffect,
    ForceEffect,
    GripEffect,
    LinkageEffect,
    SensorEffect,
    ServoEffect,
    VehicleEffect,
)
from rover_sweep.diagnosis.simulation import lumped_baseline
from rover_sweep.diagnosis.simulation.experiment import FINE, RATE, Experiment
from rover_sweep.diagnosis.simulation.kernel import (
    VehicleNumbers,
    lagged_over_ground,
    roll_only,
    servo,
    single_track,
)

STEP = 1.0 / RATE
SENSED = {"bias_ay", "imu_x", "imu_z", "ay_lag", "p_lag", "vy_lag", "vy_gain", "heading"}  # act on a log only
MOST_LAGS = 8  # kept responses of a run's sensors
Kind = TypeVar("Kind", bound=Effect)


@dataclass(frozen=True)
class Structure:
    """The parts of a model: the rover's numbers, slip, roll, and effects.

    slip, roll: True if the tyres slip, the body rolls. happened_in: name of the run with a change of ground,
    "" for every run; happened_order: its place in the order of driving. lumped: derivatives replace
    tyres and springs.
    """

    rover: Geometry
    slip: bool
    roll: bool
    effects: tuple[Effect, ...] = ()
    happened_in: str = ""
    lumped: bool = False
    happened_order: int = 0

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """The effects of a kind."""
        return tuple(e for e in self.effects if isinstance(e, kind))


Values = Mapping[str, float]


def wheel_angle(run: Experiment, structure: Structure, x: Values) -> Array:
    """Road-wheel angle (n,) rad from the commanded one through delay, command, servo, linkage and trim."""
    limits = {name: value for e in structure.of(ServoEffect) for name, value in e.numbers(x).items()}
    d = late(run.fine_steer * (1.0 + x.get("scale", 0.0)), x.get("delay", 0.0) * FINE * RATE)
    for effect in structure.of(CommandEffect):
        d = effect.act(d, effect.coordinates(x))
    lag, shape = max(x.get("lag", 0.0), 0.0), x.get("lag_shape", 0.0)
    d = servo(d, lag, shape, limits.get("inv_rate", 0.0), STEP / FINE)[::FINE].copy()
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


def motion(run: Experiment, structure: Structure, x: Values) -> dict[str, Array]:
    """The motion {name: (n,)}, ISO axes, SI units.

    t, V (speed), psi (heading), delta (road-wheel angle), v_dot_x (V'), ms_h (ms h), v (lateral velocity at
    the roll axis), r, phi, p, across (v' + V r), r_dot, p_dot, weight (see `_weight`).
    """
    delta = wheel_angle(run, structure, x)
    speed = run.speed * (1.0 + x.get("vscale", 0.0))
    q, zero = vehicle_numbers(structure, x), np.zeros(delta.size)
    base = {"t": run.t, "V": speed, "psi": run.heading, "delta": delta, "v_dot_x": np.gradient(speed, STEP)}
    base["ms_h"] = zero + q.ms * q.h  # kg m, of the sprung mass about the roll axis
    if structure.lumped:
        return _lumped(base, structure, x)
    grip = np.ones(delta.size)
    for effect in structure.of(GripEffect):
        if structure.happened_in in ("", run.name):
            grip = grip * effect.act(run.t, effect.coordinates(x))
        elif effect.later and structure.happened_order < run.order:
            grip = grip * effect.later(effect.coordinates(x))
    for drift in structure.of(DriftEffect):
        grip = grip * drift.act(run.driven + run.t, drift.coordinates(x))
    if not structure.slip:
        return _without_slip(base, structure, x, q, zero)
    forces = structure.of(ForceEffect)
    pushed = np.zeros((3, delta.size))
    last: tuple[Array, Array] | None = None
    found = base
    for _ in range(max((e.passes for e in forces if e.iterate), default=1)):
        if forces and ("r" in found or not any(e.iterate for e in forces)):
            new = np.stack(_pushed(forces, found, x, structure.rover.mass, zero))
            pushed, last = _mixed(pushed, new, last)
        y = single_track(
            delta,
            speed,
            grip,
            pushed[0],
            pushed[1],
            pushed[2],
            np.array(q),
            structure.roll,
            q.sigma > 1e-6,
            STEP,
        )
        names = ("v", "r", "phi", "p", "across", "r_dot", "p_dot")
        found = base | {name: y[:, k] for k, name in enumerate(names)}
    return found | {"weight": _weight(structure, found, x)}


def _lumped(base: dict[str, Array], structure: Structure, x: Values) -> dict[str, Array]:
    weight = _weight(structure, base, x)
    return base | lumped_baseline.motion(base["delta"], base["V"], weight, x, STEP) | {"weight": weight}


def _mixed(used: Array, new: Array, last: tuple[Array, Array] | None) -> tuple[Array, tuple[Array, Array]]:
    """Forces (3, n) for the next pass, and what that pass needs: mixed so that the passes converge sooner.

    used, new: those of this pass, and those of the motion that they caused. last: (new, new - used) before.
    Anderson 1965: Iterative procedures for nonlinear integral equations, J. ACM 12(4), with depth one.
    """
    change = new - used
    if last is None:
        return new, (new, change)
    step = change - last[1]
    power = float(np.sum(step * step))
    share = float(np.sum(step * change)) / power if power > 0.0 else 0.0
    return new - share * (new - last[0]), (new, change)


def _weight(structure: Structure, found: Mapping[str, Array], x: Values) -> Array:
    """Lateral part of the weight per mass (n,) m/s^2, which an accelerometer does not measure."""
    zero = np.zeros(found["t"].size)
    heavy = tuple(e for e in structure.of(ForceEffect) if e.weight)
    return _pushed(heavy, found, x, structure.rover.mass, zero)[0] / structure.rover.mass if heavy else zero


def _pushed(
    forces: tuple[ForceEffect, ...], found: Mapping[str, Array], x: Values, mass: float, zero: Array
) -> tuple[Array, Array, Array]:
    parts = [e.act(found, e.coordinates(x), mass) for e in forces]
    sums = [zero + sum(np.asarray(p[k]) for p in parts) for k in range(3)]
    return sums[0], sums[1], sums[2]


def _without_slip(
    base: dict[str, Array], structure: Structure, x: Values, q: VehicleNumbers, zero: Array
) -> dict[str, Array]:
    """Kinematic motion without sideslip, as in ArduPilot's SITL rover: r = V tan(d)/L, a_y = V r."""
    rover = structure.rover
    length = exp(x["ln_L_eff"]) if "ln_L_eff" in x else rover.wheelbase
    r = base["V"] * np.tan(base["delta"]) / length
    r_dot = np.gradient(r, STEP)
    across = base["V"] * r
    y = roll_only(across, r_dot, zero, np.array(q), STEP) if structure.roll else np.zeros((r.size, 3))
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
    return _with_units(numbers._replace(**added), rover)


def _with_units(q: VehicleNumbers, rover: Geometry) -> VehicleNumbers:
    """Numbers that a coordinate gives without a unit, in the unit of the kernel."""
    inertia = rover.yaw_inertia or rover.mass * rover.a * rover.b
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
    out: Mapping[str, Array] = {
        "r": moved["r"],
        "p": moved["p"],
        "ay": moved["across"]
        - moved["weight"]
        + ahead * moved["r_dot"]
        - above * moved["p_dot"]
        + GRAVITY * np.sin(moved["phi"])
        + x.get("bias_ay", 0.0),
        "vy": _lagged_velocity(moved, moved["v"] + ahead * moved["r"] - above * moved["p"], x)
        * (1.0 + x.get("vy_gain", 0.0))
        + moved["V"] * x.get("heading", 0.0),
    }
    for effect in structure.of(SensorEffect):
        out = effect.act(out, moved, effect.coordinates(x))
    return out


def _lagged_velocity(moved: Mapping[str, Array], across: Array, x: Values) -> Array:
    """V_y (n,) of a velocity that lags over ground; in a turn the lag T takes T V r from V_y as well.

    across (n,): true V_y [m/s]. The lag acts in earth axes, so the velocity is turned there and back.
    """
    lag = x.get("vy_lag", 0.0)
    if lag <= 1e-5:
        return across
    return np.asarray(lagged_over_ground(moved["V"], across, moved["r"], lag, STEP))


@dataclass(frozen=True, eq=False)
class Sensors:
    """Low-passes and lags of the channels of a run, at the frequencies of its padded Fourier transform.

    size: length of the padded run. w (k,): rad/s. known: {channel: response (k,)} of the known filters. lags:
    {lag [s]: response (k,)} of those that were computed last.
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
        out = {}
        for channel, y in signals.items():
            path = self.known.get(channel, 1.0) * self._lag(channel, x)
            for responses in hidden:
                path = path * responses.get(channel, 1.0)
            if np.ndim(path) == 0:
                out[channel] = y
                continue
            padded = np.concatenate((y, np.linspace(y[-1], y[0], self.size - y.size)))
            out[channel] = irfft(rfft(padded) * path, self.size)[: y.size]
        return out

    def _turned(self, r: Array, speed: Array, path: Any) -> Array:
        """V_y (n,) that a heading shows which is integrated from r (n,) through a filter: V (psi - psi_f).

        path (k,): the filter's response H; psi - psi_f has the transform R (1 - H)/(j w).
        """
        padded = np.concatenate((r, np.linspace(r[-1], r[0], self.size - r.size)))
        late = np.zeros(self.w.size, complex)
        late[1:] = (1.0 - path[1:]) / (1j * self.w[1:])
        late[0] = late[1].real
        return speed * irfft(rfft(padded) * late, self.size)[: r.size]

    def _lag(self, channel: str, x: Values) -> Any:
        lag = {"ay": "ay_lag", "p": "p_lag"}.get(channel)
        lag_s = x.get(lag, 0.0) if lag else 0.0
        if lag_s == 0.0:
            return 1.0
        response = self.lags.get(lag_s)
        if response is None:  # most columns of a Jacobian have the same lag
            if len(self.lags) >= MOST_LAGS:
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
