"""Yaw and roll mode of a model: natural frequency, damping ratio and time constant, from its poles.

A mode with poles s1, s2 has the frequency sqrt(s1 s2) and the damping ratio -(s1 + s2)/(2 sqrt(s1 s2)),
above 1 without oscillation; neither exists with an unstable real pole. Its time constant -1/Re s is that of
the slower pole: after it, a disturbance has fallen to 37 %. Of the four poles of a model with roll, the pair
in which the roll states participate most is the roll mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.data.results import ByName, Quantity
from rover_sweep.identification.state_space import ModelStructure

MODE_UNITS = {
    f"{mode}_{quantity}": (unit, words.format(mode))
    for mode in ("yaw", "roll")
    for quantity, unit, words in (
        ("frequency", "rad/s", "natural frequency of the {} mode"),
        ("damping", "-", "damping ratio of the {} mode"),
        ("time_constant", "s", "time constant of the {} mode"),
    )
}
"""{quantity: (unit, meaning)}."""


def mode_poles(structure: ModelStructure, speed: float) -> dict[str, Array]:
    """{"yaw", "roll": two poles (2,) [rad/s]} at a speed [m/s]; {} for a model without such modes."""
    if "r" not in structure.states or len(structure.states) not in (2, 4):
        return {}
    mat = structure.matrices(speed)
    poles, right = np.linalg.eig(np.linalg.solve(mat.m, mat.f))
    if len(poles) == 2:
        return {"yaw": poles}
    roll = [k for k, s in enumerate(structure.states) if s in ("p", "phi")]
    if len(roll) != 2:
        return {}
    share = (right * np.linalg.inv(right).T)[roll].sum(axis=0).real  # participation of the roll states
    pairs = [pair for pair in combinations(range(4), 2) if _closed(poles[list(pair)])]
    rolling = max(pairs, key=lambda pair: share[list(pair)].sum())
    yawing = [k for k in range(4) if k not in rolling]
    return {"yaw": poles[yawing], "roll": poles[list(rolling)]}


def mode_values(structure: ModelStructure, speed: float) -> dict[str, float]:
    """{quantity in MODE_UNITS: value} at a speed [m/s], of those that exist."""
    found: dict[str, float] = {}
    for mode, pair in mode_poles(structure, speed).items():
        square, slowest = float(np.prod(pair).real), float(np.max(pair.real))
        if square > 0:
            found[f"{mode}_frequency"] = frequency = float(np.sqrt(square))
            found[f"{mode}_damping"] = float(-pair.sum().real / (2 * frequency))
        if slowest < 0:
            found[f"{mode}_time_constant"] = -1.0 / slowest
    return found


def mode_quantities(
    structure: ModelStructure, speed: float, intervals: Sequence[Quantity] = ()
) -> ByName[Quantity]:
    """The modes at a speed [m/s] with their bootstrap intervals, where available."""
    known = {q.name: q.interval_90 for q in intervals if q.interval_90 and np.isfinite(q.interval_90).all()}
    out = []
    for name, value in mode_values(structure, speed).items():
        (unit, meaning), (low, high) = MODE_UNITS[name], known.get(name, (None, None))
        out.append(Quantity(name, unit, value, low, high, meaning))
    return ByName(out)


def _closed(pair: Array) -> bool:
    """True for two real poles or a conjugate pair."""
    return bool(abs(pair.sum().imag) <= 1e-9 * np.abs(pair).max())
