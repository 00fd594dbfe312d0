"""The lumped (Taylor series) model as a baseline, equation (19) of the paper, driven at the measured speed.

    v' + V r = (Y_v v + Y_r r)/V + Y_p p + Y_phi phi + Y_delta d,   and the same for p' with L, r' with N

Tyre forces are proportional to v/V and r/V. The derivatives by v and r are therefore multiplied by the speed
here, which makes them valid at every speed; divided by it they are those of `identification.models.lumped`.
v is V_y at the place of its measurement, and the position of the IMU is relative to that place. Without V_y
the derivatives absorb the position. ISO axes, SI units.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numba import njit

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.identification.models.lumped import lumped as identified
from rover_sweep.identification.models.roll_yaw import roll_yaw

ROWS, COLUMNS = ("Y", "L", "N"), ("v", "p", "r", "phi", "delta")


def derivatives(rover: Geometry, roll: bool) -> tuple[Coordinate, ...]:
    """The coordinates "Y_v" to "N_delta", those by v and r times the speed; without roll none by p or phi.

    Each is bounded by ten times its first value, or the median of its row where that is larger.
    """
    first = _first(rover, roll)
    rows = {row: {c: first[f"{row}_{c}"] for c in COLUMNS if f"{row}_{c}" in first} for row in ROWS}
    out = []
    for row, values in rows.items():
        middle = float(np.median(np.abs(list(values.values())))) if values else 0.0
        for column, value in values.items():
            reach = max(10.0 * abs(value), middle)
            out.append(Coordinate(f"{row}_{column}", value, -reach, reach, 0.03 * reach, 0.5 * reach))
    return tuple(out)


def _first(rover: Geometry, roll: bool) -> dict[str, float]:
    """First values from the rover's numbers by the roll-yaw model, or without roll by the bicycle model."""
    if roll:
        values = identified(rover, roll_yaw(rover), 1.0).values  # at 1 m/s they are those times the speed
        return {f"{row}_{c}": values[f"{row}_{c}"] for row in ROWS for c in COLUMNS}
    stiffness = 3.0 * rover.mass * GRAVITY / 2
    inertia = rover.yaw_inertia or rover.mass * rover.a * rover.b
    apart, about = rover.a - rover.b, rover.a**2 + rover.b**2
    side = {"v": -2.0, "r": -apart, "delta": 1.0}
    yaw = {"v": -apart, "r": -about, "delta": rover.a}
    return {f"Y_{c}": k * stiffness / rover.mass for c, k in side.items()} | {
        f"N_{c}": k * stiffness / inertia for c, k in yaw.items()
    }


def start_coordinates(parameters: Mapping[str, float], speed: float) -> dict[str, float]:
    """Coordinates from the derivatives of a lumped model that was identified at a speed [m/s]."""
    names = [(row, c) for row in ROWS for c in COLUMNS if f"{row}_{c}" in parameters]
    return {f"{row}_{c}": parameters[f"{row}_{c}"] * (speed if c in "vr" else 1.0) for row, c in names}


def motion(delta: Array, speed: Array, pushed: Array, x: Mapping[str, float], dt: float) -> dict[str, Array]:
    """Motion {name: (n,)} as `simulator.motion` gives it, ISO axes, SI units.

    delta (n,): road-wheel angle [rad]. speed (n,): V [m/s]. pushed (n,): added side force per mass [m/s^2].
    x: coordinates. dt: step [s].
    """
    table = np.array([[x.get(f"{row}_{c}", 0.0) for c in COLUMNS] for row in ROWS])
    y = _states(delta, speed, pushed, table, dt)
    names = ("v", "r", "phi", "p", "across", "r_dot", "p_dot")
    found = {name: y[:, k] for k, name in enumerate(names)}
    # v is V_y at the sensor already, while `simulator.sensed` moves "v" to the IMU
    found["v"] = found["v"] - x.get("imu_x", 0.0) * found["r"] + x.get("imu_z", 0.0) * found["p"]
    return found


@njit(cache=True, nogil=True, fastmath=True)
def _rates(x, out, d, speed, push, q):  # type: ignore[no-untyped-def]
    """Fill out (4,) with the slope of the state x (4,), v, r, phi, p; gives v' + V r."""
    u = (x[0] / speed, x[3], x[1] / speed, x[2], d)
    side, rolled, turned = push, 0.0, 0.0
    for k in range(5):
        side, rolled, turned = side + q[0, k] * u[k], rolled + q[1, k] * u[k], turned + q[2, k] * u[k]
    out[0], out[1], out[2], out[3] = side - speed * x[1], turned, x[3], rolled
    return side


@njit(cache=True, nogil=True, fastmath=True)
def _states(steer, speed, push, q, dt):  # type: ignore[no-untyped-def]
    """Motion (n, 7) in the columns v, r, phi, p, v' + V r, r', p'; RK4 of step dt. q (3, 5): derivatives."""
    n = steer.size
    y = np.zeros((n, 7))
    x, trial, slope, total = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(n):
        end = min(k + 1, n - 1)
        total[:] = x
        for stage in range(4):
            later = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # share of the step
            kept, weight = 1.0 - later, dt / 6.0 if stage in (0, 3) else dt / 3.0
            for i in range(4):
                trial[i] = x[i] + later * dt * slope[i]
            d, v = kept * steer[k] + later * steer[end], kept * speed[k] + later * speed[end]
            across = _rates(trial, slope, d, v, kept * push[k] + later * push[end], q)
            if stage == 0:
                y[k, :4], y[k, 4], y[k, 5], y[k, 6] = x, across, slope[1], slope[3]
            for i in range(4):
                total[i] += weight * slope[i]
        for i in range(4):
            x[i] = total[i] if abs(total[i]) < 1e3 else 0.0  # an unstable trial of the fit
    return y
