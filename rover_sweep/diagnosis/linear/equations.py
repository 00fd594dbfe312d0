"""The rows of a linear rover's equations, by the names of its states: M x' = F x + G u, y = H0 x + H1 x'.

Three kinds: tyres (equation (18) of the paper, corrected), kinematic (the yaw rate follows the steering at
once), lumped derivatives (equation (19)); each with servo, roll, tyre relaxation and IMU. States: wheel
[rad], wheel_rate [rad/s], V_y [m/s], r, p [rad/s], phi [rad], F_f, F_r [N], V_m [m/s].
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin
from typing import Any, Literal

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.identification.structure.state_space import Matrices

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
