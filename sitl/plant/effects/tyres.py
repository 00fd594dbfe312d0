"""Other laws of the lateral tyre force, and forces that need a length of road to build up."""

from __future__ import annotations

from collections.abc import Callable
from math import copysign, exp, tanh

from sitl.plant.effects_table import ALL_ALONG, Effects, form, number
from sitl.plant.tyre import LOW_SPEED, lateral_force

IDS = frozenset({"tyre_saturation", "tyre_relaxation", "load_transfer", "surface_change", "tyre_speed"})

Law = Callable[[float, float, float, float], float]
"""Force [N] from slip angle [rad], stiffness [N/rad], peak force [N] and a shape [-]."""

_PEAKED = 1.6  # shape factor of the magic formula whose force falls beyond the peak
_KNEE = 6.0
_RAMP, _DRIFT = 10.0, 300.0  # s
_YIELDS = 40  # steps of `yielding`, of which linear tyres need one
_LEAST_SHARE = 0.05  # of the stiffness that load transfer leaves at least


def saturating(slip: float, stiffness: float, peak: float, shape: float) -> float:
    """-D tanh(C slip/D) with the peak D = mu Fz."""
    return -peak * tanh(stiffness * slip / peak)


def brush(slip: float, stiffness: float, peak: float, shape: float) -> float:
    """The brush model with parabolic pressure: adhesion over the share 1 - C slip/(3 D) of the patch.

    Pacejka 2012, section 3.2: F = D (1 - share^3), all of it sliding beyond C slip = 3 D.
    """
    adhering = max(1.0 - stiffness * abs(slip) / (3.0 * peak), 0.0)
    return copysign(peak * (1.0 - adhering**3), -slip)


def peaked(slip: float, stiffness: float, peak: float, shape: float) -> float:
    """The magic formula with a force that falls beyond its peak."""
    return lateral_force(slip, stiffness, peak, _PEAKED)


def knee(slip: float, stiffness: float, peak: float, shape: float) -> float:
    """A linear tyre that slides at its peak: the smooth minimum of C slip and D, of the sixth order."""
    wanted = stiffness * slip
    return -wanted * peak / (peak**_KNEE + abs(wanted) ** _KNEE) ** (1.0 / _KNEE)


_LAWS: dict[str, Law] = {"tanh": saturating, "brush": brush, "falling peak": peaked, "knee": knee}


def tyre_law(effects: Effects) -> Law:
    """The law that saturation asks for, else the plant's own."""
    return _LAWS[form(effects, "tyre_saturation")] if "tyre_saturation" in effects else lateral_force


def yielding(law: Law, slip: float, stiffness: float, peak: float, shape: float, give: float) -> float:
    """Force [N] of an axle that turns by -give [rad/N] times its own force: F = law(slip + give F).

    Chord iteration with the slope at zero slip, which is the steepest.
    """
    force, slope = 0.0, 1.0 + give * stiffness
    for _ in range(_YIELDS):
        change = (law(slip + give * force, stiffness, peak, shape) - force) / slope
        force += change
        if abs(change) < 1e-9 * peak:
            break
    return force


class Stiffness:
    """Present share of the cornering stiffness."""

    __slots__ = ("_at", "_by_distance", "_driven", "_exponent", "_form", "_ratio", "_transfer", "surface")

    def __init__(self, effects: Effects) -> None:
        self._transfer = number(effects, "load_transfer", "k")
        self._exponent = number(effects, "tyre_speed", "k")
        change = effects.get("surface_change", {})
        self._ratio = float(change.get("ratio", 1.0))
        self._by_distance = "distance" in change
        self._at = float(change.get("distance", change.get("t", 0.0)))
        self._form = form(effects, "surface_change")
        self._driven = 0.0
        self.surface = 1.0

    def travel(self, distance: float, t: float) -> None:
        """Drive a distance [m] up to the time t [s]."""
        self._driven += distance
        since = (self._driven if self._by_distance else t) - self._at
        if self._form == ALL_ALONG:
            self.surface = self._ratio ** (t / _DRIFT)
        elif self._form == "over ten seconds":
            self.surface = self._ratio ** min(max(since / _RAMP, 0.0), 1.0)
        else:
            self.surface = self._ratio if since >= 0.0 else 1.0

    def at_speed(self, speed: float) -> float:
        """The share of the stiffness at a rolling speed [m/s], over that at 1 m/s."""
        if self._exponent == 0.0:
            return self.surface
        return self.surface * float(max(abs(speed), LOW_SPEED) ** -self._exponent)

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
