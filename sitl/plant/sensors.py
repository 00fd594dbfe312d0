"""Sensor signals of the plant in ArduPilot's axes: FRD body, NED earth.

Discretisation: the plant's step is the IMU's sampling (400 Hz is meant; real hardware samples at about
1 kHz, which is out of reach in Python). Noise is given as a spectral density, so what is left after
ArduPilot's low-pass does not depend on the rate.

The estimator (EKF) is emulated, not run: truth through a first-order lag (velocity only) plus errors that
change slowly (first-order Gauss-Markov), so that it drifts as an EKF with GPS does.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, inf, pi, sin, sqrt, tan

from sitl.plant.effects.imu import IDS, Delayed, FirstOrder, Mounting, hidden_cutoffs, scales
from sitl.plant.effects.replaced_numbers import resolved
from sitl.plant.effects.slope import Slope
from sitl.plant.effects_table import BEFORE_ESTIMATOR, form
from sitl.plant.plant import PlantState
from sitl.plant.road import normals
from sitl.plant.variant import PlantParameters

Vector = tuple[float, float, float]


class LowPassFilter2p:
    """ArduPilot's second-order Butterworth low-pass (Filter/LowPassFilter2p.cpp), float64.

    The first sample sets the filter, as there. A cut-off of 0 passes everything; it is held below 0.4 of
    the sampling rate.
    """

    __slots__ = ("_a1", "_a2", "_b0", "_d1", "_d2", "_started", "cutoff_hz")

    def __init__(self, sample_hz: float, cutoff_hz: float) -> None:
        self.cutoff_hz = min(cutoff_hz, 0.4 * sample_hz)
        self._started = False
        self._d1 = self._d2 = 0.0
        ohm = tan(pi * self.cutoff_hz / sample_hz)
        c = 1.0 + 2.0 * cos(pi / 4) * ohm + ohm * ohm
        self._b0 = ohm * ohm / c
        self._a1 = 2.0 * (ohm * ohm - 1.0) / c
        self._a2 = (1.0 - 2.0 * cos(pi / 4) * ohm + ohm * ohm) / c

    def apply(self, sample: float) -> float:
        """The next filtered value."""
        if self.cutoff_hz <= 0.0:
            return sample
        if not self._started:
            self._d1 = self._d2 = sample / (1.0 + self._a1 + self._a2)
            self._started = True
        d1, d2 = self._d1, self._d2
        d0 = sample - d1 * self._a1 - d2 * self._a2
        self._d2, self._d1 = d1, d0
        return self._b0 * (d0 + d1 + d1 + d2)


@dataclass(frozen=True)
class GpsFix:
    """t [s] it was measured at; position NED [m] from where the plant started; velocity NED [m/s]."""

    t: float
    position: Vector
    velocity: Vector


class Sensors:
    """`update` once after every plant step of 1/rate_hz [s]; then read:

    gyro_raw [rad/s], accel_raw [m/s2]  unfiltered IMU sample, FRD (specific force: z is -g at rest)
    gyro, accel                         the same through INS_GYRO_FILTER and INS_ACCEL_FILTER
    attitude (roll, pitch, yaw) [rad], velocity [m/s], position [m]   estimator, NED, at the IMU
    gps                                 newest GpsFix, None before the first
    true_attitude, true_velocity, true_position   without error, NED, at the IMU
    """

    def __init__(
        self,
        parameters: PlantParameters,
        seed: int = 1,
        rate_hz: float = 400.0,
        gyro_filter_hz: float = 4.0,
        accel_filter_hz: float = 10.0,
    ) -> None:
        self.parameters = parameters = resolved(parameters)
        self.rate_hz = rate_hz
        effects = parameters.effects
        self._mounting = Mounting(effects) if IDS & effects.keys() else None
        self._slope = Slope(effects) if "cross_slope" in effects else None
        self._gyro_scale, self._accel_scale = scales(effects)
        self._hidden = self._hidden_filters() if "sensor_filter" in effects else None
        early = form(effects, "sensor_filter").endswith(BEFORE_ESTIMATOR)
        self._yaw_filter = self._hidden_filters()[2] if early and self._hidden is not None else None
        self._heading_lag = 0.0
        self._noise = normals(seed, stream=2)
        self._estimator_noise = normals(seed, stream=3)
        root = sqrt(rate_hz / 2.0)  # one-sided density to rms of a sample
        self._gyro_rms = parameters.gyro_noise * root
        self._accel_rms = parameters.accel_noise * root
        self._vibration = parameters.vibration * root
        self._keep = exp(-1.0 / (rate_hz * parameters.error_time))
        self._fresh = sqrt(1.0 - self._keep**2)
        self._errors = [0.0] * 5
        self._follow = (
            1.0 - exp(-1.0 / (rate_hz * parameters.velocity_lag)) if parameters.velocity_lag else 1.0
        )
        late = form(parameters.effects, "velocity_lag") == "delay" and parameters.velocity_lag > 0.0
        cutoff = 1.0 / (2.0 * pi * parameters.velocity_lag) if late else 0.0
        self._late = tuple(Delayed(rate_hz, cutoff) for _ in range(3)) if late else ()
        self._pending: list[GpsFix] = []
        self._next_fix = 0.0
        zero = (0.0, 0.0, 0.0)
        self.gyro_raw: Vector = zero
        self.accel_raw: Vector = zero
        self.gyro: Vector = zero
        self.accel: Vector = zero
        self.true_attitude: Vector = zero
        self.true_velocity: Vector = zero
        self.true_position: Vector = zero
        self.attitude: Vector = zero
        self.velocity: Vector = zero
        self.position: Vector = zero
        self.gps: GpsFix | None = None
        self._lagged: Vector = zero
        self.set_filters(gyro_filter_hz, accel_filter_hz)

    def set_filters(self, gyro_hz: float, accel_hz: float) -> None:
        """New cut-offs [Hz] (INS_GYRO_FILTER, INS_ACCEL_FILTER); the filters start afresh."""
        self._gyro_filters = tuple(LowPassFilter2p(self.rate_hz, gyro_hz) for _ in range(3))
        self._accel_filters = tuple(LowPassFilter2p(self.rate_hz, accel_hz) for _ in range(3))

    def update(self, state: PlantState) -> None:
        """Sample the plant."""
        self._sample_imu(state)
        self._locate(state)
        self._estimate()
        if state.t >= self._next_fix or self._pending:
            self._receive_gps(state.t)

    def _sample_imu(self, state: PlantState) -> None:
        noise, rms = self._noise, self._gyro_rms
        bx, by, bz = self.parameters.gyro_bias
        s, c = sin(state.phi), cos(state.phi)
        # body rates: with a roll angle the yaw rate shows in y and z
        wx, wy, wz = state.p, -state.r * s, -state.r * c
        if self._mounting is not None:
            wx, wy, wz = self._mounting.seen((wx, wy, wz))
        if self._yaw_filter is not None:
            self._heading_lag += (state.r - self._yaw_filter.apply(state.r)) / self.rate_hz
        scale = self._gyro_scale
        gx = scale * wx + bx + rms * next(noise)
        gy = scale * wy + by + rms * next(noise)
        gz = scale * wz + bz + rms * next(noise)
        rms = self._accel_rms + self._vibration * abs(state.vx)
        bx, by, bz = self.parameters.accel_bias
        fx, fy, fz = state.ax, -state.ay, -state.az
        if self._mounting is not None:
            fx, fy, fz = self._mounting.seen((fx, fy, fz))
        scale = self._accel_scale
        ax = scale * fx + bx + rms * next(noise)
        ay = scale * fy + by + rms * next(noise)
        az = scale * fz + bz + rms * next(noise)
        if self._hidden is not None:
            gx, gy, gz, ax, ay, az = (
                f.apply(x) for f, x in zip(self._hidden, (gx, gy, gz, ax, ay, az), strict=True)
            )
        self.gyro_raw, self.accel_raw = (gx, gy, gz), (ax, ay, az)
        f, g, h = self._gyro_filters
        self.gyro = (f.apply(gx), g.apply(gy), h.apply(gz))
        f, g, h = self._accel_filters
        self.accel = (f.apply(ax), g.apply(ay), h.apply(az))

    def _locate(self, state: PlantState) -> None:
        """Truth at the IMU, NED."""
        forward, right, down = self.parameters.imu_position
        left, above = -right, self.parameters.cg_height_above_roll_centre - down
        s, c = sin(state.phi), cos(state.phi)
        y, z = left * c - above * s, left * s + above * c
        vx = state.vx - state.r * y
        vy = state.vy + state.r * forward - state.p * z
        sn, cn = sin(state.psi), cos(state.psi)
        self.true_attitude = (state.phi, 0.0, -state.psi)
        if self._mounting is not None or self._slope is not None:
            self.true_attitude = self._attitude(state)
        self.true_velocity = (vx * cn - vy * sn, -(vx * sn + vy * cn), -state.p * y)
        north = state.x + forward * cn - y * sn
        west = state.y + forward * sn + y * cn
        self.true_position = (north, -west, -z)

    def _attitude(self, state: PlantState) -> Vector:
        """Of the IMU where road or mounting are not level; the angles are added, being small."""
        roll, pitch, yaw = state.phi, 0.0, -state.psi
        if self._slope is not None:
            tilt, pitch = self._slope.attitude(state.psi)
            roll += tilt
        if self._mounting is not None:
            more = self._mounting.angles
            roll, pitch, yaw = roll + more[0], pitch + more[1], yaw + more[2]
        return roll, pitch, yaw

    def _hidden_filters(self) -> tuple[LowPassFilter2p | FirstOrder | Delayed, ...]:
        """Low-passes of the three gyros and three accelerometers, before the autopilot's own."""
        gyro_hz, accel_hz = hidden_cutoffs(self.parameters.effects)
        law = form(self.parameters.effects, "sensor_filter").removesuffix(BEFORE_ESTIMATOR)
        kind: type[LowPassFilter2p | FirstOrder | Delayed] = LowPassFilter2p
        if law != "second order":
            kind = FirstOrder if law == "first order" else Delayed
        rates = (gyro_hz,) * 3 + (accel_hz,) * 3
        return tuple(
            LowPassFilter2p(self.rate_hz, 0.0) if hz == inf else kind(self.rate_hz, hz) for hz in rates
        )

    def _estimate(self) -> None:
        keep, fresh, errors, noise = self._keep, self._fresh, self._errors, self._estimator_noise
        for k in range(5):
            errors[k] = keep * errors[k] + fresh * next(noise)
        angle, speed = self.parameters.attitude_error, self.parameters.velocity_error
        roll, pitch, yaw = self.true_attitude
        yaw += self._heading_lag  # the heading that is integrated from a late gyro
        self.attitude = (roll + angle * errors[0], pitch + angle * errors[1], yaw + angle * errors[2])
        if self._late:
            a, b, c = (f.apply(v) for f, v in zip(self._late, self.true_velocity, strict=True))
            self._lagged = lagged = (a, b, c)
        else:
            self._lagged = lagged = _towards(self._lagged, self.true_velocity, self._follow)
        self.velocity = (lagged[0] + speed * errors[3], lagged[1] + speed * errors[4], lagged[2])
        self.position = self.true_position

    def _receive_gps(self, t: float) -> None:
        if t >= self._next_fix:
            self._next_fix += self.parameters.gps_interval
            place, speed, noise = (
                self.parameters.gps_position_error,
                self.parameters.gps_velocity_error,
                self._estimator_noise,
            )
            n, e, d = self.true_position
            vn, ve, vd = self.true_velocity
            fix = GpsFix(
                t,
                (n + place * next(noise), e + place * next(noise), d + place * next(noise)),
                (vn + speed * next(noise), ve + speed * next(noise), vd + speed * next(noise)),
            )
            self._pending.append(fix)
        if self._pending and t >= self._pending[0].t + self.parameters.gps_lag:
            self.gps = self._pending.pop(0)


def _towards(now: Vector, goal: Vector, share: float) -> Vector:
    """`now` moved by a share of the way to `goal`."""
    a, b, c = now
    x, y, z = goal
    return a + share * (x - a), b + share * (y - b), c + share * (z - c)
