"""Forces of the road on the body: both axles, drive, rolling resistance."""

from __future__ import annotations

from math import cos, sin, sqrt

from sitl.plant.road import Road
from sitl.plant.tyre import lateral_force, slip_angle
from sitl.plant.variant import GRAVITY, PlantParameters

STICTION_SPEED = 0.02  # m/s, below which resistance that exceeds the drive stops the rover

Forces = tuple[float, float, float, float]


class Axles:
    """Nominal: side force from slip angle at once, drive at the rear with its share of the grip.

    wanted_speed [m/s] is set by the throttle; steady: the side forces [N] that relaxing tyres tend to, where
    they relax. `forces` gives (ahead [N], left [N], yaw moment [N m] to the
    left, roll moment [N m] of the road and the suspension without its spring and damper).
    """

    wanted_speed = 0.0
    steady = (0.0, 0.0)

    def __init__(self, parameters: PlantParameters, road: Road) -> None:
        self._road = road
        self._constants = _constants(parameters)

    def forces(self, vx: float, vy: float, r: float, phi: float, p: float, delta: float) -> Forces:
        """Of a motion with the road-wheel angle delta [rad], ISO axes, SI units."""
        a, b, cf, cr, df, dr, shape, gain, top, rf, rr = self._constants
        road = self._road
        ss, cs = sin(delta), cos(delta)

        # front in the wheel's plane and turned into the body's
        vyf, vyr = vy + a * r, vy - b * r
        forward = vx * cs + vyf * ss
        side_f = lateral_force(slip_angle(forward, vyf * cs - vx * ss), cf, df, shape)
        drag_f = -rf * direction(forward)
        drive = gain * (self.wanted_speed - vx)
        along_r = (top if drive > top else -top if drive < -top else drive) - rr * direction(vx)
        if along_r > 0.99 * dr or along_r < -0.99 * dr:
            along_r = 0.99 * dr if along_r > 0 else -0.99 * dr
        side_r = lateral_force(slip_angle(vx, vyr), cr, sqrt(dr * dr - along_r * along_r), shape)
        front = side_f * cs + drag_f * ss
        fx = along_r + drag_f * cs - side_f * ss
        fy = front + side_r + road.force
        return fx, fy, a * front - b * side_r + road.yaw_moment, road.roll_moment


def direction(speed: float) -> float:
    """Sign of a rolling speed [m/s], smooth within STICTION_SPEED."""
    return speed / sqrt(speed * speed + STICTION_SPEED * STICTION_SPEED)


def _constants(q: PlantParameters) -> tuple[float, ...]:
    """Arguments of `forces` in its order, computed once."""
    wheelbase = q.cg_to_front_axle + q.cg_to_rear_axle
    front_load = q.mass * GRAVITY * q.cg_to_rear_axle / wheelbase
    rear_load = q.mass * GRAVITY * q.cg_to_front_axle / wheelbase
    return (
        q.cg_to_front_axle,
        q.cg_to_rear_axle,
        q.front_cornering_stiffness,
        q.rear_cornering_stiffness,
        q.friction * front_load,
        q.friction * rear_load,
        q.tyre_shape,
        q.mass / q.speed_lag,
        q.drive_force_limit,
        q.rolling_resistance * front_load,
        q.rolling_resistance * rear_load,
    )
