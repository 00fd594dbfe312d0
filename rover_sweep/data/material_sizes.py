"""[material] of the vehicle file: normal tolerances; a smaller deviation is not reported as a finding.

For a quantity fitted within bounds the size is the bound. For one with a Gaussian prior it is two standard
deviations of the prior. The standard deviation of a number that the vehicle file has, if written there, wins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rover_sweep.data.tolerances import Tolerances


@dataclass(frozen=True)
class MaterialSize:
    """A key of [material]. field: of `Tolerances`; deviations: size over that field; most: largest size.

    A field of a length is a share of the wheelbase.
    """

    unit: str
    meaning: str
    field: str
    deviations: float
    most: float

    @property
    def default(self) -> float:
        """The default size, in `unit`; a length is that of a wheelbase of 0.5 m."""
        wheelbase = 0.5 if self.unit == "m" else 1.0
        return float(self.deviations * wheelbase * getattr(Tolerances(), self.field))


MATERIAL: dict[str, MaterialSize] = {
    "servo_lag": MaterialSize("s", "lag of the steering servo", "lag", 1, 0.5),
    "transport_delay": MaterialSize("s", "delay from command to wheel", "delay", 1, 0.5),
    "lag_and_delay": MaterialSize("s", "lag and delay together", "together", 1, 1.0),
    "front_rear_stiffness": MaterialSize("-", "ln(Cf/Cr), so .15 is 15 %", "ratio", 1, 1.6),
    "lateral_bias": MaterialSize("m/s^2", "steady a_y", "bias_ay", 1, 5.0),
    "steering_trim": MaterialSize("rad", "road-wheel angle at trim_us", "trim", 1, 0.3),
    "steering_scale": MaterialSize("-", "share of rad_per_us", "scale", 2, 0.5),
    "speed_scale": MaterialSize("-", "share of the measured speed", "speed", 2, 0.5),
    "cg_position": MaterialSize("m", "CG along the rover", "cg", 2, 1.0),
    "cg_height_share": MaterialSize("-", "share of cg_height_above_roll_centre", "h", 2, 1.0),
    "roll_inertia_share": MaterialSize("-", "share of roll_inertia", "roll_inertia", 2, 1.0),
    "imu_position": MaterialSize("m", "place of the IMU", "imu_x", 2, 1.0),
    "sensor_lag": MaterialSize("s", "lag of a_y or p beyond the known filters", "sensor_lag", 2, 0.2),
    "velocity_scale": MaterialSize("-", "share of the EKF's V_y", "velocity_gain", 2, 1.0),
    "velocity_lag": MaterialSize("s", "lag of the EKF's velocity", "velocity_lag", 1, 1.0),
}


def read_material(table: Mapping[str, Any]) -> tuple[dict[str, float], list[str]]:
    """({key: size}, a sentence for each problem) of the table [material], unknown keys ignored."""
    sizes, problems = {}, []
    for key, entry in table.items():
        if (rule := MATERIAL.get(key)) is None:
            continue
        unit = "" if rule.unit == "-" else f" {rule.unit}"
        example = f"as in: {key} = {rule.default:g}{f'  #{unit}' if unit else ''}"
        if isinstance(entry, bool) or not isinstance(entry, int | float):
            problems.append(f"[material] {key} is {entry!r}; it must be a plain number, {example}")
        elif not 0 < entry <= rule.most:
            above = f"above 0 and at most {rule.most:g}{unit}"
            problems.append(f"[material] {key} is {entry:g}{unit}; it must be {above}, {example}")
        else:
            sizes[key] = float(entry)
    return sizes, problems
