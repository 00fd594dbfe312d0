"""MuJoCo as an engine: the loop of a run, compiled around the library's own mj_step.

The steering up to the wheels is `tests.foreign.steering`; all that follows are bodies, joints and contacts. A
tyre's side force goes with its slip angle, therefore the damping of its contact is divided by the speed.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numba import njit

from tests.engines.engine import Array, Engine, Signals
from tests.engines.mujoco_laws import LISTED, OUTSIDE, PLACES
from tests.engines.mujoco_model import IMPEDANCE, built
from tests.engines.rover import EngineRover
from tests.foreign.chassis import ROAD_ROLL, ROAD_Y, ROAD_YAW, SURFACE, WIND_X, WIND_Y
from tests.foreign.motion import DT
from tests.foreign.numbers import Numbers
from tests.foreign.rover import SIZES
from tests.foreign.steering import STATES as STEERING_STATES
from tests.foreign.steering import steering_step

SLOWEST = 0.5  # m/s: below it tyres resist in proportion to the sliding speed
CUT = 0.45  # share of the time in which a limping motor drags
COLUMNS = 13 + 3 + 3


def _step_of_the_library() -> Callable[[int, int], None]:
    library = next(Path(mujoco.__file__).parent.glob("libmujoco*"))
    step: Any = ctypes.CDLL(str(library)).mj_step
    step.argtypes, step.restype = [ctypes.c_void_p, ctypes.c_void_p], None
    return step  # type: ignore[no-any-return]


_STEP = _step_of_the_library()


@njit
def _run(
    addresses: tuple[int, int],
    command: Array,
    wanted: Array,
    around: Array,
    n: Numbers,
    special: Array,
    views: tuple[Array, ...],
) -> Array:
    """(steps, COLUMNS) of the sensors. special: radius [m], the four R [1/kg], share of the slip that goes
    with speed and its reference [m/s], drag of a limping motor [N m] and its period [s], height of the CG.
    views: ctrl, xfrc of the chassis (6,), solreffriction (4, 2), sensordata."""
    ctrl, push, friction, sensed = views
    radius, part, reference, drag, period, h = (
        special[0], special[5], special[6], special[7], special[8], special[9],
    )  # fmt: skip
    out = np.empty((command.size, COLUMNS))
    servo = np.zeros(STEERING_STATES)
    before = front = slip = 0.0
    base = n.a + n.b
    for k in range(command.size):
        w, x, y, z = sensed[9], sensed[10], sensed[11], sensed[12]
        psi = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        phi = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        u, r = sensed[13], sensed[2]
        delta = steering_step(servo, command[k], u, front, slip, n, DT)
        for j in range(2):
            left = n.track / 2 if j == 0 else -n.track / 2
            ctrl[j] = delta * (1.0 + n.ackermann * delta * left / base) + n.roll_steer_front * phi
        drive = max(-n.most_drive, min(n.most_drive, (wanted[k] - u) / n.tau_drive)) * n.m
        drive -= n.rolling * n.m * 9.81 * np.tanh(u / 0.05)
        ctrl[2] = ctrl[3] = drive * radius / 2
        if drag > 0.0 and (k * DT / period) % 1.0 < CUT:
            ctrl[2] -= drag * np.tanh(u)
        speed = max(SLOWEST, abs(u))
        if part > 0.0:
            speed = speed ** (1.0 - part) * reference**part
        for j in range(4):
            stiffness = (n.Cf if j < 2 else n.Cr) / 2 * around[k, SURFACE]
            friction[j, 1] = -IMPEDANCE * stiffness * special[1 + j] / speed
        cos, sin = np.cos(psi), np.sin(psi)
        wind = around[k, WIND_Y] * cos - around[k, WIND_X] * sin
        side = around[k, ROAD_Y] + wind  # acts at the ground, the wind above it
        push[0] = around[k, WIND_X] * cos * cos + around[k, WIND_Y] * sin * cos - side * sin
        push[1] = around[k, WIND_X] * cos * sin + around[k, WIND_Y] * sin * sin + side * cos
        roll = around[k, ROAD_ROLL] + side * h - wind * n.wind_z
        push[3], push[4] = roll * cos, roll * sin
        push[5] = around[k, ROAD_YAW] + wind * n.wind_x - n.yaw_c * r - n.yaw_c2 * r * abs(r)
        _STEP(addresses[0], addresses[1])
        for j in range(COLUMNS):
            out[k, j] = sensed[j]
        front = (n.b * n.m * sensed[17] + n.Izz * (sensed[2] - before) / DT) / base
        slip = -front / n.Cf
        before = sensed[2]
    return out


def _signals(rover: EngineRover, command: Array, wanted: Array, around: Array, heading: float) -> Signals:
    build = built(rover, heading)
    model, data, own, n = build.model, build.data, rover.own, rover.numbers
    special = np.array(
        [
            rover.instruments.wheel_radius,
            *build.resistance,
            own.get("slip_speed", 0.0),
            rover.speed,
            own.get("drag", 0.0),
            own.get("drag_period", 1.0),
            n.h,
        ]
    )
    chassis = model.body("chassis").id
    views = (data.ctrl, data.xfrc_applied[chassis], model.pair_solreffriction, data.sensordata)
    found = _run((model._address, data._address), command, wanted, around, n, special, views)
    w, x, y, z = found[:, 9:13].T
    psi = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    psi += 2 * np.pi * round((heading - psi[0]) / (2 * np.pi))
    cos, sin = np.cos(psi), np.sin(psi)
    return {
        "r": found[:, 2],
        "p": found[:, 0],
        "ay": found[:, 4],
        "vy": found[:, 7] * cos - found[:, 6] * sin,
        "speed": found[:, 13],
        "phi": np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        "psi": psi,
    }


ENGINE = Engine("mujoco", SIZES, _signals, LISTED, OUTSIDE, PLACES)
