"""The linear part of an augmented model, as M x' = F x + G u(t - tau), y = H0 x + H1 x'.

Equation (18) of the paper, corrected, with the servo's lag, the tyres' relaxation length, roll steer of both
axles, steering compliance, yaw damping, mounting angles and scales of the IMU, and the lag of the velocity.
`left_out` describes the nonlinear rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.diagnosis.effects.effect import (
    CommandEffect,
    DriftEffect,
    FilterEffect,
    ForceEffect,
    GripEffect,
    LinkageEffect,
    ServoEffect,
    SpeedEffect,
    SpeedGripEffect,
)
from rover_sweep.diagnosis.effects.sensors import USUAL_DELAY
from rover_sweep.diagnosis.simulation.augmented import DERIVATIVES, AugmentedModel
from rover_sweep.identification.state_space import Matrices, ModelStructure, Parameter

# The rows of a linear rover's equations, by the names of its states: M x' = F x + G u, y = H0 x + H1 x'.
#
# Three kinds: tyres (equation (18) of the paper, corrected), kinematic (the yaw rate follows the steering at
# once), lumped derivatives (equation (19)); each with servo, roll, tyre relaxation and IMU. States: wheel
# [rad], wheel_rate [rad/s], V_y [m/s], r, p [rad/s], phi [rad], F_f, F_r [N], V_m [m/s].


FAST = 1e4  # rad/s, bandwidth of a yaw rate that follows the steering at once
Kind = Literal["tyres", "kinematic", "lumped"]
AXES = {"v": "V_y", "p": "p", "r": "r", "phi": "phi"}


class Equations:
    """Rows of M (n, n), F (n, n), G (n,), filled by the names of the n states; a term is {state: factor}.

    p: {parameter: SI value} with the names of `linear`, and "V" [m/s].
    """

    def __init__(self, p: Mapping[str, Any], states: tuple[str, ...], kind: Kind) -> None:
        self.p, self.states, self.kind = p, states, kind
        self.slip, self.roll = "V_y" in states, "phi" in states
        dtype = np.result_type(*(np.asarray(v).dtype for v in p.values()), float)
        self.m, self.f = (np.zeros((len(states), len(states)), dtype) for _ in range(2))
        self.g = np.zeros(len(states), dtype)

    def matrices(self, outputs: tuple[str, ...]) -> Matrices:
        """M, F, G, H0, H1 for these outputs."""
        self._servo()
        if self.kind == "lumped":
            self._derivatives()
        else:
            self._tyres() if self.slip else self._follows()
            if self.roll:
                self._rolls()
        self._velocity()
        h0, h1 = self._outputs(outputs)
        return Matrices(self.m, self.f, self.g, h0, h1)

    def _at(self, state: str) -> int:
        return self.states.index(state)

    def _put(self, matrix: Array, row: str, terms: Mapping[str, Any]) -> None:
        for state, factor in terms.items():
            matrix[self._at(row), self._at(state)] += factor

    def _steer(self, row: str, factor: Any) -> None:
        """Add a term of a row in the true wheel angle."""
        if "wheel" in self.states:
            self._put(self.f, row, {"wheel": factor})
        else:
            self.g[self._at(row)] += factor * self.p["gain"]
        if "e_roll" in self.p:
            self._put(self.f, row, {"phi": factor * self.p["e_roll"]})

    def _servo(self) -> None:
        """lag d' + shape lag^2 d'' + d = gain u."""
        if "wheel" not in self.states:
            return
        p = self.p
        if "wheel_rate" in self.states:
            self._put(self.m, "wheel", {"wheel": 1.0})
            self._put(self.f, "wheel", {"wheel_rate": 1.0})
            self._put(self.m, "wheel_rate", {"wheel_rate": p["lag_shape"] * p["lag"] ** 2})
            self._put(self.f, "wheel_rate", {"wheel": -1.0, "wheel_rate": -p["lag"]})
            self.g[self._at("wheel_rate")] = p["gain"]
        else:
            self._put(self.m, "wheel", {"wheel": p["lag"]})
            self._put(self.f, "wheel", {"wheel": -1.0})
            self.g[self._at("wheel")] = p["gain"]

    def _tyres(self) -> None:
        """Side force and yaw moment of both axles, with the relaxation length where it is a state."""
        p, v = self.p, self.p["V"]
        self._put(self.m, "V_y", {"V_y": p["m"]})
        self._put(self.f, "V_y", {"r": -p["m"] * v})
        self._put(self.m, "r", {"r": p["Izz"]})
        against = p.get("yaw_damp", 0.0) + p.get("yaw_damp_v", 0.0) / v
        self._put(self.f, "r", {"r": -against})
        soft = p["Cf"] / (1.0 + p.get("compliance", 0.0) * p["Cf"])  # the angle that the force takes away
        axles = (("F_f", soft, p["a"], True), ("F_r", p["Cr"], -p["b"], False))
        for force, c, arm, steered in axles:
            slip = {"V_y": -c / v, "r": -c * arm / v}
            if not steered and "e_rear" in p:
                slip["phi"] = c * p["e_rear"]
            if force in self.states:
                self._put(self.m, force, {force: p["sigma"] / v})
                self._put(self.f, force, {force: -1.0, **slip})
                if steered:
                    self._steer(force, c)
                self._put(self.f, "V_y", {force: 1.0})
                self._put(self.f, "r", {force: arm})
                continue
            for row, lever in (("V_y", 1.0), ("r", arm)):
                self._put(self.f, row, {state: lever * factor for state, factor in slip.items()})
                if steered:
                    self._steer(row, lever * c)

    def _follows(self) -> None:
        """r = V d/L at once."""
        self._put(self.m, "r", {"r": 1.0 / FAST})
        self._put(self.f, "r", {"r": -1.0})
        self._steer("r", self.p["V"] / self.p["L_eff"])

    def _derivatives(self) -> None:
        """V_y' + V r, p' and r' by the derivatives; those by v and r are divided by the speed."""
        v = self.p["V"]
        rows = {"Y": "V_y", "L": "p", "N": "r"} if self.roll else {"Y": "V_y", "N": "r"}
        for row, state in rows.items():
            self._put(self.m, state, {state: 1.0})
            for column, by in AXES.items():
                if by in self.states:
                    per = 1.0 / v if column in "vr" else 1.0
                    self._put(self.f, state, {by: per * self.p.get(f"{row}_{column}", 0.0)})
            self._steer(state, self.p[f"{row}_delta"])
        self._put(self.f, "V_y", {"r": -v})
        if self.roll:
            self._put(self.m, "phi", {"phi": 1.0})
            self._put(self.f, "phi", {"p": 1.0})

    def _rolls(self) -> None:
        """(Ixx + ms h^2) p' + Ixz r' - h ms (V_y' + V r) = (ms g h - k) phi - b p, and its reactions."""
        p, v = self.p, self.p["V"]
        hm = p["h"] * p["ms"]
        self._put(self.m, "p", {"p": p["Ixx"] + hm * p["h"], "r": p["Ixz"]})
        self._put(self.f, "p", {"r": hm * v, "p": -p["b_phi"], "phi": hm * p["g"] - p["k_phi"]})
        self._put(self.m, "phi", {"phi": 1.0})
        self._put(self.f, "phi", {"p": 1.0})
        if self.slip:
            self._put(self.m, "p", {"V_y": -hm})
            self._put(self.m, "V_y", {"p": -hm})
            self._put(self.m, "r", {"p": p["Ixz"]})

    def _velocity(self) -> None:
        """T V_m' = V_y at the IMU - V_m - T V r: the axes turn while the velocity lags."""
        if "V_m" not in self.states:
            return
        p = self.p
        self._put(self.m, "V_m", {"V_m": p["vy_lag"]})
        self._put(self.f, "V_m", {**self._at_imu(measured=True), "V_m": -1.0})
        self._put(self.f, "V_m", {"r": -p["vy_lag"] * p["V"]})

    def _at_imu(self, measured: bool) -> dict[str, Any]:
        """Lateral velocity at the IMU by the states; V_y of derivatives is already the measured one."""
        away = 0.0 if measured and self.kind == "lumped" else 1.0
        found = {"r": away * self.p["imu_x"]} | ({"V_y": 1.0} if self.slip else {})
        return found | ({"p": -away * self.p["imu_z"]} if self.roll else {})

    def _outputs(self, outputs: tuple[str, ...]) -> tuple[Array, Array]:
        """H0, H1 (outputs, n) of r, ay, vydot and p as the IMU measures them."""
        p = self.p
        rate, speed = self._at_imu(measured=False), self._at_imu(measured=True)
        turned, tilt = p.get("yaw", 0.0), p.get("pitch", 0.0)
        level = cos(turned)
        ay = {"r": level * p["V"]} | ({"phi": level * p["g"]} if self.roll else {})
        mix = (cos(tilt), sin(tilt)) if self.roll else (1.0, 0.0)
        scales = {c: 1.0 + p.get("gyro_scale", 0.0) for c in "rp"} | {"ay": 1.0 + p.get("accel_scale", 0.0)}
        gain = 1.0 + p.get("vy_gain", 0.0)
        shown: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
            "r": ({"r": mix[0]} | ({"p": mix[1]} if self.roll else {}), {}),
            "ay": (ay, {state: level * factor for state, factor in rate.items()}),
            "vydot": (
                {},
                {s: gain * k for s, k in ({"V_m": 1.0} if "V_m" in self.states else speed).items()},
            ),
            "p": ({"p": mix[0], "r": -mix[1]} if self.roll else {}, {}),
        }
        h = np.zeros((2, len(outputs), len(self.states)), self.m.dtype)
        for row, output in enumerate(outputs):
            for k, terms in enumerate(shown[output]):
                for state, factor in terms.items():
                    h[k, row, self._at(state)] += scales.get(output, 1.0) * factor
        return h[0], h[1]


