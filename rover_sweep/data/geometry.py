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


# Normal tolerances of a rover about its vehicle file: smaller deviations are never a finding.


@dataclass(frozen=True)
class Tolerances:
    """Normal deviations of a rover from its vehicle file, as standard deviations or bounds.

    `vehicle_geometry.tolerances_of` makes them from a vehicle file.

    lag, delay [s], ratio (ln Cf/Cr), bias_ay [m/s^2], trim [rad], steering scale, speed scale (relative),
    cg, imu_x, imu_z (over the wheelbase; imu_z over the roll axis, so with that of h), h, roll_inertia
    (relative), sensor_lag [s], velocity_gain (relative), velocity_lag [s].
    heading [rad]: error of the estimator by compass or mounting, which adds a part of V to V_y.
    together [s]: sum of lag and delay, above which they are a finding. bend: curvature of the tyre force,
    about 0.7 friction^-2 (0.67 of a tanh, 0.73 of a magic formula of shape 1.3), in
    F = C alpha (1 - bend (C alpha/Fz)^2/2). early [s]: by which a log may date the motion before its
    steering. [material] of the vehicle file changes them.
    """

    lag: float = 0.040
    delay: float = 0.040
    ratio: float = 0.15
    bias_ay: float = 0.3
    trim: float = 0.010
    scale: float = 0.03
    speed: float = 0.010
    cg: float = 0.02
    h: float = 0.30
    roll_inertia: float = 0.15
    imu_x: float = 0.02
    imu_z: float = 0.05
    sensor_lag: float = 0.003
    velocity_gain: float = 0.10
    velocity_lag: float = 0.010
    heading: float = 0.015
    together: float = 0.072
    bend: float = 0.8
    early: float = 0.0
