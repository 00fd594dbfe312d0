"""A model with effects of one's choice, on a recording of the real firmware with a doublet."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import log
from pathlib import Path

from rover_sweep.api.read import Reading, load_steered
from rover_sweep.data.recording import LowPass, Recording
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.effects import form_named
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel

ROVER = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c"
VEHICLE = load_vehicle(ROVER / "rover.toml")
RUN = ROVER / "run4.BIN"
SPEED = 2.2
SMOOTH = """base = "nominal"
road_force = 0.0
road_yaw_moment = 0.0
road_roll_moment = 0.0
gyro_noise = 0.0
accel_noise = 0.0
vibration = 0.0
velocity_error = 0.0
attitude_error = 0.0
gyro_bias = [0.0, 0.0, 0.0]
"""  # the nominal simulated rover on a road without a pebble, with sensors that do not hiss
ORDINARY = {
    "lag": 0.02,
    "lag_shape": 0.0,
    "delay": 0.02,
    "vy_lag": 0.0,
    "ln_C": log(35.0),
    "ln_Izz": log(0.075),
    "ln_ratio": 0.1,
    "ln_k_phi": log(11.5),
    "ln_b_phi": log(0.34),
    "ln_L_eff": log(0.4),
}
SIZES = {
    "clock_offset": {"delay": -0.04},
    "imu_tilt": {"bias_ay": 0.6, "imu_tilt.pitch": 0.1, "imu_tilt.yaw": 0.1},
    "servo_lag/second order": {"lag": 0.05, "lag_shape": 1.0},
    "side_wind": {"side_wind.w_cos": 0.8, "side_wind.w_sin": 0.5},
    "surface_change": {"surface_change.ratio": -0.3, "surface_change.t": 8.0},
}


@cache
def recording() -> Recording:
    """The doublet that all of this is driven by."""
    return load_steered([str(RUN)], VEHICLE, Reading())[0]


def model(*effects: str, baseline: str = "roll-yaw", **x: float) -> AugmentedModel:
    """An ordinary rover with effects, or their forms, of a size that is plain to see; x: more coordinates."""
    found = dict(ORDINARY)
    for name in effects:
        effect = form_named(name)
        own = {effect.coordinate_name(p): p for p in effect.parameters}
        found |= SIZES.get(name) or {key: found.get(key, 0.0) + p.size * p.per for key, p in own.items()}
    filters = {c: LowPass(20.0, "test") for c in ("r", "p", "ay")}
    known = geometry_of(VEHICLE), effects, found | x, SPEED, filters, VEHICLE.steering()
    return AugmentedModel(baseline, *known, wait=0.005, steering_origin="commanded")


def on_smooth_ground(variant: str, folder: Path) -> Path:
    """The variant with SMOOTH for its base, as a file in the folder."""
    (folder / "smooth.toml").write_text(SMOOTH)
    (folder / "variant.toml").write_text(variant.replace('base = "nominal"', 'base = "smooth.toml"'))
    return folder / "variant.toml"


def linear_only(baseline: str = "roll-yaw", *effects: str, **x: float) -> AugmentedModel:
    """The same with sensors that are as good as unfiltered."""
    return replace(model(*effects, baseline=baseline, **x), filters={})
