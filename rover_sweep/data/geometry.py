"""Vehicle data for the models, in SI units and ISO axes."""

from __future__ import annotations

from dataclasses import dataclass

GRAVITY = 9.81  # m/s^2, as the paper
STANDARD_GRAVITY = 9.80665  # m/s^2: what "g" means in a log, a column and a parameter (GRAVITY_MSS)
MILLI_G = 1e-3 * STANDARD_GRAVITY
NEAR = 0.8  # of the critical speed or of the friction limit: runs above it get a warning
FRICTION = 0.5  # assumed without a value in the vehicle file: wet grass; tyres are nonlinear above .8 of it


@dataclass(frozen=True)
class Geometry:
    """Known quantities of the rover.

    mass, sprung_mass [kg]; a, b [m] from the CG to the front and rear axle; h [m] height of the
    sprung CG above the roll axis; roll_inertia Ixx [kg m^2] about the sprung mass' own CG.
    imu_x, imu_z [m]: the IMU ahead of the CG, and above the roll axis (an IMU at the sprung CG
    has imu_z = h). Quantities that only the roll-yaw model needs may be None.
    """

    mass: float
    a: float
    b: float
    sprung_mass: float | None = None
    h: float | None = None
    roll_inertia: float | None = None
    yaw_inertia: float | None = None
    imu_x: float = 0.0
    imu_z: float = 0.0
    free: tuple[str, ...] = ()
    """Names of model parameters to free in addition to the usual ones, such as "h" or "Ixx"."""
    roll_yaw_inertia: float = 0.0
    """Ixz [kg m^2], the product of inertia in the sign of equation (18)."""
    friction: float | None = None
    """Peak side force of the tyres over their load, None if not known."""

    @property
    def wheelbase(self) -> float:
        """a + b, m."""
        return self.a + self.b
