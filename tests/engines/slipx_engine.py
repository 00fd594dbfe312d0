"""slipx (double track in C++, for cars of 1:10) as an engine, scaled to every size.

Slip angles with relaxation, load transfer, Magic Formula with a load-sensitive peak, friction ellipse, open
or locked differential, motor, battery and the drive's losses are slipx's. It has no roll: a body on a spring
rolls on its frame here, and its reaction goes back into the frame's sideways velocity at each step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import slipx

from tests.engines.engine import Array, Engine, EngineRover, Signals, at_speed, load_roll, load_step
from tests.engines.shared_laws import (
    EVERYWHERE,
    PATH,
    SENSING,
    outside_laws,
    own_numbers,
    steered,
    vehicle_laws,
)
from tests.foreign.grade import PLACES
from tests.foreign.laws import Extras, Law, peak_ay, share_of_base, valued
from tests.foreign.plant import DT, GRAVITY, ROAD_ROLL, ROAD_Y, ROAD_YAW, WIND_X, WIND_Y, bump_moment
from tests.foreign.recorded import mounted
from tests.foreign.rover import SIZES, Rover


def _narrow(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(track=lifted_track(rover, size))


def lifted_track(rover: Rover, size: float) -> float:
    """Track [m] at which the inner wheels lift at 1/size of a steady turn's a_y at the large amplitude."""
    n = rover.numbers
    return 2 * (n.h + n.roll_axis) * peak_ay(rover) / size / GRAVITY


LISTED: tuple[Law, ...] = (
    *(law for law in PATH if law.place != "compliance"),  # no force comes back into the steering
    *SENSING,
    *vehicle_laws(("tyre_saturation", "Magic Formula"), ("front_rear_stiffness", "ratio"), ("side_wind", "")),
    Law("yaw_damping", "spool", "yaw", 0.99, 1.0, own_numbers(spool="size"), "-", absolute=True),
    Law(
        "tyre_relaxation", "slip angle", "tyre", 0.06, 1.5, valued("sigma", share_of_base), "m", share_of_base
    ),
)
OUTSIDE: tuple[Law, ...] = (
    *outside_laws(EVERYWHERE),
    Law("outside:wheel_lift", "load to zero", "tyre", 0.6, 1.8, _narrow, "m", lifted_track),
)


MU = 2.0
RELAXATION = 0.03  # of the wheelbase
STEERING_W = 300.0  # rad/s, of slipx's own servo behind the path's


def _parameters(rover: EngineRover) -> slipx.VehicleParams:
    n, mu = rover.numbers, min(rover.numbers.mu, MU)
    base = n.a + n.b
    p = slipx.load_reference_car().params
    p.mass, p.lf, p.lr, p.izz = n.m, n.a, n.b, n.Izz
    p.ixx, p.h_cog, p.track_front, p.track_rear = n.Ixx, n.h + n.roll_axis, n.track, n.track
    p.c_alpha_f, p.c_alpha_r, p.c_kappa = n.Cf, n.Cr, 1.5 * (n.Cf + n.Cr) / 2
    p.wheel_radius, p.mu_clip, p.roll_resist = rover.instruments.wheel_radius, mu, n.rolling
    p.steer_bandwidth, p.steer_damping, p.steer_rate_max, p.steer_max = STEERING_W, 0.8, 100.0, 0.6
    scale = n.m / 3.5 * rover.instruments.wheel_radius / 0.05  # of the reference car's motor
    p.torque_stall, p.torque_per_amp = p.torque_stall * scale, p.torque_per_amp * scale
    p.differential = slipx.Differential.Spool if rover.own.get("spool") else slipx.Differential.Open
    for tyre in (p.tyre_front, p.tyre_rear):
        tyre.mu_y0, tyre.mu_x0, tyre.shape_c, tyre.curvature_e = mu, 1.1 * mu, 1.4, 0.0
        tyre.k_mu, tyre.relax_length = 0.1, max(RELAXATION * base, n.sigma)
    return p


def _run(rover: EngineRover, delta: Array, wanted: Array, around: Array, heading: float) -> Array:
    """(steps, 8): u, v, r, phi, p, psi, side acceleration of the roll axis and roll acceleration."""
    n = rover.numbers
    model = slipx.VehicleModel.create(slipx.Tier.L2_DoubleTrack, _parameters(rover))
    state, order = slipx.VehicleState(), slipx.DriveInput()
    state.yaw = heading
    step: Any = model.step
    rates, velocity = state.rates, state.vel_body
    about, heave = n.Ixx + n.ms * n.h**2, n.ms * n.h / n.m
    stiff, lever = n.kphi - n.ms * GRAVITY * n.h, n.ms * n.h
    out = np.empty((delta.size, 8))
    phi = p = p_dot = across = toe = 0.0
    load = np.zeros(2)
    ground = around[:, [ROAD_Y, ROAD_YAW, ROAD_ROLL, WIND_X, WIND_Y]].tolist()
    for k, (angle, speed, (side, yaw, roll, wind_x, wind_y)) in enumerate(
        zip(delta.tolist(), wanted.tolist(), ground, strict=True)
    ):
        u, v, r, psi = velocity.x, velocity.y, rates.z, state.yaw
        if wind_x or wind_y:
            wind = wind_y * np.cos(psi) - wind_x * np.sin(psi)
            side, yaw, roll = side + wind, yaw + wind * n.wind_x, roll - wind * n.wind_z
        if n.loose:
            force = load_step(load, across - n.h * p_dot, n, DT)
            side, roll = side + force, roll + load_roll(load, force, n)
        order.steer_cmd = angle - toe + n.roll_steer_front * phi
        order.accel_cmd = max(-n.most_drive, min(n.most_drive, (speed - u) / n.tau_drive))
        yaw -= n.yaw_c * r + n.yaw_c2 * r * abs(r)
        step(state, order, DT)
        velocity.y += DT * (side / n.m + heave * p_dot)
        rates.z += DT * yaw / n.Izz
        across = (velocity.y - v) / DT + u * r
        if n.compliance:
            front = (n.b * n.m * across + n.Izz * (rates.z - r) / DT) / (n.a + n.b)
            toe += DT / n.compliance_lag * (n.compliance * front - toe)
        if n.bump:
            roll -= bump_moment(phi, n)
        p_dot = (lever * across - stiff * phi - n.bphi * p + roll) / about
        out[k] = u, v, r, phi, p, psi, across, p_dot
        p += DT * p_dot
        phi += DT * p
    return out


def _signals(rover: EngineRover, command: Array, wanted: Array, around: Array, heading: float) -> Signals:
    rover = at_speed(rover, float(np.max(wanted)))
    i, n = rover.instruments, rover.numbers
    found = _run(rover, steered(command, wanted, n), wanted, around, heading)
    u, v, r, phi, p, psi, across, p_dot = found.T
    r_dot, u_dot = np.gradient(r, DT), np.gradient(u, DT)
    cos, sin, z = np.cos(phi), np.sin(phi), i.imu_z
    side = across + r_dot * i.imu_x - z * (cos * p_dot - sin * p * p) + r * r * z * sin
    up = GRAVITY - z * (sin * p_dot + cos * p * p)
    ahead = u_dot - v * r - r * r * i.imu_x
    return {
        **mounted(r * cos, p.copy(), (ahead, cos * side + sin * up, cos * up - sin * side), i),
        "vy": v + r * i.imu_x - z * cos * p,
        "speed": u,
        "phi": phi,
        "psi": np.unwrap(psi),
    }


ENGINE = Engine("slipx", SIZES, _signals, LISTED, OUTSIDE, PLACES)
