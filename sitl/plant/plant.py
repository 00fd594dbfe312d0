"""A small rover in motion: nonlinear single track with roll, driven by two PWM signals.

Axes are ISO: x forward, y left, z up; the earth frame is x north, y west, so psi and everything
that turns or points left is positive. The reference point lies on the roll axis below the CG.

Equations of motion (Lagrange; phi the roll of the sprung mass, p = phi', s, c = sin, cos phi,
M = m, S = m_s; the sprung CG is at (0, -h s, h c) from the reference point):

    M (vx' - r vy) + S h (r' s + 2 r p c)                 = Fx
    M (vy' + r vx) + S h (-p' c + p^2 s + r^2 s)          = Fy
    Izz r' + Ixz p' + S h s [vx' - r vy + h (r' s + 2 r p c)] = Mz
    (Ixx + S h^2) p' + Ixz r' - S h c (vy' + r vx) - S h^2 r^2 s c
                                         = -k phi - b p + S g h s + L

Linearised about straight driving this is equation (18) of Ivler, Gowans and Marfise 2022 as corrected:
V_y at the height of the roll axis, Ixx about the sprung CG, and at zero slip the force -C alpha per axle.
The sprung mass' pitch and yaw inertia are taken as equal, so Izz does not change with roll.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, cos, hypot, sin, sqrt

from sitl.plant.axles import STICTION_SPEED, Axles
from sitl.plant.effects.axle_effects import IDS, EffectAxles, friction_pole, yaw_poles
from sitl.plant.effects.replaced_numbers import resolved
from sitl.plant.effects.slope import Slope
from sitl.plant.effects.table_laws import TableForces
from sitl.plant.effects_table import number
from sitl.plant.motor import Motor
from sitl.plant.road import Road
from sitl.plant.servo import Servo
from sitl.plant.tyre import LOW_SPEED
from sitl.plant.variant import GRAVITY, PlantParameters, load_variant, variant_names

__all__ = ["GRAVITY", "Plant", "PlantParameters", "PlantState", "load_variant", "variant_names"]

_LEVEL = (0.0, 0.0)
_STIFFEST = 5e4  # 1/s, fastest pole at 1 m/s: some 200 sub-steps of 2.5 ms
_STEP_LIMIT = 0.6  # step times fastest tyre pole that the midpoint rule is used up to


class PlantState:
    """Where the rover is and how it moves, ISO axes, SI units; changed in place by every step.

    t [s]; x (north), y (west) [m] of the reference point; psi heading [rad], unwrapped; vx, vy [m/s] of the
    reference point along and across the heading; r = psi', p = phi' [rad/s]; phi roll [rad]; delta
    road-wheel angle [rad]. vx_dot, vy_dot [m/s2], r_dot, p_dot [rad/s2]: the last (sub-)step's mean rates
    of change, on a slope with what it holds against gravity added. ax, ay, az: specific force [m/s2] at the
    IMU in its own (rolled) axes, gravity included (az = +g at rest), the mean of the last (sub-)step, as an
    integrating accelerometer gives it.
    """

    __slots__ = (
        "ax",
        "ay",
        "az",
        "delta",
        "p",
        "p_dot",
        "phi",
        "psi",
        "r",
        "r_dot",
        "t",
        "vx",
        "vx_dot",
        "vy",
        "vy_dot",
        "x",
        "y",
    )

    def __init__(self) -> None:
        self.t = self.x = self.y = self.psi = 0.0
        self.vx = self.vy = self.r = self.phi = self.p = self.delta = 0.0
        self.vx_dot = self.vy_dot = self.r_dot = self.p_dot = 0.0
        self.ax = self.ay = 0.0
        self.az = GRAVITY


class Plant:
    """The rover. `step` it with the PWM that holds; read `state`. Same seed, same inputs, same motion.

    parameters: as they act, the variant's effects that are numbers in their places.
    """

    def __init__(self, parameters: PlantParameters, seed: int = 1) -> None:
        self.parameters = parameters = resolved(parameters)
        self.state = PlantState()
        self._servo = Servo(parameters)
        self._motor = Motor(parameters)
        self._road = Road(parameters, seed)
        effects = parameters.effects
        self._effects = EffectAxles(parameters, self._road) if IDS & effects.keys() else None
        self._axles: Axles = self._effects or Axles(parameters, self._road)
        a, b = parameters.cg_to_front_axle, parameters.cg_to_rear_axle
        laws = parameters.laws
        self._tables = TableForces(self._axles, laws, parameters.mass, a, b) if laws else None
        self._forces = self._tables.forces if self._tables else self._axles.forces
        self._relaxation = self._effects.relaxation if self._effects else None
        self._slope = Slope(effects) if "cross_slope" in effects else None
        self._constants = _constants(parameters)
        forward, right, down = parameters.imu_position
        self._imu = (forward, -right, parameters.cg_height_above_roll_centre - down)
        self._tyre_pole, self._roll_pole = _fast_poles(parameters)
        _refuse_stiff(parameters, self._tyre_pole, self._roll_pole)
        sh = parameters.sprung_mass * parameters.cg_height_above_roll_centre
        self._lean = sh / (parameters.roll_stiffness - sh * GRAVITY)  # rad per m/s2 that is felt, standing
        self._upright = 1e-3 + (abs(self._lean * self._slope.steepest) if self._slope else 0.0)

    def step(self, steer_us: float, throttle_us: float, dt: float) -> None:
        """Advance by dt [s] (2.5 ms is meant, up to 0.02 works) with these PWM [us]; 0 us means no pulse."""
        state, servo = self.state, self._servo
        servo.command(steer_us, state.t)
        self._motor.command(throttle_us, state.t)
        self._axles.wanted_speed = self._motor.wanted_speed(state.t)
        end = state.t + dt
        if self._parked():
            self._stand(servo.advance(state.t, end), end)
            return
        speed = hypot(state.vx, state.vy)
        self._road.advance(speed * dt, speed)
        if self._effects is not None:
            self._effects.travel(speed * dt, end, state.psi)
        rolling = abs(state.vx)
        pole = self._tyre_pole / (rolling if rolling > LOW_SPEED else LOW_SPEED) + self._roll_pole
        substeps = ceil(dt * pole / _STEP_LIMIT)
        if substeps <= 1:
            self._move(dt)
        else:
            for _ in range(substeps):
                self._move(dt / substeps)
        if self._tables is not None:
            self._tables.advance(dt)
        state.t = end

    def derivatives(
        self, vx: float, vy: float, r: float, phi: float, p: float, delta: float
    ) -> tuple[float, float, float, float]:
        """(vx', vy', r', p') of a motion with the road-wheel angle delta, from the equations above."""
        m, sh, shh, coupling, izz, roll_inertia, ixz, k, damping, sgh = self._constants
        fx, fy, mz, roll_moment = self._forces(vx, vy, r, phi, p, delta)
        s, c = sin(phi), cos(phi)

        # vx', vy' eliminated from the last two equations; coupling = 1 - m_s/m
        hs = sh * s
        yaw = mz - hs * fx / m - coupling * shh * s * 2.0 * r * p * c
        centrifugal = sh * s * (p * p + r * r)
        roll = (
            sgh * s
            - k * phi
            - damping * p
            + roll_moment
            + sh * c * (fy - centrifugal) / m
            + shh * r * r * s * c
        )
        j_yaw = izz + coupling * shh * s * s
        j_roll = roll_inertia - sh * sh * c * c / m
        determinant = j_yaw * j_roll - ixz * ixz
        r_dot = (yaw * j_roll - ixz * roll) / determinant
        p_dot = (roll * j_yaw - ixz * yaw) / determinant
        vx_dot = r * vy + (fx - hs * r_dot - 2.0 * sh * r * p * c) / m
        vy_dot = -r * vx + (fy + sh * c * p_dot - centrifugal) / m
        return vx_dot, vy_dot, r_dot, p_dot

    def _move(self, dt: float) -> None:
        """One explicit midpoint step."""
        state, servo = self.state, self._servo
        vx, vy, r, phi, p, delta = state.vx, state.vy, state.r, state.phi, state.p, state.delta
        half = 0.5 * dt
        end = state.t + dt
        new_delta = servo.advance(state.t, end)
        slope, relaxation = self._slope, self._relaxation
        ax, ay, ar, ap = self.derivatives(vx, vy, r, phi, p, delta)
        gx, gy = _LEVEL if slope is None else slope.hold(state.psi)
        if relaxation is not None:
            relaxation.half(self._axles.steady, vx, half)
        middle = self.derivatives(
            vx_m := vx + half * (ax - gx),
            vy_m := vy + half * (ay - gy),
            r_m := r + half * ar,
            phi_m := phi + half * p,
            p_m := p + half * ap,
            0.5 * (delta + new_delta),
        )
        ax, ay, ar, ap = middle
        psi_m = state.psi + half * r
        gx, gy = _LEVEL if slope is None else slope.hold(psi_m)
        if relaxation is not None:
            relaxation.end(self._axles.steady, vx_m, dt)
        sn, cn = sin(psi_m), cos(psi_m)
        state.x += dt * (vx_m * cn - vy_m * sn)
        state.y += dt * (vx_m * sn + vy_m * cn)
        state.psi += dt * r_m
        state.vx, state.vy, state.r = vx + dt * (ax - gx), vy + dt * (ay - gy), r + dt * ar
        state.phi, state.p = phi + dt * p_m, p + dt * ap
        state.vx_dot, state.vy_dot, state.r_dot, state.p_dot = ax, ay, ar, ap
        state.delta, state.t = new_delta, end
        self._feel(vx_m, vy_m, r_m, phi_m, p_m)

    def _feel(self, vx: float, vy: float, r: float, phi: float, p: float) -> None:
        """Specific force at the IMU, a = a_ref + w' x rho + w x (w x rho) + g up, turned into rolled axes."""
        state = self.state
        ahead, left, above = self._imu
        s, c = sin(phi), cos(phi)
        y, z = left * c - above * s, left * s + above * c
        r_dot, p_dot = state.r_dot, state.p_dot
        # w = (p, 0, r) in the yawing frame, so w' = (p', r p, r')
        ax = state.vx_dot - r * vy + 2.0 * r * p * z - r_dot * y - r * r * ahead
        ay = state.vy_dot + r * vx + r_dot * ahead - p_dot * z - (r * r + p * p) * y
        az = GRAVITY + p_dot * y - p * p * z
        state.ax, state.ay, state.az = ax, ay * c + az * s, az * c - ay * s

    def _parked(self) -> bool:
        """Whether the rover is at rest with less drive than static friction."""
        state, parameters = self.state, self.parameters
        if abs(state.vx) > STICTION_SPEED or abs(state.vy) > STICTION_SPEED or abs(state.r) > STICTION_SPEED:
            return False
        if abs(state.p) > 1e-3 or abs(state.phi) > self._upright:
            return False
        drive = parameters.mass / parameters.speed_lag * abs(self._axles.wanted_speed)
        return drive <= parameters.rolling_resistance * parameters.mass * GRAVITY

    def _stand(self, delta: float, t: float) -> None:
        state = self.state
        state.vx = state.vy = state.r = state.p = 0.0
        state.r_dot = state.p_dot = 0.0
        state.vx_dot, state.vy_dot = _LEVEL if self._slope is None else self._slope.hold(state.psi)
        state.phi = self._lean * state.vy_dot
        state.ax, state.ay, state.az = state.vx_dot, state.vy_dot + GRAVITY * sin(state.phi), GRAVITY
        if self._relaxation is not None:
            self._relaxation.rest()
        state.delta, state.t = delta, t


