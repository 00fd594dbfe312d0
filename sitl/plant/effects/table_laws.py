"""The forces and steering angles that the tables of a variant add, see `PlantLaw`."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import pi

from sitl.plant.axles import Axles, Forces
from sitl.plant.plant_law import PlantLaw

_ROUNDS = 3  # of the loop from a force over the lateral acceleration back to the force

Point = Mapping[str, float]


class TableForces:
    """The forces of axles with tables added; `forces` as that of `Axles`."""

    def __init__(
        self, axles: Axles, laws: Sequence[PlantLaw], mass: float, front: float, rear: float
    ) -> None:
        self._axles, self._mass, self._front, self._rear = axles, mass, front, rear
        self._steering = [_Table(law) for law in laws if law.place == "steering"]
        self._pushing = [_Table(law) for law in laws if law.place != "steering"]
        self._rounds = _ROUNDS if any("a_y" in (law.over, law.times) for law in laws) else 1

    def forces(self, vx: float, vy: float, r: float, phi: float, p: float, delta: float) -> Forces:
        """As `Axles.forces`."""
        point = {"delta": delta, "a_y": 0.0, "r": r, "p": p, "phi": phi, "beta": vy / max(vx, 0.4), "v": vx}
        delta += sum(table.at(point) for table in self._steering)
        ahead, left, yaw, roll = self._axles.forces(vx, vy, r, phi, p, delta)
        point["delta"] = delta
        side = turn = tilt = 0.0
        for _ in range(self._rounds):
            point["a_y"] = (left + side) / self._mass
            side = turn = tilt = 0.0
            for table in self._pushing:
                force = table.at(point)
                if table.place == "yaw moment":
                    turn += force
                elif table.place == "roll moment":
                    tilt += force
                else:
                    side += force
                    turn += force * self._arm(table.place)
        return ahead, left + side, yaw + turn, roll + tilt

    def advance(self, dt: float) -> None:
        """Move what swings by dt [s]."""
        for table in (*self._steering, *self._pushing):
            table.advance(dt)

    def _arm(self, place: str) -> float:
        return {"side force front": self._front, "side force rear": -self._rear}.get(place, 0.0)


class _Table:
    """A table with the state of its play, or a resonator with its displacement and rate over w."""

    def __init__(self, law: PlantLaw) -> None:
        self.place = law.place
        self._law, self._behind = law, 0.0
        self._driven = self._u = self._rate = 0.0

    def advance(self, dt: float) -> None:
        w, damping = 2.0 * pi * self._law.frequency, self._law.damping
        self._rate += dt * w * (self._driven - self._u - 2.0 * damping * self._rate)
        self._u += dt * w * self._rate

    def at(self, point: Point) -> float:
        law = self._law
        x = point[law.over]
        if law.frequency > 0.0:
            self._driven = x
            return law.y[0] * self._u + law.y[1] * self._rate
        if law.play > 0.0:
            self._behind = x = min(max(self._behind, x - law.play), x + law.play)
        y = _interpolated(law.x, law.y, x)
        if law.times == "v^2":
            return y * point["v"] ** 2
        return y * point[law.times] if law.times else y


def _interpolated(xs: Sequence[float], ys: Sequence[float], x: float) -> float:
    if x <= xs[0]:
        return ys[0]
    if x >= xs[-1]:
        return ys[-1]
    k = bisect_right(xs, x)
    share = (x - xs[k - 1]) / (xs[k] - xs[k - 1])
    return ys[k - 1] + share * (ys[k] - ys[k - 1])
