"""Effects of the instruments: position, tilt, scale, filter and clock of each channel.

r, p: yaw and roll rate [rad/s]. a_x, a_y: acceleration along and across [m/s^2]. s in a filter: j w.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array, LowPass
from rover_sweep.diagnosis.effects.effect import EffectParameter as P
from rover_sweep.diagnosis.effects.effect import (
    FilterEffect,
    Motion,
    NominalEffect,
    SensorEffect,
    Values,
    family,
)

USUAL_DELAY = 0.02  # s, of the steering itself


def rotated(measured: Motion, motion: Motion, q: Values) -> dict[str, Array]:
    """r and p rotated by the pitch angle, a_y by the yaw angle; the roll angle is in the bias of a_y."""
    out = dict(measured)
    c, s = np.cos(q["pitch"]), np.sin(q["pitch"])
    if "r" in measured and "p" in measured:
        out["r"] = c * measured["r"] + s * measured["p"]
        out["p"] = c * measured["p"] - s * measured["r"]
    if "ay" in measured:
        along = motion["v_dot_x"] - motion["r"] * motion["v"]
        out["ay"] = np.cos(q["yaw"]) * measured["ay"] - np.sin(q["yaw"]) * along
    return out


def scaled(out: Mapping[str, Array], motion: Motion, q: Values) -> Mapping[str, Array]:
    """The channels {channel: (n,)} with the scale errors."""
    factors = {"r": 1.0 + q["gyro"], "p": 1.0 + q["gyro"], "ay": 1.0 + q["accel"]}
    return {c: y * factors.get(c, 1.0) for c, y in out.items()}


def late_velocity(out: Mapping[str, Array], motion: Motion, q: Values) -> Mapping[str, Array]:
    """V_y {channel: (n,)} from the velocity T ago, in the present body axes."""
    if "vy" not in out or q["T"] <= 0.0:
        return out
    t = motion["t"]
    begin = t - q["T"]
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (motion["r"][1:] + motion["r"][:-1]) * np.diff(t))))
    angle = turned - np.interp(begin, t, turned)
    side, ahead = np.interp(begin, t, out["vy"]), np.interp(begin, t, motion["V"])
    return {**out, "vy": side * np.cos(angle) - ahead * np.sin(angle)}


def low_passes(response: Callable[[Array, float], Any]) -> Callable[[Array, Values], dict[str, Any]]:
    """(w, q) -> {channel: response (k,)} of r, p and a_y. response: (w (k,) rad/s, 1/f [s]) -> (k,)."""
    names = {"r": "gyro_hz", "p": "gyro_hz", "ay": "accel_hz"}
    return lambda w, q: {c: response(w, q[name]) for c, name in names.items() if q[name] > 0}


def _cutoff(name: str, convention: str) -> P:
    return P(name, "Hz", 0.15, 0.0, 1.0, convention, "inverse", tolerance=0.008, matters=0.035, doubt=0.007)


second_order = low_passes(lambda w, period: LowPass(1.0 / period).response(w))
first_order = low_passes(lambda w, period: 1.0 / (1.0 + 1j * w / (2 * np.pi) * period))
pure_delay = low_passes(lambda w, period: np.exp(-1j * w / (2 * np.pi) * period))

LAWS = (
    # The vehicle has no part in it, and it is the same as the steering's own delay, of which 20 ms (0 to 40)
    # are usual. Needs data of two clocks.
    NominalEffect(
        id="clock_offset",
        title="clocks of steering and motion disagree",
        equation="u(t - T), not a delay of the vehicle",
        source="definition of a time offset",
        parameters=(
            P(
                "T",
                "s",
                0.06,
                -0.5,
                0.5,
                "the time stamps of the steering are early by T",
                doubt=0.01,
                nominal="delay",
            ),
        ),
        apart="possible only with two clocks in the data; it may change from run to run, a delay does not",
        next_run="read the DataFlash log of the same run, in which one clock stamps everything",
        releases={"delay": (-0.5, 0.5)},
        report_values=lambda found: {
            "T": (USUAL_DELAY - found["T"], "s", "the time stamps of the steering are late by T")
        },
    ),
    # The error grows as w relative to r (x) and as w^2 relative to phi (z): one sweep is enough, and so is a
    # ruler. A vehicle file gives the CG and the roll axis to 5 mm.
    NominalEffect(
        id="imu_offset",
        title="the IMU is not where the vehicle file says",
        equation="a_y + x r' - z p'",
        source="acceleration of a point of a rigid body",
        parameters=(
            P(
                "x",
                "m",
                0.05,
                -1.0,
                1.0,
                "IMU further forward than the file says",
                matters=0.012,
                doubt=0.005,
                nominal="imu_x",
            ),
            P(
                "z",
                "m",
                0.05,
                -1.0,
                1.0,
                "IMU further up than the file says",
                matters=0.012,
                doubt=0.005,
                nominal="imu_z",
            ),
        ),
        apart="r and p are correct; a filter changes the phase and does not raise the gain",
        next_run=(
            "weigh both axles to place the CG (are cg_to_front_axle and cg_to_rear_axle interchanged?), and "
            "measure from it to the autopilot with a ruler"
        ),
        releases={"imu_x": (-1.0, 1.0), "imu_z": (-1.0, 1.0)},
        channels=("ay",),
    ),
    # roll adds a constant to a_y, also at standstill: the nominal `bias_ay`. The bias of an accelerometer is
    # up to 0.3 m/s^2. pitch mixes p and r, yaw mixes a_x and a_y. Needs standstill and two headings.
    SensorEffect(
        id="imu_tilt",
        title="the IMU is mounted at an angle",
        equation="r + pitch p, p - pitch r, a_y - yaw a_x, a_y + g sin(roll)",
        source="rotation of the sensor axes; Titterton and Weston 2004, chapter 3",
        parameters=(
            P(
                "roll",
                "rad",
                0.08,
                -0.5,
                0.5,
                "right side of the IMU down: a_y + g sin(roll)",
                tolerance=0.01,
                matters=0.0306,
                doubt=0.015,
                nominal="bias_ay",
                per=GRAVITY,
            ),
            P(
                "pitch",
                "rad",
                0.08,
                -0.5,
                0.5,
                "nose of the IMU down: yaw rate appears in p",
                tolerance=0.01,
                matters=0.02,
            ),
            P("yaw", "rad", 0.08, -0.6, 0.6, "IMU turned to the left", tolerance=0.01, matters=0.05),
        ),
        apart="a slope changes with the heading; a trim changes r as well",
        next_run="a_y at standstill on a level floor at two headings",
        act=rotated,
        releases={"bias_ay": (-6.0, 6.0)},
    ),
    # Of r and p, and of a_y. Where the filter is in the sensor, the estimator integrates the filtered r: its
    # heading lags, and V_y changes by V times the error. A sensor has 1.5 ms of its own (0.007 s of 1/f).
    *family(
        FilterEffect(
            id="sensor_filter",
            title="an unknown sensor filter",
            equation="1/(1 + sqrt(2) s/w0 + (s/w0)^2), w0 = 2 pi f",
            source="second-order Butterworth, ArduPilot LowPassFilter2p",
            parameters=(
                _cutoff("gyro_hz", "cut-off of the low-pass on r and p"),
                _cutoff("accel_hz", "cut-off of the low-pass on a_y"),
            ),
            apart="a steering lag delays all channels equally",
            next_run="read INS_GYRO_FILTER and INS_ACCEL_FILTER, or log raw IMU",
            response=second_order,
            signed=False,
            form="second order",
        ),
        {
            "form": "first order",
            "equation": "1/(1 + s/w0), w0 = 2 pi f",
            "source": "first-order lag, ArduPilot LowPassFilter",
            "response": first_order,
        },
        {
            "form": "delay",
            "equation": "exp(-s/w0), w0 = 2 pi f",
            "source": "transport delay; 1/w0 is the delay",
            "response": pure_delay,
        },
        {
            "form": "first order, before the estimator",
            "equation": "1/(1 + s/w0), w0 = 2 pi f, and the heading integrates it",
            "source": "first-order lag in the sensor",
            "response": first_order,
            "heading": True,
        },
        {
            "form": "second order, before the estimator",
            "equation": "1/(1 + sqrt(2) s/w0 + (s/w0)^2), w0 = 2 pi f, and the heading integrates it",
            "heading": True,
        },
    ),
    # The steering's scale and the speed take the place of a gyro's scale unless a_y = V r + v' holds them.
    SensorEffect(
        id="sensor_scale",
        title="a sensor with a wrong scale",
        equation="measured = (1 + s) true",
        source="Titterton and Weston 2004, scale factor error",
        parameters=(
            P("gyro", "-", 0.08, -0.5, 0.5, "scale error of r and p", tolerance=0.01, matters=0.03),
            P("accel", "-", 0.08, -0.5, 0.5, "scale error of a_y", tolerance=0.01, matters=0.03),
        ),
        apart="a wrong steering scale changes r and a_y alike",
        next_run="turn the rover by hand by ten full turns; tilt it by a known angle",
        act=scaled,
    ),
    # V_m: the estimate, in earth axes, so that in a turn the lag takes T V r from V_y as well. Shows in V_y'
    # only.
    *family(
        NominalEffect(
            id="velocity_lag",
            title="the EKF's velocity lags",
            equation="T V_m' = V - V_m",
            source="GPS and EKF lag, ArduPilot issue 2850",
            parameters=(
                P(
                    "T",
                    "s",
                    0.08,
                    0.0,
                    1.0,
                    "time constant of the lag of the velocity",
                    matters=0.01,
                    nominal="vy_lag",
                ),
            ),
            apart="r and a_y are correct",
            next_run="read EK3_VEL_DELAY or the GPS delay; compare with a_y integrated",
            releases={"vy_lag": (0.0, 1.0)},
            channels=("vy",),
            signed=False,
            form="first order",
        ),
        {
            "kind": SensorEffect,
            "form": "delay",
            "equation": "V_m(t) = V(t - T)",
            "source": "delay of a GPS velocity, EK3_VEL_DELAY",
            "parameters": (P("T", "s", 0.08, 0.0, 1.0, "delay of the velocity", matters=0.01),),
            "act": late_velocity,
        },
    ),
)
