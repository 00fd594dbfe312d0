"""The linear part of an augmented model, as M x' = F x + G u(t - tau), y = H0 x + H1 x'.

Equation (18) of the paper, corrected, with the servo's lag, the tyres' relaxation length, roll steer of both
axles, steering compliance, yaw damping, mounting angles and scales of the IMU, and the lag of the velocity.
`left_out` describes the nonlinear rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.diagnosis.effects.effect import (
    FilterEffect,
    ForceEffect,
    GripEffect,
    ServoEffect,
    SpeedEffect,
    SteeringEffect,
)
from rover_sweep.diagnosis.effects.sensors import USUAL_DELAY
from rover_sweep.diagnosis.simulation.augmented import DERIVATIVES, AugmentedModel
from rover_sweep.identification.models import lumped_matrices, roll_yaw_matrices
from rover_sweep.identification.state_space import Matrices, ModelStructure, Parameter

# The states of a linear rover: wheel [rad], wheel_rate [rad/s], V_y [m/s], r, p [rad/s], phi [rad], F_f, F_r
# [N], V_m [m/s]. The rows of the body are those of the identified models.


FAST = 1e4  # rad/s, bandwidth of a yaw rate that follows the steering at once
BODY = ("V_y", "r", "p", "phi")


def linear_matrices(p: Mapping[str, Any], states: tuple[str, ...], lumped: bool, outputs: int) -> Matrices:
    """M, F, G, H0, H1 for these states and the first `outputs` of r, ay, vydot, p at the IMU.

    p: {parameter: SI value} with the names of `linear`, and "V" [m/s].
    """
    v, n, at = p["V"], len(states), {state: k for k, state in enumerate(states)}
    own = [state for state in BODY if state in states]
    q = dict.fromkeys((*ROVER, *ROLLING, *OPTIONAL, *DERIVATIVES), 0.0) | dict(p)
    if lumped:
        body = lumped_matrices(q | {name: q[name] / v for name in DERIVATIVES if name[-1] in "vr"})
        order = ["V_y", "p", "r", "phi"]
    else:
        body, order = roll_yaw_matrices(q | {"Cf": 0.0, "Cr": 0.0}), list(BODY)
    dtype = np.result_type(*(np.asarray(value).dtype for value in p.values()), float)
    (m, f), by_wheel = np.zeros((2, n, n), dtype), np.zeros(n, dtype)  # F and G for the true wheel angle
    h0, h1 = np.zeros((2, outputs, n), dtype)
    rows, kept = [at[state] for state in own], [order.index(state) for state in own]
    m[np.ix_(rows, rows)], f[np.ix_(rows, rows)] = (x[np.ix_(kept, kept)] for x in (body.m, body.f))
    h0[:, rows], h1[:, rows] = body.h0[:outputs, kept], body.h1[:outputs, kept]
    r = at["r"]
    if lumped:
        by_wheel[rows], h1[2] = body.g[kept], np.eye(n)[at["V_y"]]  # this V_y is the measured one
    elif "V_y" not in at:
        m[r], f[r] = np.eye(n)[r] / FAST, -np.eye(n)[r]
        by_wheel[r] = v / p["L_eff"]
    else:
        soft = q["Cf"] / (1.0 + q["compliance"] * q["Cf"])  # the angle that the force takes away
        for force, c, arm, steer, by_roll in (
            ("F_f", soft, q["a"], soft, 0.0),
            ("F_r", q["Cr"], -q["b"], 0.0, q["Cr"] * q["e_rear"]),
        ):
            side, on_body = np.zeros((2, n), dtype)
            side[at["V_y"]], side[r], on_body[at["V_y"]], on_body[r] = -c / v, -c * arm / v, 1.0, arm
            if by_roll:
                side[at["phi"]] = by_roll
            if force in at:
                k = at[force]
                m[k, k], f[k], by_wheel[k] = q["sigma"] / v, side, steer
                f[k, k] = -1.0
                f[:, k] += on_body
            else:
                f += np.outer(on_body, side)
                by_wheel += on_body * steer
        f[r, r] -= q["yaw_damp"] + q["yaw_damp_v"] / v
    if "e_roll" in p:
        f[:, at["phi"]] += by_wheel * p["e_roll"]
    g = by_wheel * p["gain"]
    if "wheel" in at:  # lag d' + shape lag^2 d'' + d = gain u
        f[:, at["wheel"]] += by_wheel
        last, servo = ("wheel_rate" if "wheel_rate" in at else "wheel"), at["wheel"]
        g = np.eye(n)[at[last]] * p["gain"]
        f[at[last], servo] -= 1.0
        m[at[last], at[last]] = p["lag"]
        if last == "wheel_rate":
            m[servo, servo] = f[servo, at[last]] = 1.0
            m[at[last], at[last]], f[at[last], at[last]] = p["lag_shape"] * p["lag"] ** 2, -p["lag"]
    if "V_m" in at:  # T V_m' = V_y at the IMU - V_m - T V r: the axes turn while the velocity lags
        k = at["V_m"]
        m[k, k], f[k] = p["vy_lag"], h1[2] - np.eye(n)[k]
        f[k, r] -= p["vy_lag"] * v
        h1[2] = np.eye(n)[k]
    if "p" in at:
        c, s = cos(q["pitch"]), sin(q["pitch"])
        h0[[0, 3]] = np.array([[c, s], [-s, c]]) @ h0[[0, 3]]
        h0[3] *= 1.0 + q["gyro_scale"]
    h0[0] *= 1.0 + q["gyro_scale"]
    for h in (h0, h1):
        h[1] *= cos(q["yaw"]) * (1.0 + q["accel_scale"])
    h1[2] *= 1.0 + q["vy_gain"]
    return Matrices(m, f, g, h0, h1)


NOT_LINEAR = SteeringEffect | ServoEffect
CURVED = ("tyre_saturation", "load_transfer", "suspension_friction")
NOT_OF_THE_ROVER = ForceEffect | GripEffect | SpeedEffect
UNITS = {
    name: unit
    for unit, names in {
        "kg": "m ms",
        "m": "h a b sigma imu_x imu_z L_eff",
        "kg m^2": "Ixx Izz Ixz",
        "N/rad": "Cf Cr",
        "N m/rad": "k_phi",
        "N m s/rad": "b_phi",
        "m/s^2": "g",
        "rad/rad": "e_roll e_rear",
        "rad/N": "compliance",
        "N m s": "yaw_damp",
        "N m^2": "yaw_damp_v",
        "-": "gyro_scale accel_scale gain lag_shape vy_gain",
        "s": "lag vy_lag tau late_r late_ay late_vydot late_p",
        "rad": "pitch yaw",
    }.items()
    for name in names.split()
}
ROVER = ("m", "Izz", "Ixz", "a", "b", "Cf", "Cr", "g", "imu_x")
ROLLING = ("ms", "h", "Ixx", "k_phi", "b_phi", "imu_z")
LATE = ("late_r", "late_ay", "late_vydot", "late_p")
OPTIONAL = (
    *("sigma", "e_roll", "e_rear", "compliance", "yaw_damp", "yaw_damp_v"),
    *("lag", "lag_shape", "vy_lag", "vy_gain", "pitch", "yaw", "gyro_scale", "accel_scale"),
    *LATE,
)


def linear(model: AugmentedModel) -> ModelStructure:
    """The linear part about straight driving; its parameters are the physical numbers, all fixed.

    Outputs at the IMU: r [rad/s], ay, vydot [m/s^2] and, with roll, p [rad/s]; with delays [s] of the
    steering and of the outputs.
    """
    values = _values(model)
    slip, roll = model.simulated.slip, model.simulated.roll
    states = _states(values, slip, roll)
    outputs = ("r", "ay", "vydot", "p") if roll else ("r", "ay", "vydot")

    def build(p: Mapping[str, Any]) -> Matrices:
        return linear_matrices(p, states, model.lumped, len(outputs))

    return ModelStructure(
        name=model.name,
        states=states,
        outputs=outputs,
        parameters=tuple(Parameter(name, _unit(name), value) for name, value in values.items()),
        build=build,
        reference="equation (18) as corrected, with the effects found by the diagnosis",
        input_delays={"delta": "tau"},
        output_delays={o: f"late_{o}" for o in outputs if f"late_{o}" in values},
        units={"wheel": "rad", "wheel_rate": "rad/s", "F_f": "N", "F_r": "N", "V_m": "m/s"},
    )


class FirstOrderLowPass(LowPass):
    """A first-order low-pass of a sensor."""

    def response(self, w: Array) -> NDArray[np.complex128]:
        """Frequency response (n,) at w (n,) [rad/s]: 1/(1 + s/w0)."""
        return np.asarray(1.0 / (1.0 + 1j * w / (2 * np.pi * self.cutoff_hz)), complex)


def hidden_filters(model: AugmentedModel) -> dict[str, LowPass]:
    """{channel: low-pass} that the diagnosis found, before the known ones."""
    law, periods = _hidden(model)
    if law == "delay":
        return {}
    kind = FirstOrderLowPass if law == "first order" else LowPass
    return {c: kind(1.0 / period, "found by the diagnosis") for c, period in periods.items()}


def _hidden(model: AugmentedModel) -> tuple[str, dict[str, float]]:
    """(form of the sensor filter, "" if none, {channel: 1/cut-off [s]})."""
    law = next((e.form for e in model.added if e.id == "sensor_filter"), "")
    names = (("r", "gyro_hz"), ("p", "gyro_hz"), ("ay", "accel_hz"))
    periods = {c: model.value(f"sensor_filter.{name}") for c, name in names} if law else {}
    return law.partition(",")[0], {c: period for c, period in periods.items() if period > 0}


def left_out(model: AugmentedModel) -> list[str]:
    """What the linear model omits and why, one sentence each."""
    out = []
    for effect in model.added:
        curved = isinstance(effect, NOT_LINEAR) or effect.id in CURVED
        if curved or isinstance(effect, NOT_OF_THE_ROVER) or effect.id == "clock_offset":
            numbers = ", ".join(f"{p} = {v:.4g} {unit}" for p, (v, unit, _) in model.reported(effect).items())
            why = "is not linear" if curved else "is not part of a linear model of the rover"
            out.append(f"{effect.id} ({effect.equation}; {numbers}) {why}")
        if isinstance(effect, FilterEffect) and effect.heading:
            out.append("the lag of the heading from a filtered gyro, which rotates V_y, is not included")
    for law in model.laws:
        why = "has a hidden state" if law.memory == "resonance" else "is a table, not linear"
        out.append(f"the law at the {law.place} over {law.over} {why}")
    constants = {"trim": ("trim of the steering", "rad"), "bias_ay": ("constant of a_y", "m/s^2")}
    for name, (what, unit) in constants.items():
        if abs(model.value(name)) > 1e-6:
            out.append(f"the {what}, {model.value(name):.3g} {unit}, is a constant")
    if model.value("bend") > 0.0:
        out.append(f"the bend of the tyres near their limit, {model.value('bend'):.2g}, is not linear")
    if (scale := model.value("vscale")) != 0.0:
        out.append(
            f"the log's speed must be multiplied by {1 + scale:.4f}; the linear model uses the true speed"
        )
    return out


def _values(model: AugmentedModel) -> dict[str, float]:
    """{name: SI value} of the parameters that this model has."""
    n, x = model.numbers, model.value
    delay, late = _delays(model)
    roll = model.simulated.roll
    own: tuple[str, ...] = ("Izz", "Ixz", "g", "imu_x", "L_eff") if "L_eff" in n else ROVER
    rolling: tuple[str, ...] = ROLLING
    if model.lumped:
        own, rolling = (*(name for name in DERIVATIVES if name in n), "g", "imu_x"), ("imu_z",)
    every = n | {
        "gain": 1.0 + x("scale"),
        "lag": x("lag"),
        "lag_shape": x("lag_shape"),
        "vy_lag": x("vy_lag"),
        "vy_gain": x("vy_gain"),
        "pitch": x("imu_tilt.pitch"),
        "yaw": x("imu_tilt.yaw"),
        "gyro_scale": x("sensor_scale.gyro"),
        "accel_scale": x("sensor_scale.accel"),
        "tau": delay,
        **late,
    }
    names = [*own, *(rolling if roll else ()), "gain", "tau"]
    shortest = {"s": 1e-5}  # a shorter lag is omitted
    names += [
        o
        for o in OPTIONAL
        if abs(every.get(o, 0.0)) > shortest.get(UNITS[o], 0.0)
        and (roll or o not in ("e_roll", "e_rear", "late_p"))
    ]
    return {name: every[name] for name in names}


def _unit(name: str) -> str:
    """Unit of a parameter; for a derivative by v or r: unit of derivative times speed."""
    row, _, column = name.partition("_")
    if name not in DERIVATIVES:
        return UNITS[name]
    per = {"v": " ", "r": " m/rad ", "p": " s/rad ", "phi": "/rad ", "delta": "/rad "}[column].rstrip()
    return f"{'m/s^2' if row == 'Y' else 'rad/s^2'}{per}"


def _delays(model: AugmentedModel) -> tuple[float, dict[str, float]]:
    """(delay of the steering [s], {"late_<output>": further delay [s]}), none of them negative.

    A clock offset is not a delay of the rover; the usual delay is used instead.
    """
    delay = USUAL_DELAY if "clock_offset" in model.effects else model.value("delay")
    lags = {name: model.value(f"{name.removeprefix('late_')}_lag") for name in ("late_ay", "late_p")}
    law, periods = _hidden(model)
    for channel, period in periods.items() if law == "delay" else ():
        lags[f"late_{channel}"] = lags.get(f"late_{channel}", 0.0) + period / (2 * np.pi)
    early = max(min(0.0, *lags.values()), -delay)
    return delay + early, {name: max(lags.get(name, 0.0) - early, 0.0) for name in LATE}


def _states(values: Mapping[str, float], slip: bool, roll: bool) -> tuple[str, ...]:
    found = []
    if "lag" in values:
        found += ["wheel", "wheel_rate"] if "lag_shape" in values else ["wheel"]
    found += ["V_y", "r"] if slip else ["r"]
    found += ["p", "phi"] if roll else []
    found += ["F_f", "F_r"] if slip and "sigma" in values else []
    return (*found, "V_m") if "vy_lag" in values else tuple(found)
