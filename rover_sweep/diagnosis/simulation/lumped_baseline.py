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
from rover_sweep.diagnosis.simulation.kernel import PHI, P, R, V
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.identification.models.lumped import lumped as identified
from rover_sweep.identification.models.roll_yaw import roll_yaw

ROWS = ("Y", "L", "N")
COLUMNS = ("v", "p", "r", "phi", "delta")
Y, L, N = range(3)
BY_V, BY_P, BY_R, BY_PHI, BY_DELTA = range(5)
PER_SPEED = ("v", "r")
REACH = 10.0  # bound over the first value, or over a tenth of the median of the row if that is larger
STARTED_AT = 1.0  # m/s; any value, since the derivatives times the speed do not depend on it


def derivatives(rover: Geometry, roll: bool) -> tuple[Coordinate, ...]:
    """The coordinates "Y_v" to "N_delta", those by v and r times the speed; without roll none by p or phi."""
    first = _first(rover, roll)
    rows = {row: {c: first[f"{row}_{c}"] for c in COLUMNS if f"{row}_{c}" in first} for row in ROWS}
    out = []
    for row, values in rows.items():
        middle = float(np.median(np.abs(list(values.values())))) if values else 0.0
        for column, value in values.items():
            size = max(abs(value), 0.1 * middle)
            reach = REACH * size
            out.append(Coordinate(f"{row}_{column}", value, -reach, reach, 0.3 * size, 0.5 * reach))
    return tuple(out)


def _first(rover: Geometry, roll: bool) -> dict[str, float]:
    """First values from the rover's numbers by the roll-yaw model, or without roll by the bicycle model."""
    if roll:
        values = identified(rover, roll_yaw(rover), STARTED_AT).values
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
    return {f"{row}_{c}": parameters[f"{row}_{c}"] * (speed if c in PER_SPEED else 1.0) for row, c in names}


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
    v, r, phi, p = x[V], x[R], x[PHI], x[P]
    vs, rs = v / speed, r / speed
    across = (
        q[Y, BY_V] * vs + q[Y, BY_P] * p + q[Y, BY_R] * rs + q[Y, BY_PHI] * phi + q[Y, BY_DELTA] * d + push
    )
    out[V] = across - speed * r
    out[R] = q[N, BY_V] * vs + q[N, BY_P] * p + q[N, BY_R] * rs + q[N, BY_PHI] * phi + q[N, BY_DELTA] * d
    out[PHI] = p
    out[P] = q[L, BY_V] * vs + q[L, BY_P] * p + q[L, BY_R] * rs + q[L, BY_PHI] * phi + q[L, BY_DELTA] * d
    return across


@njit(cache=True, nogil=True, fastmath=True)
def _states(steer, speed, push, q, dt):  # type: ignore[no-untyped-def]
    """Motion (n, 7) in the columns v, r, phi, p, v' + V r, r', p'; RK4 of step dt. q (3, 5): derivatives."""
    n = steer.size
    y = np.zeros((n, 7))
    x, xs = np.zeros(4), np.zeros(4)
    k1, k2, k3, k4 = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(n):
        across = _rates(x, k1, steer[k], speed[k], push[k], q)
        y[k, 0], y[k, 1], y[k, 2], y[k, 3] = x[V], x[R], x[PHI], x[P]
        y[k, 4], y[k, 5], y[k, 6] = across, k1[R], k1[P]
        if k + 1 == n:
            break
        d, v = 0.5 * (steer[k] + steer[k + 1]), 0.5 * (speed[k] + speed[k + 1])
        f = 0.5 * (push[k] + push[k + 1])
        for i in range(4):
            xs[i] = x[i] + 0.5 * dt * k1[i]
        _rates(xs, k2, d, v, f, q)
        for i in range(4):
            xs[i] = x[i] + 0.5 * dt * k2[i]
        _rates(xs, k3, d, v, f, q)
        for i in range(4):
            xs[i] = x[i] + dt * k3[i]
        _rates(xs, k4, steer[k + 1], speed[k + 1], push[k + 1], q)
        for i in range(4):
            x[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
            if not abs(x[i]) < 1e3:  # an unstable trial of the fit
                x[i] = 0.0
    return y
