"""Forces that are added to an engine without the part that makes them."""

from __future__ import annotations

from numba import njit

from tests.engines.engine import Array
from tests.engines.rover import EngineRover
from tests.foreign.chassis import GRAVITY, loose_pull
from tests.foreign.numbers import Numbers
from tests.foreign.tyres import load_factor


@njit
def load_step(load: Array, across: float, n: Numbers, dt: float) -> float:
    """Advances a loose load, place [m] and speed [m/s] to the left, and returns its force [N] to the left.

    across: acceleration to the left where it hangs or lies, m/s^2. The engine's mass has the load at rest.
    """
    rate = -loose_pull(load[0], load[1], n) - across
    load[1] += dt * rate
    load[0] += dt * load[1]
    return -n.loose * n.m * rate


@njit
def load_roll(load: Array, force: float, n: Numbers) -> float:
    """Roll moment [N m] of a loose load by its force and, on a bed, by its weight."""
    weight = n.loose * n.m * GRAVITY * load[0] if n.loose_form == 2.0 else 0.0
    return -force * n.h - weight


@njit
def lost_share(lean: float, n: Numbers) -> float:
    """Share of the side force that an axle loses as its inner wheel lifts. lean: N that leave both inner
    wheels."""
    other = n.b if n.lift_form == 0.0 else n.a
    static, moved = n.m * GRAVITY * other / (n.a + n.b) / 2, n.lift * lean / 2
    inner = load_factor(static - moved, static, 0.0, 4.0)
    outer = load_factor(static + moved, static, 0.0, 4.0)
    return 1.0 - (inner + outer) / 2


def at_speed(rover: EngineRover, speed: float) -> EngineRover:
    """The rover with the tyres that it has at a speed [m/s]."""
    n = rover.numbers
    if not n.slip_speed:
        return rover
    share = (speed / n.speed_ref) ** n.slip_speed
    return rover.of(Cf=share * n.Cf, Cr=share * n.Cr)  # type: ignore[return-value]
