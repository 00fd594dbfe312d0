"""The movements of a bench: staircases for reading by hand, slow ramps, steps. Pure.

Offsets of the steering output from SERVOn_TRIM are in us. Every staircase and ramp begins at its lower end,
so that play in the linkage is taken up before the first angle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import Literal

from rover_sweep.errors import UsageError

Kind = Literal["staircase", "ramp", "steps"]

GENTLE, SLOW = 100.0, 40.0  # us/s: between two readings, of a ramp
SETTLE, HOLD = 1.0, 0.8  # s at a level before its angle is read, after a step
LOOPS = 2
LEAST_STEP, MOST_LEVELS = 5.0, 12  # us; levels of a side


@dataclass(frozen=True)
class Target:
    """Go to `offset` [us] at `rate` [us/s], inf for a jump; hold it for `hold` s; read: an angle there."""

    offset: float
    rate: float
    hold: float
    read: bool = False


@dataclass(frozen=True)
class Movement:
    """A movement that is allowed and carried out as a whole."""

    name: str
    kind: Kind
    targets: tuple[Target, ...]

    @property
    def largest(self) -> float:
        """Largest offset, us."""
        return max(abs(target.offset) for target in self.targets)

    @property
    def duration(self) -> float:
        """s, without the time that somebody takes to read angles."""
        at, total = 0.0, 0.0
        for target in self.targets:
            total += abs(target.offset - at) / target.rate + target.hold
            at = target.offset
        return total

    @property
    def words(self) -> str:
        """A sentence on what will move."""
        size = f"to {self.largest:g} us on either side"
        if self.kind == "steps":
            return f"the front wheels JUMP {size}, {len(self.targets)} times, {self.duration:.0f} s in all"
        if self.kind == "ramp":
            return f"the front wheels turn slowly {size}, to and fro, for {self.duration:.0f} s"
        reads = sum(target.read for target in self.targets)
        return f"the front wheels turn slowly {size} and stop {reads} times for an angle to be read"


def staircase(levels: tuple[float, ...], loops: int = LOOPS) -> Movement:
    """Up and down through -levels, 0 and levels, an angle at each; `loops` times."""
    up = sorted({0.0, *levels, *(-level for level in levels)})
    path = [up[0], *(offset for _ in range(loops) for offset in (*up[1:], *up[-2::-1]))]
    stops = tuple(Target(offset, GENTLE, SETTLE, True) for offset in path)
    return Movement("staircase", "staircase", (*stops, Target(0.0, GENTLE, 0.2)))


def ramp(largest: float, loops: int = LOOPS) -> Movement:
    """Slowly from -largest to largest and back, `loops` times."""
    ends = [-largest, *(end for _ in range(loops) for end in (largest, -largest)), 0.0]
    return Movement("ramp", "ramp", tuple(Target(end, SLOW, HOLD) for end in ends))


def steps(sizes: tuple[float, ...]) -> Movement:
    """Each size to one side, back, to the other, back; at last from side to side with the largest."""
    largest = max(sizes)
    path = [offset for size in sorted(sizes) for offset in (size, 0.0, -size, 0.0)]
    path += [largest, -largest, largest, -largest, 0.0]
    return Movement("steps", "steps", tuple(Target(offset, inf, HOLD) for offset in path))


def programme(levels: tuple[float, ...], by_hand: bool, with_ramp: bool) -> tuple[Movement, ...]:
    """The movements of a bench, the gentlest first. UsageError for levels that make none."""
    levels = tuple(sorted(set(levels)))
    if not levels or levels[0] < LEAST_STEP or len(levels) > MOST_LEVELS:
        raise UsageError(
            f"--steps {', '.join(f'{x:g}' for x in levels) or 'none'}: give 1 to {MOST_LEVELS} different "
            f"sizes of {LEAST_STEP:g} us or more, as in --steps 50,100,150"
        )
    if by_hand:
        slow = (ramp(levels[-1], 1),) if with_ramp else ()
        return (staircase(levels), *slow)
    return (ramp(levels[-1]), steps(levels))


def path(movement: Movement, start: float, interval: float) -> Iterator[tuple[float, float, Target | None]]:
    """(seconds from the start, offset [us], target just reached and held or None), every `interval` s."""
    at, t = start, 0.0
    for target in movement.targets:
        while at != target.offset:
            stride = target.rate * interval
            away = target.offset - at
            at = target.offset if abs(away) <= stride else at + (stride if away > 0 else -stride)
            t += interval
            yield t, at, None
        t += target.hold
        yield t, at, target
