"""What a catalogue of concealed laws is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from numpy.random import Generator

from tests.foreign.rover import Rover

Extras = Mapping[str, float]  # numbers of a law that are drawn, not sized
Applied = Callable[[Rover, float, Extras], Rover]


def no_extras(_rng: Generator) -> dict[str, float]:
    """For a law whose size says all."""
    return {}


def a_sign(rng: Generator) -> dict[str, float]:
    """{"sign": -1 or 1}."""
    return {"sign": float(rng.choice([-1.0, 1.0]))}


def size_itself(_rover: Rover, size: float) -> float:
    """The value of a law whose size is its value."""
    return size


@dataclass(frozen=True)
class Law:
    """One law that may be concealed.

    effect: its id, "outside:..." where the list has none. form: which law. place: laws of one place are not
    concealed together. low, high: sizes, from more than a normal tolerance to the largest that a vehicle may
    have. apply(rover, size, extras) is monotonic in size. value: the size in the unit of
    `unit`. own: the form is that of the list's equation. absolute: judged by its size alone, since nominal
    parameters would take up all of it below a tolerance.
    """

    effect: str
    form: str
    place: str
    low: float
    high: float
    apply: Applied
    unit: str = "-"
    value: Callable[[Rover, float], float] = size_itself
    extras: Callable[[Generator], dict[str, float]] = field(default=no_extras)
    own: bool = False
    absolute: bool = False


def peak_ay(rover: Rover) -> float:
    """a_y [m/s^2] of a steady turn at the large amplitude, single track."""
    return rover.amplitude * rover.speed**2 / (rover.numbers.a + rover.numbers.b)


def turning_stiffness(rover: Rover) -> float:
    """a^2 Cf + b^2 Cr [N m/rad]; over the speed it is the yaw damping of the tyres [N m s/rad]."""
    n = rover.numbers
    return n.a**2 * n.Cf + n.b**2 * n.Cr


def share_of_base(rover: Rover, size: float) -> float:
    """A length [m] from its share of the wheelbase."""
    return size * (rover.numbers.a + rover.numbers.b)
