"""Other laws of the lateral tyre force, and forces that need a length of road to build up."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, tanh

from sitl.plant.effects_table import Effects, number
from sitl.plant.tyre import LOW_SPEED, lateral_force

IDS = frozenset({"tyre_saturation", "tyre_relaxation", "load_transfer", "surface_change"})

Law = Callable[[float, float, float, float], float]
"""Force [N] from slip angle [rad], stiffness [N/rad], peak force [N] and a shape [-]."""

_LEAST_SHARE = 0.05  # of the stiffness that load transfer leaves at least


def saturating(slip: float, stiffness: float, peak: float, shape: float) -> float:
    """-D tanh(C slip/D) with the peak D = mu Fz."""
    return -peak * tanh(stiffness * slip / peak)


def tyre_law(effects: Effects) -> Law:
    """The hyperbolic tangent where saturation is asked for, else the plant's own."""
    return saturating if "tyre_saturation" in effects else lateral_force


class Stiffness:
    """Present share of the cornering stiffness."""

    __slots__ = ("_at", "_by_distance", "_driven", "_ratio", "_transfer", "surface")

    def __init__(self, effects: Effects) -> None:
        self._transfer = number(effects, "load_transfer", "k")
        change = effects.get("surface_change", {})
        self._ratio = float(change.get("ratio", 1.0))
        self._by_distance = "distance" in change
        self._at = float(change.get("distance", change.get("t", 0.0)))
        self._driven = 0.0
        self.surface = 1.0

    def travel(self, distance: float, t: float) -> None:
        """Drive a distance [m] up to the time t [s]."""
        self._driven += distance
        self.surface = self._ratio if (self._driven if self._by_distance else t) >= self._at else 1.0

    def transferred(self, lateral_g: float) -> float:
        """1 - k (a_y/g)2 at a lateral acceleration in g."""
        share = 1.0 - self._transfer * lateral_g * lateral_g
        return share if share > _LEAST_SHARE else _LEAST_SHARE

    @property
    def transfers(self) -> bool:
        return self._transfer != 0.0


class Relaxation:
    """(sigma/V) F' + F = F0 of both axles, exact over a step with V and F0 held.

    Used by an explicit midpoint rule: `half` from the start of the step to its middle, then `end` over all
    of it with F0 of the middle. Below LOW_SPEED the time sigma/V grows no further.
    """

    __slots__ = ("_length", "_start", "forces")

    def __init__(self, effects: Effects) -> None:
        self._length = number(effects, "tyre_relaxation", "sigma")
        self._start = (0.0, 0.0)
        self.forces = (0.0, 0.0)

    def half(self, steady: tuple[float, float], speed: float, dt: float) -> None:
        """To the middle of a step that lasts 2 dt [s], towards the steady forces (front, rear) [N]."""
        self._start = self.forces
        self._approach(steady, speed, dt)

    def end(self, steady: tuple[float, float], speed: float, dt: float) -> None:
        """To the end of the step of dt [s]."""
        self._approach(steady, speed, dt)

    def rest(self) -> None:
        """The rover has come to a standstill."""
        self._start = self.forces = (0.0, 0.0)

    def _approach(self, steady: tuple[float, float], speed: float, dt: float) -> None:
        share = 1.0 - exp(-max(abs(speed), LOW_SPEED) * dt / self._length)
        (front, rear), (goal_front, goal_rear) = self._start, steady
        self.forces = (front + share * (goal_front - front), rear + share * (goal_rear - rear))
