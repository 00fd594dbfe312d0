"""Cornering stiffnesses from any driving, where mass, yaw inertia and centre of gravity are known."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Array
from rover_sweep.data.results import Quantity
from rover_sweep.driving.fit import DrivingFit, tyre_time

DECIDED = 0.2  # of a stiffness; a wider half interval does not decide
STEP = 1e-6  # of the differences, in the unit of the parameter


def tyre_stiffnesses(fit: DrivingFit, rover: Geometry, speed: float) -> tuple[Quantity, ...]:
    """Cf and Cr [N/rad], for both axles or none: if determined within `DECIDED`.

    The understeer and the lag of the yaw rate at this speed [m/s] are linear in 1/Cf and 1/Cr.
    """
    if rover.yaw_inertia is None or {"understeer", "tyre_lag"} & set(fit.held):
        return ()
    values = {name: fit[name] for name in ("understeer", "tyre_lag")}
    found = _stiffnesses(rover, speed, **values)
    if not np.all(found > 0):
        return ()
    moved = {
        name: (_stiffnesses(rover, speed, **{**values, name: value + STEP}) - found) / STEP
        for name, value in values.items()
    }
    out = []
    for k, axle in enumerate(("front", "rear")):
        value = float(found[k])
        low, high = fit.interval({n: float(slopes[k]) for n, slopes in moved.items()}, value)
        if high - low > 2 * DECIDED * value:
            return ()
        words = f"cornering stiffness of the {axle} axle, from understeer and lag at {speed:.1f} m/s"
        out.append(Quantity(f"{axle}_stiffness", "N/rad", value, low, high, words))
    return tuple(out)


def _stiffnesses(rover: Geometry, speed: float, understeer: float, tyre_lag: float) -> Array:
    """(Cf, Cr) of the bicycle model with this K_us/L [s^2/m^2] and this lag at the speed.

    r/delta = (z V s + 1) V/L/(n s^2 + d V s + 1 + k V^2) is late by V (d/(1 + k V^2) - z), with
    k = m (b/Cf - a/Cr)/L^2, d = (m (a^2/Cr + b^2/Cf) + Izz (1/Cf + 1/Cr))/L^2 and z = m a/(Cr L).
    """
    m, a, b, length, inertia = rover.mass, rover.a, rover.b, rover.wheelbase, rover.yaw_inertia or 0.0
    share = length**2 * (1 + understeer * speed**2)
    compliance = np.linalg.solve(
        [[b, -a], [(m * b**2 + inertia) / share, (m * a**2 + inertia) / share - m * a / length]],
        [understeer * length**2 / m, tyre_time(tyre_lag, understeer, np.array([speed]))[0] / speed],
    )
    return np.asarray(1 / compliance)
