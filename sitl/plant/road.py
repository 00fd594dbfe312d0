"""The road under the plant, and the random numbers of the whole simulation."""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, sqrt

from sitl.plant.variant import PlantParameters


class Road:
    """Light unevenness: side force [N], yaw and roll moment [N m] that change over a length of road.

    First-order Gauss-Markov in the distance driven, rms proportional to speed, so nothing at standstill.
    """

    __slots__ = ("_colour", "_length", "_noise", "_rms", "force", "roll_moment", "yaw_moment")

    def __init__(self, parameters: PlantParameters, seed: int) -> None:
        self._length = parameters.road_length
        self._rms = (parameters.road_force, parameters.road_yaw_moment, parameters.road_roll_moment)
        self._noise = normals(seed, stream=1)
        self._colour = [0.0, 0.0, 0.0]
        self.force = self.yaw_moment = self.roll_moment = 0.0

    def advance(self, distance: float, speed: float) -> None:
        """Drive a distance [m] >= 0 at a speed [m/s] >= 0."""
        if not any(self._rms):
            return
        keep = exp(-distance / self._length)
        fresh = sqrt(1.0 - keep * keep)
        noise, colour = self._noise, self._colour
        colour[0] = first = keep * colour[0] + fresh * next(noise)
        colour[1] = second = keep * colour[1] + fresh * next(noise)
        colour[2] = third = keep * colour[2] + fresh * next(noise)
        force, yaw, roll = self._rms
        self.force, self.yaw_moment, self.roll_moment = (
            speed * force * first,
            speed * yaw * second,
            speed * roll * third,
        )


def normals(seed: int, stream: int) -> Iterator[float]:
    """Endless standard normal numbers; the same for the same seed and stream."""
    from numpy.random import default_rng  # here, so that an exported rover on an even road needs no numpy

    generator = default_rng((seed, stream))
    while True:
        yield from generator.standard_normal(4096).tolist()