def _constants(q: PlantParameters) -> tuple[float, ...]:
    """Arguments of `derivatives` in its order, computed once."""
    sh = q.sprung_mass * q.cg_height_above_roll_centre
    shh = sh * q.cg_height_above_roll_centre
    return (
        q.mass,
        sh,
        shh,
        1.0 - q.sprung_mass / q.mass,
        q.yaw_inertia,
        q.roll_inertia + shh,
        q.roll_yaw_inertia,
        q.roll_stiffness,
        q.roll_damping,
        sh * GRAVITY,
    )


def _fast_poles(q: PlantParameters) -> tuple[float, float]:
    """Bounds of the fast poles: (tyres, times the rolling speed [m/s2], suspension [1/s])."""
    sh = q.sprung_mass * q.cg_height_above_roll_centre
    roll_inertia = q.roll_inertia + sh * q.cg_height_above_roll_centre
    light_mass = q.mass - sh * sh / roll_inertia  # what the axles push when the body is free to roll
    light_roll = roll_inertia - sh * sh / q.mass
    cf, cr = q.front_cornering_stiffness, q.rear_cornering_stiffness
    lateral = (cf + cr) / light_mass
    yaw = (q.cg_to_front_axle**2 * cf + q.cg_to_rear_axle**2 * cr) / q.yaw_inertia
    roll = q.roll_damping / light_roll + sqrt(q.roll_stiffness / light_roll)
    stiffer = max(1.0, number(q.effects, "surface_change", "ratio", 1.0))
    scrub, scrub_by_speed = yaw_poles(q.effects, q.yaw_inertia)
    tyres = stiffer * (lateral + yaw) + scrub_by_speed
    return tyres, roll + scrub + friction_pole(q.effects, light_roll)


def _refuse_stiff(q: PlantParameters, tyre_pole: float, roll_pole: float) -> None:
    """ValueError for a rover too stiff for the time step."""
    pole = tyre_pole / 1.0 + roll_pole  # at 1 m/s
    if pole <= _STIFFEST:
        return
    rest = tyre_pole / 1.0 + _fast_poles(replace(q, effects={}))[1]
    if rest < _STIFFEST and "suspension_friction" in q.effects:
        torque = number(q.effects, "suspension_friction", "T")
        most = torque * (_STIFFEST - rest) / (pole - rest)
        raise ValueError(
            f"suspension_friction: T = {torque:g} N m must be at most {most:.2g} N m for a rover with this "
            "roll inertia"
        )
    raise ValueError(
        f"tyres or suspension are too stiff to simulate: they answer at {pole:.2g} 1/s, which must be at "
        f"most {_STIFFEST:g} 1/s; give less stiffness or damping, or more inertia"
    )
