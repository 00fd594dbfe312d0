"""A road that is not level."""

from __future__ import annotations

from math import cos, sin

from sitl.plant.effects_table import Effects, number
from sitl.plant.variant import GRAVITY


class Slope:
    """A plane inclined by b [rad], left being uphill at the heading psi0 [rad]; small angles.

    The rover moves in that plane. Its accelerometer shows what the plane holds against gravity, so more than
    the rover accelerates by: g b cos(psi - psi0) to the left, g b sin(psi - psi0) ahead.
    """

    __slots__ = ("_angle", "_heading")

    def __init__(self, effects: Effects) -> None:
        self._angle = number(effects, "cross_slope", "b")
        self._heading = number(effects, "cross_slope", "psi0")

    @property
    def steepest(self) -> float:
        """Largest hold [m/s2] over all headings."""
        return GRAVITY * self._angle

    def attitude(self, psi: float) -> tuple[float, float]:
        """(roll, nose up) [rad] of the plane under a rover with this heading; roll positive: left side up."""
        turned = psi - self._heading
        return self._angle * cos(turned), self._angle * sin(turned)

    def hold(self, psi: float) -> tuple[float, float]:
        """(ahead, left) [m/s2] that is felt and does not accelerate."""
        roll, nose_up = self.attitude(psi)
        return GRAVITY * nose_up, GRAVITY * roll