NOT_LINEAR = CommandEffect | LinkageEffect | ServoEffect
CURVED = ("tyre_saturation", "load_transfer", "suspension_friction")
NOT_OF_THE_ROVER = ForceEffect | GripEffect | DriftEffect | SpeedGripEffect | SpeedEffect
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
    slip, roll = model.structure.slip, model.structure.roll
    kind: Kind = "lumped" if model.lumped else "tyres" if slip else "kinematic"
    states = _states(values, slip, roll)
    outputs = ("r", "ay", "vydot", "p") if roll else ("r", "ay", "vydot")

    def build(p: Mapping[str, Any]) -> Matrices:
        return Equations(p, states, kind).matrices(outputs)

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
        return np.asarray(1.0 / (1.0 + 1j * w / (2 * np.pi * self.cutoff_hz)))


def hidden_filters(model: AugmentedModel) -> dict[str, LowPass]:
    """{channel: low-pass} that the diagnosis found; the known filters follow them."""
    law, periods = _hidden(model)
    if law == "delay":
        return {}
    kind = FirstOrderLowPass if law == "first order" else LowPass
    return {c: kind(1.0 / period, "found by the diagnosis") for c, period in periods.items()}


def _hidden(model: AugmentedModel) -> tuple[str, dict[str, float]]:
    """The law of a sensor filter without its place, and {channel: 1/cut-off [s]}."""
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
            out.append("the lag of the heading behind a filtered gyro, which turns V_y, is not included")
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
    roll = model.structure.roll
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
    """Unit of a parameter; of a derivative by v or r, that of the derivative times the speed."""
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
