"""What is linear of an augmented model, as M x' = F x + G u(t - tau), y = H0 x + H1 x'.

The rover as in equation (18) of the paper as corrected, and with it the servo's lag, the tyres' relaxation
length, roll steer, mounting angles of the IMU and the lag of the velocity. What is not linear stands in
`left_out`, in words.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin
from typing import Any

import numpy as np

from rover_sweep.diagnosis.augmented import AugmentedModel
from rover_sweep.identify.recording import Array, LowPass
from rover_sweep.identify.structure import Matrices, ModelStructure, Parameter

FAST = 1e4  # rad/s, of a yaw rate that follows the steering at once
SHORTEST = 1e-5  # s, below which a lag is none
CONSTANT = {"cross_slope", "surface_change", "clock_offset", "speed_variation"}
NONLINEAR = {
    "servo_rate_limit", "steering_deadband", "steering_backlash", "steering_nonlinearity",
    "steering_asymmetry", "tyre_saturation", "load_transfer", "suspension_friction",
}  # fmt: skip
UNITS = {
    "m": "kg", "ms": "kg", "h": "m", "Ixx": "kg m^2", "Izz": "kg m^2", "Ixz": "kg m^2", "a": "m", "b": "m",
    "Cf": "N/rad", "Cr": "N/rad", "k_phi": "N m/rad", "b_phi": "N m s/rad", "g": "m/s^2", "sigma": "m",
    "e_roll": "rad/rad", "imu_x": "m", "imu_z": "m", "L_eff": "m", "gain": "-", "lag": "s", "lag_shape": "-",
    "vy_lag": "s", "vy_gain": "-", "pitch": "rad", "yaw": "rad", "tau": "s",
    "late_r": "s", "late_ay": "s", "late_vydot": "s", "late_p": "s",
}  # fmt: skip
ROVER = ("m", "Izz", "Ixz", "a", "b", "Cf", "Cr", "g", "imu_x")
ROLLING = ("ms", "h", "Ixx", "k_phi", "b_phi", "imu_z")
LATE = ("late_r", "late_ay", "late_vydot", "late_p")
OPTIONAL = ("sigma", "e_roll", "lag", "lag_shape", "vy_lag", "vy_gain", "pitch", "yaw", *LATE)


def linear(model: AugmentedModel) -> ModelStructure:
    """The linear part about straight driving; its parameters are the physical numbers, all fixed.

    Outputs r, ay, vydot and, with roll, p, at the IMU; delays of the steering and of the channels beside.
    """
    values = _values(model)
    slip, roll = model.structure.slip, model.structure.roll
    states = _states(values, slip, roll)
    outputs = ("r", "ay", "vydot", "p") if roll else ("r", "ay", "vydot")
    late = {o: f"late_{o}" for o in outputs if f"late_{o}" in values}

    def build(p: Mapping[str, Any]) -> Matrices:
        return _Equations(p, states, slip, roll).matrices(outputs)

    return ModelStructure(
        name=model.name,
        states=states,
        outputs=outputs,
        parameters=tuple(Parameter(name, UNITS[name], value) for name, value in values.items()),
        build=build,
        reference="equation (18) as corrected, with what was found to be missing",
        input_delays={"delta": "tau"},
        output_delays=late,
        units={"wheel": "rad", "wheel_rate": "rad/s", "F_f": "N", "F_r": "N", "V_m": "m/s"},
    )


def hidden_filters(model: AugmentedModel) -> dict[str, LowPass]:
    """{channel: low-pass} that nobody knew of, behind which the known ones are."""
    if "sensor_filter" not in model.effects:
        return {}
    gyro, accel = (model.value(f"sensor_filter.{name}") for name in ("gyro_hz", "accel_hz"))
    source = "found by the diagnosis"
    found = {c: LowPass(1.0 / gyro, source) for c in ("r", "p") if gyro > 0}
    return found | ({"ay": LowPass(1.0 / accel, source)} if accel > 0 else {})


def left_out(model: AugmentedModel) -> list[str]:
    """What the linear model lacks and why, one sentence each."""
    out = []
    for effect in model.added:
        if effect.id in NONLINEAR | CONSTANT:
            numbers = ", ".join(f"{p} = {v:.4g} {unit}" for p, (v, unit, _) in model.reported(effect).items())
            why = "is not linear" if effect.id in NONLINEAR else "is no part of a linear model of the rover"
            out.append(f"{effect.id} ({effect.equation}; {numbers}) {why}")
    constants = {"trim": ("trim of the steering", "rad"), "bias_ay": ("constant of a_y", "m/s^2")}
    for name, (what, unit) in constants.items():
        if abs(model.value(name)) > 1e-6:
            out.append(f"the {what}, {model.value(name):.3g} {unit}, is a constant")
    if (scale := model.value("vscale")) != 0.0:
        out.append(f"the log's speed, which is to be multiplied by {1 + scale:.4f}; here the true one counts")
    return out


def _values(model: AugmentedModel) -> dict[str, float]:
    """The parameters that this model has."""
    n, x = model.numbers, model.value
    delay, late = _delays(model)
    roll = model.structure.roll
    own = ("Izz", "Ixz", "g", "imu_x", "L_eff") if "L_eff" in n else ROVER
    every = n | {
        "gain": 1.0 + x("scale"), "lag": x("lag"), "lag_shape": x("lag_shape"),
        "vy_lag": x("vy_lag"), "vy_gain": x("vy_gain"),
        "pitch": x("imu_tilt.pitch"), "yaw": x("imu_tilt.yaw"),
        "tau": delay, **late,
    }  # fmt: skip
    names = [*own, *(ROLLING if roll else ()), "gain", "tau"]
    names += [o for o in OPTIONAL if abs(every[o]) > SHORTEST and (roll or o not in ("e_roll", "late_p"))]
    return {name: every[name] for name in names}


def _delays(model: AugmentedModel) -> tuple[float, dict[str, float]]:
    """Delay of the steering [s] and {"late_<output>": what that lags it by}, none of them negative.

    A clock's offset is no delay of the rover: the usual one is taken there.
    """
    from rover_sweep.identify.effects.clock_offset import USUAL_DELAY

    delay = USUAL_DELAY if "clock_offset" in model.effects else model.value("delay")
    lags = {name: model.value(f"{name.removeprefix('late_')}_lag") for name in ("late_ay", "late_p")}
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


class _Equations:
    """Rows of M, F, G filled in by the names of the states; a term is {state: factor}."""

    def __init__(self, p: Mapping[str, Any], states: tuple[str, ...], slip: bool, roll: bool) -> None:
        self.p, self.states, self.slip, self.roll = p, states, slip, roll
        kind = np.result_type(*(np.asarray(v).dtype for v in p.values()), float)
        self.m, self.f = (np.zeros((len(states), len(states)), kind) for _ in range(2))
        self.g = np.zeros(len(states), kind)

    def matrices(self, outputs: tuple[str, ...]) -> Matrices:
        """All of it."""
        self._servo()
        if self.slip:
            self._tyres()
        else:
            self._follows()
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
        """A term of a row in the true wheel angle."""
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
        """Side force and yaw moment of both axles, at once or over the relaxation length."""
        p, v = self.p, self.p["V"]
        self._put(self.m, "V_y", {"V_y": p["m"]})
        self._put(self.f, "V_y", {"r": -p["m"] * v})
        self._put(self.m, "r", {"r": p["Izz"]})
        axles = (("F_f", p["Cf"], p["a"], True), ("F_r", p["Cr"], -p["b"], False))
        for force, c, arm, steered in axles:
            slip = {"V_y": -c / v, "r": -c * arm / v}
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

    def _rolls(self) -> None:
        """(Ixx + ms h^2) p' + Ixz r' - h ms (V_y' + V r) = (ms g h - k) phi - b p, and what acts back."""
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
        """T V_m' = V_y at the IMU - V_m - T V r: the heading runs away from a velocity that lags."""
        if "V_m" not in self.states:
            return
        p = self.p
        at_imu = {"V_y": 1.0} if self.slip else {}
        at_imu |= {"p": -p["imu_z"]} if self.roll else {}
        self._put(self.m, "V_m", {"V_m": p["vy_lag"]})
        self._put(self.f, "V_m", {**at_imu, "r": p["imu_x"] - p["vy_lag"] * p["V"], "V_m": -1.0})

    def _outputs(self, outputs: tuple[str, ...]) -> tuple[Array, Array]:
        """H0, H1 of r, ay, vydot and p as the IMU shows them."""
        p = self.p
        rate = {"r": p["imu_x"]} | ({"V_y": 1.0} if self.slip else {})
        rate |= {"p": -p["imu_z"]} if self.roll else {}
        turned, tilt = p.get("yaw", 0.0), p.get("pitch", 0.0)
        level = cos(turned)
        ay = {"r": level * p["V"]} | ({"phi": level * p["g"]} if self.roll else {})
        mix = (cos(tilt), sin(tilt)) if self.roll else (1.0, 0.0)
        gain = 1.0 + p.get("vy_gain", 0.0)
        shown: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
            "r": ({"r": mix[0]} | ({"p": mix[1]} if self.roll else {}), {}),
            "ay": (ay, {state: level * factor for state, factor in rate.items()}),
            "vydot": ({}, {s: gain * k for s, k in ({"V_m": 1.0} if "V_m" in self.states else rate).items()}),
            "p": ({"p": mix[0], "r": -mix[1]} if self.roll else {}, {}),
        }
        h = np.zeros((2, len(outputs), len(self.states)), self.m.dtype)
        for row, output in enumerate(outputs):
            for k, terms in enumerate(shown[output]):
                for state, factor in terms.items():
                    h[k, row, self._at(state)] += factor
        return h[0], h[1]
