"""exudyn (multibody dynamics in C++) as an engine: velocity Verlet at 1 kHz.

The steering up to the wheels is `tests.foreign.plant`; all that follows are bodies, joints and contacts.
Drive, road and wind enter as forces of the joints before each step.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
from numba import njit

from tests.engines.engine import Array, Engine, EngineRover, Signals
from tests.engines.exudyn_model import REAR_L, REAR_R, ROLL, STEER_L, YAW, X, Y, built, exu
from tests.engines.shared_laws import (
    AROUND,
    EVERYWHERE,
    OWN_PARTS,
    PATH,
    SENSING,
    outside_laws,
    own_numbers,
    steered,
    toes,
    vehicle_laws,
)
from tests.foreign.grade import PLACES
from tests.foreign.laws import Extras, Law, friction_limit, per_newton, valued
from tests.foreign.plant import DT, GRAVITY, ROAD_ROLL, ROAD_Y, ROAD_YAW, SURFACE, WIND_X, WIND_Y, Numbers
from tests.foreign.recorded import mounted
from tests.foreign.rover import SIZES, Rover


def _bend(rover: Rover, size: float, _extras: Extras) -> Rover:
    return cast(EngineRover, rover.of(mu=friction_limit(rover, size))).having(smooth=size)


def _dry_hinges() -> tuple[Law, ...]:
    return tuple(
        replace(law, form="dry hinges", own=False) for law in vehicle_laws(("suspension_friction", "tanh"))
    )


LISTED: tuple[Law, ...] = (
    *(law for law in PATH if law.place != "compliance"),  # made by the wheels' trail below
    *AROUND,
    *SENSING,
    *_dry_hinges(),
    *vehicle_laws(("cross_slope", "plane"), ("front_rear_stiffness", "ratio"), ("yaw_damping", "moment")),
    Law("steering_compliance", "trail", "compliance", 0.08, 0.6, toes, "rad/N", per_newton),
    Law(
        "tyre_saturation",
        "end of the zone",
        "tyre",
        0.7,
        1.5,
        valued("mu", friction_limit),
        "-",
        friction_limit,
    ),
    Law("tyre_saturation", "smooth zone", "tyre", 0.3, 1.3, _bend, "-", friction_limit),
    Law("yaw_damping", "locked rear axle", "yaw", 0.99, 1.0, own_numbers(spool="size"), "-", absolute=True),
)
_MADE = {"outside:sliding_load", *(law.effect for law in OWN_PARTS)}  # of bodies and joints here
OUTSIDE: tuple[Law, ...] = (
    *outside_laws(set(EVERYWHERE) - _MADE),
    *OWN_PARTS,
    Law("outside:sliding_load", "dry friction and stops", "cargo", 0.04, 0.35, own_numbers(sliding="size")),
)


# ---- The loop of a run.

SLOWEST = 0.3  # of the rover's speed: below it tyres resist in proportion to the sliding speed
CUT = 0.45  # share of the time in which a limping motor drags
EVERY = 10  # steps in which the tyres' zone follows the speed
CHASSIS = 6  # joints of the chassis: place, yaw, pitch, roll


@njit
def _forces(
    q: Array,
    v: Array,
    delta: float,
    wanted: float,
    around: Array,
    drag: float,
    radius: float,
    n: Numbers,
    force: Array,
    angle: Array,
) -> float:
    """Writes the forces of the joints and the steering angles; returns the forward speed [m/s].

    q, v: of the joints; drag: braking moment of the left rear wheel [N m].
    """
    psi, phi = q[YAW], q[ROLL]
    cos, sin = np.cos(psi), np.sin(psi)
    u, r = v[X] * cos + v[Y] * sin, v[YAW]
    for j in range(2):
        left = n.track / 2 if j == 0 else -n.track / 2
        turned = delta * (1.0 + n.ackermann * delta * left / (n.a + n.b))
        angle[STEER_L + j] = turned + n.roll_steer_front * phi
    drive = max(-n.most_drive, min(n.most_drive, (wanted - u) / n.tau_drive))
    drive -= n.rolling * GRAVITY * np.tanh(u / 0.05)
    force[REAR_L] = drive * n.m * radius / 2 - drag * np.tanh(u)
    if q.size > REAR_R:
        force[REAR_R] = drive * n.m * radius / 2
    wind = around[WIND_Y] * cos - around[WIND_X] * sin
    side = around[ROAD_Y] + wind  # at the roll axis, the wind above it
    ahead = around[WIND_X] * cos + around[WIND_Y] * sin
    force[X], force[Y] = ahead * cos - side * sin, ahead * sin + side * cos
    force[ROLL] = around[ROAD_ROLL] + side * n.h - wind * n.wind_z
    force[YAW] = around[ROAD_YAW] + wind * n.wind_x - n.yaw_c * r - n.yaw_c2 * r * abs(r)
    return u


def _run(
    rover: EngineRover, delta: Array, wanted: Array, around: Array, heading: float
) -> tuple[Array, Array]:
    """Joints of the chassis (steps, 6) and their rates."""
    build, n, own = built(rover, heading), rover.numbers, rover.own
    mbs, tree, radius = build.mbs, build.tree, rover.instruments.wheel_radius
    steps = delta.size
    places, rates = np.full((steps, CHASSIS), np.nan), np.full((steps, CHASSIS), np.nan)
    force, angle = np.zeros(build.joints), np.zeros(build.joints)
    spool = bool(own.get("spool"))
    t = np.arange(steps) * DT
    drags = own.get("drag", 0.0) * ((t / own.get("drag_period", 1.0)) % 1.0 < CUT)
    part = own.get("slip_speed", 0.0)
    data, set_object = mbs.systemData, mbs.SetObjectParameter
    at, ground = 0, 1.0

    def before(_mbs: Any, _t: float) -> bool:
        nonlocal at, ground
        if at >= steps:
            return True
        k = at
        q, v = data.GetODE2Coordinates(), data.GetODE2Coordinates_t()
        places[k], rates[k] = q[:CHASSIS], v[:CHASSIS]
        u = _forces(q, v, delta[k], wanted[k], around[k], drags[k], radius, n, force, angle)
        if spool:
            force[REAR_L] += force[REAR_L]
        set_object(tree, "jointForceVector", force)
        set_object(tree, "jointPositionOffsetVector", angle)
        if k % EVERY == 0:
            speed = max(SLOWEST * rover.speed, abs(u)) ** (1 - part) * rover.speed**part
            for j, disc in enumerate(build.discs):
                set_object(disc, "dryFrictionProportionalZone", build.zone[j // 2] * speed)
            if around[k, SURFACE] != ground:
                ground = around[k, SURFACE]
                for disc in build.discs:
                    set_object(disc, "dryFriction", [build.mu * ground] * 2)
        at += 1
        return True

    mbs.SetPreStepUserFunction(before)
    exu.config.printToConsole = False
    mbs.SolveDynamic(_settings(steps), solverType=exu.DynamicSolverType.VelocityVerlet)
    return places, rates


def _settings(steps: int) -> Any:
    found = exu.SimulationSettings()
    found.timeIntegration.numberOfSteps = steps
    found.timeIntegration.endTime = steps * DT
    found.timeIntegration.verboseMode = 0
    found.solution.file.write = False
    return found


def _signals(rover: EngineRover, command: Array, wanted: Array, around: Array, heading: float) -> Signals:
    i, n = rover.instruments, rover.numbers
    places, rates = _run(rover, steered(command, wanted, n), wanted, around, heading)
    psi, theta, phi = places[:, 3:6].T
    turns = rates[:, 3:6].T
    p = turns[2] - turns[0] * np.sin(theta)
    q = turns[1] * np.cos(phi) + turns[0] * np.sin(phi) * np.cos(theta)
    r = turns[0] * np.cos(phi) * np.cos(theta) - turns[1] * np.sin(phi)
    x, z = i.imu_x, i.imu_z - n.h  # from the CG
    over = np.array((q * z, r * x - p * z, -q * x))
    velocity = rates[:, :3].T + _to_world(psi, theta, phi, over)
    fall = GRAVITY * np.sin(n.slope)
    down = (fall * np.cos(n.slope_heading), fall * np.sin(n.slope_heading), -GRAVITY * np.cos(n.slope))
    felt = np.gradient(velocity, DT, axis=1) - np.array(down)[:, None]
    ahead, left, up = _to_body(psi, theta, phi, felt)
    cos, sin = np.cos(psi), np.sin(psi)
    return {
        **mounted(r, p, (ahead, left, up), i),
        "vy": velocity[1] * cos - velocity[0] * sin,
        "speed": rates[:, X] * cos + rates[:, Y] * sin,
        "phi": phi,
        "psi": psi,
    }


def _to_world(psi: Array, theta: Array, phi: Array, of: Array) -> Array:
    """Vectors (3, steps) in body axes to world axes: yaw, then pitch, then roll."""
    x, (y, z) = of[0], _turned(of[1], of[2], phi)
    z, x = _turned(z, x, theta)
    x, y = _turned(x, y, psi)
    return np.array((x, y, z))


def _to_body(psi: Array, theta: Array, phi: Array, of: Array) -> Array:
    (x, y), z = _turned(of[0], of[1], -psi), of[2]
    z, x = _turned(z, x, -theta)
    y, z = _turned(y, z, -phi)
    return np.array((x, y, z))


def _turned(one: Array, two: Array, angle: Array) -> tuple[Array, Array]:
    """A rotation from the first axis towards the second."""
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * one - sin * two, sin * one + cos * two


ENGINE = Engine("exudyn", SIZES, _signals, LISTED, OUTSIDE, PLACES)
