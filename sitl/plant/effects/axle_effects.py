"""The axles of a rover with effects in its tyres, its suspension or its resistance."""

from __future__ import annotations

from math import cos, sin, sqrt

from sitl.plant.axles import Axles, Forces, direction
from sitl.plant.effects.tyres import IDS as TYRE_IDS
from sitl.plant.effects.tyres import Relaxation, Stiffness, tyre_law, yielding
from sitl.plant.effects_table import Effects, form, number
from sitl.plant.road import Road
from sitl.plant.tyre import LOW_SPEED, slip_angle
from sitl.plant.variant import GRAVITY, PlantParameters

IDS = TYRE_IDS | {
    "roll_steer",
    "steering_compliance",
    "suspension_friction",
    "speed_variation",
    "yaw_damping",
    "side_wind",
}
FRICTION_ROUNDING = 0.005  # rad/s of roll within which the friction's sign is smooth
_ROUNDS = 2  # of the loop from stiffness over lateral acceleration back to stiffness; k (a_y/g)2 is small


class EffectAxles(Axles):
    """As `Axles`, with effects; equal to it without any."""

    def __init__(self, parameters: PlantParameters, road: Road) -> None:
        super().__init__(parameters, road)
        effects = parameters.effects
        self._law = tyre_law(effects)
        self._stiffness = Stiffness(effects)
        self.relaxation = Relaxation(effects) if number(effects, "tyre_relaxation", "sigma") > 0 else None
        self._mass = parameters.mass
        e, rear = number(effects, "roll_steer", "e"), form(effects, "roll_steer") == "rear axle"
        self._roll_steer, self._rear_steer = (0.0, e) if rear else (e, 0.0)
        self._give = number(effects, "steering_compliance", "k")
        self._against = number(effects, "yaw_damping", "c")
        self._by_speed = form(effects, "yaw_damping") == "over r/V"
        self._wind = number(effects, "side_wind", "w") * parameters.mass
        self._windward = number(effects, "side_wind", "psi0")
        self._ahead = number(effects, "side_wind", "x")
        # of the sprung mass, about the roll axis
        self._above = parameters.cg_height_above_roll_centre * parameters.sprung_mass / parameters.mass
        self._pushed = 0.0
        self._friction = number(effects, "suspension_friction", "T")
        self._drag = number(effects, "speed_variation", "D") * parameters.mass

    def travel(self, distance: float, t: float, psi: float) -> None:
        """The road that is under the rover after a distance [m], at the time t [s], with a heading [rad]."""
        self._stiffness.travel(distance, t)
        self._pushed = self._wind * cos(psi - self._windward)

    def forces(self, vx: float, vy: float, r: float, phi: float, p: float, delta: float) -> Forces:
        a, b, _, _, df, dr, _, gain, top, rf, rr = self._constants
        road = self._road
        delta += self._roll_steer * phi
        ss, cs = sin(delta), cos(delta)
        vyf, vyr = vy + a * r, vy - b * r
        forward = vx * cs + vyf * ss
        drag_f = -rf * direction(forward)
        drive = min(max(gain * (self.wanted_speed - vx), -top), top)
        along_r = min(max(drive - rr * direction(vx), -0.99 * dr), 0.99 * dr)
        sr, cr = sin(self._rear_steer * phi), cos(self._rear_steer * phi)
        slips = slip_angle(forward, vyf * cs - vx * ss), slip_angle(vx * cr + vyr * sr, vyr * cr - vx * sr)
        share = self._stiffness.at_speed(vx)
        self.steady = self._sides(slips, (df, sqrt(dr * dr - along_r * along_r)), cs, share)
        side_f, side_r = self.steady if self.relaxation is None else self.relaxation.forces
        front = side_f * cs + drag_f * ss
        lateral = (front + side_r) / self._mass
        fx = along_r + drag_f * cs - side_f * ss - self._drag * lateral * lateral * direction(vx)
        roll = road.roll_moment - self._friction * p / sqrt(p * p + FRICTION_ROUNDING**2)
        resisting = self._against * r / (max(abs(vx), LOW_SPEED) if self._by_speed else 1.0)
        roll -= self._pushed * self._above
        yaw = a * front - b * side_r + road.yaw_moment - resisting + self._pushed * self._ahead
        return fx, front + side_r + road.force + self._pushed, yaw, roll

    def _sides(
        self, slips: tuple[float, float], peaks: tuple[float, float], cosine: float, share: float
    ) -> tuple[float, float]:
        """Steady side forces [N], front and rear, in the wheels' planes. share: of the stiffness."""
        _, _, cf, cr, _, _, shape, _, _, _, _ = self._constants
        front = self._front(slips[0], share * cf, peaks[0], shape)
        rear = self._law(slips[1], share * cr, peaks[1], shape)
        for _ in range(_ROUNDS if self._stiffness.transfers else 0):
            lateral_g = (front * cosine + rear) / (self._mass * GRAVITY)
            left = share * self._stiffness.transferred(lateral_g)
            front = self._front(slips[0], left * cf, peaks[0], shape)
            rear = self._law(slips[1], left * cr, peaks[1], shape)
        return front, rear

    def _front(self, slip: float, stiffness: float, peak: float, shape: float) -> float:
        if self._give > 0.0:
            return yielding(self._law, slip, stiffness, peak, shape, self._give)
        return self._law(slip, stiffness, peak, shape)


def friction_pole(effects: Effects, roll_inertia: float) -> float:
    """Pole [1/s] that rounded friction adds about rest, for the choice of the step."""
    return number(effects, "suspension_friction", "T") / (FRICTION_ROUNDING * roll_inertia)


def yaw_poles(effects: Effects, inertia: float) -> tuple[float, float]:
    """Poles that a yaw damping adds: (at any speed [1/s], times the rolling speed [m/s2])."""
    pole = number(effects, "yaw_damping", "c") / inertia
    return (0.0, pole) if form(effects, "yaw_damping") == "over r/V" else (pole, 0.0)
