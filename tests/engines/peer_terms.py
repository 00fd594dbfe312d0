"""Terms of the sparse regression, and the effect that a person reads from each. One table, never tuned."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rover_sweep.data.recording import Array

READ: dict[str, dict[str, str]] = {  # equation: {term: id of the effect, "" where it has no name in the list}
    "yaw": {
        "1": "steering_trim",
        "delta": "steering_scale",
        "delta^2": "steering_asymmetry",
        "|delta|": "steering_asymmetry",
        "delta^3": "steering_nonlinearity",
        "sign delta": "steering_deadband",
        "delta'": "servo_lag",
        "delta' |delta'|": "servo_rate_limit",
        "sign delta'": "steering_backlash",
        "V delta": "",
        "v": "front_rear_stiffness",
        "V v": "front_rear_stiffness",
        "r": "yaw_damping",
        "V r": "yaw_damping",
        "r |r|": "",
        "r'": "sensor_filter",
        "p": "",
        "sign p": "suspension_friction",
        "p'": "",
        "phi": "roll_steer",
        "a_y": "steering_compliance",
        "a_y |a_y|": "load_transfer",
        "a_y^3": "tyre_saturation",
        "cos psi": "side_wind",
        "sin psi": "side_wind",
    },
    "lateral": {
        "1": "imu_tilt",
        "delta": "steering_scale",
        "delta^2": "steering_asymmetry",
        "|delta|": "steering_asymmetry",
        "delta^3": "steering_nonlinearity",
        "sign delta": "steering_deadband",
        "delta'": "servo_lag",
        "delta' |delta'|": "servo_rate_limit",
        "sign delta'": "steering_backlash",
        "V delta": "",
        "v": "front_rear_stiffness",
        "V v": "front_rear_stiffness",
        "r": "",
        "V r": "sensor_scale",
        "r |r|": "",
        "r'": "imu_offset",
        "p": "",
        "sign p": "suspension_friction",
        "p'": "imu_offset",
        "phi": "imu_tilt",
        "a_y": "sensor_scale",
        "a_y |a_y|": "load_transfer",
        "a_y^3": "tyre_saturation",
        "cos psi": "cross_slope",
        "sin psi": "cross_slope",
    },
}


def terms(x: Mapping[str, Array]) -> dict[str, Array]:
    """{term: (k,)} of a run's signals {name: (k,)}, SI units, ISO axes."""
    delta, rate, r, p, ay = x["delta"], x["delta'"], x["r"], x["p"], x["a_y"]
    return {
        "1": np.ones(r.size),
        "delta": delta,
        "delta^2": delta**2,
        "|delta|": np.abs(delta),
        "delta^3": delta**3,
        "sign delta": _sign(delta),
        "delta'": rate,
        "delta' |delta'|": rate * np.abs(rate),
        "sign delta'": _sign(rate),
        "V delta": x["V"] * delta,
        "v": x["v"],
        "V v": x["V"] * x["v"],
        "r": r,
        "V r": x["V"] * r,
        "r |r|": r * np.abs(r),
        "r'": x["r'"],
        "p": p,
        "sign p": _sign(p),
        "p'": x["p'"],
        "phi": x["phi"],
        "a_y": ay,
        "a_y |a_y|": ay * np.abs(ay),
        "a_y^3": ay**3,
        "cos psi": np.cos(x["psi"]),
        "sin psi": np.sin(x["psi"]),
    }


def _sign(y: Array) -> Array:
    """The sign, smoothed where y is below a twentieth of its rms."""
    return np.tanh(y / (0.05 * max(float(np.std(y)), 1e-9)))
