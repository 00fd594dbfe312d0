"""ArduRover's steering chain from turn rate to road-wheel angle, and its parameters.

Source: ArduRover 4.6.3 (tag Rover-4.6.3); 4.5.7 is the same in all of these points:

- `Rover/mode_acro.cpp` ModeAcro::update: desired turn rate = stick / 4500 * ACRO_TURN_RATE; the controller's
  output times 4500 goes to `Mode::set_steering`. AUTO, GUIDED, RTL, SMART_RTL, LOITER and STEERING end in the
  same `AR_AttitudeControl::get_steering_out_rate` (`Rover/mode.cpp`: calc_steering_from_turn_rate,
  calc_steering_to_heading, calc_steering_from_lateral_acceleration). MANUAL bypasses it.
- `libraries/APM_Control/AR_AttitudeControl.cpp` get_steering_out_rate: the target is limited in change by
  ATC_STR_ACC_MAX (deg/s^2), in size by ATC_STR_RAT_MAX (deg/s) and by ATC_TURN_MAX_G over the speed (at
  least 1 m/s); then AC_PID::update_all plus get_ff; no limit of the output there. The measurement is
  `AP_AHRS::get_yaw_rate_earth`, made of the gyro behind INS_GYRO_FILTER (second order) less its bias.
- `libraries/AR_Motors/AP_MotorsUGV.cpp` output_regular, with apply_scaling in all modes but MANUAL (unless
  MANUAL_OPTIONS has bit 0) and GUIDED driven by steering-and-throttle messages (`Rover/mode_guided.cpp`):
  if MOT_SPD_SCA_BASE > 0 and abs(speed) > MOT_SPD_SCA_BASE the steering is multiplied by
  MOT_SPD_SCA_BASE / abs(speed); otherwise it is not, and the limit flags are set, so that the integrator may
  only shrink. Then it is limited to +-4500, which sets the flags too (set_limits_from_input). So a controller
  output above 1 still has an effect at speed.
- `libraries/SRV_Channel/SRV_Channel.cpp` pwm_from_angle: +4500 is SERVOn_MAX, -4500 SERVOn_MIN, 0
  SERVOn_TRIM, straight lines between, cut to whole us; SERVOn_REVERSED turns the sign.
- `Rover/Rover.cpp` scheduler table: ahrs_update, update_current_mode and set_servos run in this order in
  every main loop (up to 400 Hz), so measurement, controller and PWM belong to one tick and the output is held
  until the next.
- Defaults: AR_ATTCONTROL_* in AR_AttitudeControl.cpp; its constructor gives the error filter 10 Hz, target
  and derivative none.

The speed in the scale is `get_forward_speed`, the EKF's, which lags the true one a little.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import Array, LowPass
from rover_sweep.identification.conversion import to_scipy
from rover_sweep.identification.state_space import ModelStructure

STEERING_FUNCTION = 26  # SERVOn_FUNCTION GroundSteering
SERVO_OUTPUTS = 16
LEAST_SPEED = 1.0  # m/s, AR_ATTCONTROL_STEER_SPEED_MIN

DEFAULTS: Mapping[str, float] = {
    "ATC_STR_RAT_FF": 0.2,
    "ATC_STR_RAT_P": 0.2,
    "ATC_STR_RAT_I": 0.2,
    "ATC_STR_RAT_D": 0.0,
    "ATC_STR_RAT_IMAX": 1.0,
    "ATC_STR_RAT_FLTT": 0.0,
    "ATC_STR_RAT_FLTE": 10.0,
    "ATC_STR_RAT_FLTD": 0.0,
    "ATC_STR_RAT_D_FF": 0.0,
    "ATC_STR_RAT_SMAX": 0.0,
    "ATC_STR_RAT_PDMX": 0.0,
    "ATC_STR_RAT_NTF": 0.0,
    "ATC_STR_RAT_NEF": 0.0,
    "ATC_STR_RAT_MAX": 120.0,
    "ATC_STR_ACC_MAX": 120.0,
    "ATC_STR_ANG_P": 2.0,
    "ATC_TURN_MAX_G": 0.6,
    "MOT_SPD_SCA_BASE": 1.0,
    "SCHED_LOOP_RATE": 50.0,
    "INS_GYRO_FILTER": 4.0,
}
"""Defaults of ArduRover 4.6.3."""
SERVO_DEFAULTS: Mapping[str, float] = {"MIN": 1100.0, "MAX": 1900.0, "TRIM": 1500.0, "REVERSED": 0.0}


@dataclass(frozen=True)
class Gains:
    """ATC_STR_RAT_*: ff, p [1/(rad/s)], d [s/(rad/s)] and i [1/rad] to an output of -1..1; imax: limit of the
    integrator's output; fltt, flte, fltd: low-passes of target, error and derivative [Hz], 0 for none."""

    ff: float
    p: float
    i: float
    d: float = 0.0
    imax: float = 1.0
    fltt: float = 0.0
    flte: float = 10.0
    fltd: float = 0.0
    dff: float = 0.0

    @property
    def parameters(self) -> dict[str, float]:
        """The gains by the firmware's parameter names."""
        return {
            "ATC_STR_RAT_FF": self.ff,
            "ATC_STR_RAT_P": self.p,
            "ATC_STR_RAT_I": self.i,
            "ATC_STR_RAT_D": self.d,
            "ATC_STR_RAT_IMAX": self.imax,
            "ATC_STR_RAT_FLTT": self.fltt,
            "ATC_STR_RAT_FLTE": self.flte,
            "ATC_STR_RAT_FLTD": self.fltd,
        }


@dataclass(frozen=True)
class Autopilot:
    """The loop around the controller. loop_hz: main loop; gyro_hz: low-pass of the gyro, 0 for none.

    scale_base: MOT_SPD_SCA_BASE [m/s]. us_right, us_left: PWM [us] from trim to the end of each side.
    rate_max [rad/s], accel_max [rad/s^2], lateral_g_max [g]: limits of the target, 0 for none (except for g).
    angle_p: ATC_STR_ANG_P [1/s] of the heading controller.
    reversed: SERVOn_REVERSED. assumed: names of parameters that were not given and have their defaults.
    """

    gains: Gains
    loop_hz: float
    gyro_hz: float
    scale_base: float
    us_right: float
    us_left: float
    rate_max: float
    accel_max: float
    lateral_g_max: float
    angle_p: float
    servo: int = 1
    reversed: bool = False
    assumed: tuple[str, ...] = ()
    not_modelled: Mapping[str, float] = field(default_factory=dict)

    @property
    def assumed_words(self) -> str:
        """A sentence on the assumed parameters; "" if all were given."""
        if not self.assumed:
            return ""
        if "ATC_STR_RAT_FF" in self.assumed and len(self.assumed) >= len(DEFAULTS):
            rates = f"SCHED_LOOP_RATE {self.loop_hz:g} Hz, INS_GYRO_FILTER {self.gyro_hz:g} Hz"
            return (
                f"The steering's parameters are not known: the firmware's defaults are assumed, with {rates}."
            )
        return f"Assumed at the firmware's defaults: {', '.join(self.assumed)}."

    @property
    def period(self) -> float:
        """Period of the main loop, s."""
        return 1.0 / self.loop_hz

    def speed_scale(self, speed: float) -> float:
        """Factor on the controller's output at a speed [m/s]."""
        scaled = self.scale_base > 0 and abs(speed) > self.scale_base
        return self.scale_base / abs(speed) if scaled else 1.0

    def integrates(self, speed: float) -> bool:
        """False if the limit flags hold the integrator: at or below MOT_SPD_SCA_BASE, or if that is 0."""
        return self.scale_base > 0 and abs(speed) > self.scale_base

    def rate_limit(self, speed: float) -> float:
        """Largest target turn rate [rad/s] that the firmware allows at a speed [m/s]."""
        by_force = self.force_limit(speed)
        return min(by_force, self.rate_max) if self.rate_max > 0 else by_force

    def force_limit(self, speed: float) -> float:
        """`rate_limit` of ATC_TURN_MAX_G alone."""
        by_force = self.lateral_g_max * STANDARD_GRAVITY / max(abs(speed), LEAST_SPEED)
        return max(by_force, math.radians(1.0))

    def angle_per_output(self, rad_per_us: float) -> float:
        """Road-wheel angle [rad, positive right] per output of 1 after the speed scale, mean of both sides.

        Negative if servo and linkage turn the wrong way: the controller then steers away from its target.
        """
        sign = -1.0 if self.reversed else 1.0
        return sign * rad_per_us * 0.5 * (self.us_right + self.us_left)


def autopilot(parameters: Mapping[str, float], assumed: Mapping[str, float] | None = None) -> Autopilot:
    """The loop from the autopilot's parameters by name. assumed: values to use before the defaults.

    Raises ValueError for impossible servo ends or loop rate.
    """
    filled = {
        n: float(f"{v:.7g}") for n, v in {**DEFAULTS, **(assumed or {}), **parameters}.items()
    }  # float32
    servo = steering_servo(parameters)
    ends = {k: parameters.get(f"SERVO{servo}_{k}", v) for k, v in SERVO_DEFAULTS.items()}
    lacking = [n for n in (*DEFAULTS, *(f"SERVO{servo}_{k}" for k in SERVO_DEFAULTS)) if n not in parameters]
    swap = bool(ends["REVERSED"])
    right, left = ends["MAX"] - ends["TRIM"], ends["TRIM"] - ends["MIN"]
    if swap:
        right, left = left, right
    if not (right > 0 and left > 0 and filled["SCHED_LOOP_RATE"] > 0):
        raise ValueError(
            f"SERVO{servo}_MIN {ends['MIN']:g}, _TRIM {ends['TRIM']:g}, _MAX {ends['MAX']:g} us and "
            f"SCHED_LOOP_RATE {filled['SCHED_LOOP_RATE']:g} Hz are not possible; check these parameters"
        )
    unusual = ("ATC_STR_RAT_SMAX", "ATC_STR_RAT_PDMX", "ATC_STR_RAT_NTF", "ATC_STR_RAT_NEF")
    rat = {
        k.removeprefix("ATC_STR_RAT_").lower().replace("_", ""): v
        for k, v in filled.items()
        if k.startswith("ATC_STR_RAT_")
    }
    return Autopilot(
        Gains(**{k: float(rat[k]) for k in Gains.__dataclass_fields__}),
        float(filled["SCHED_LOOP_RATE"]),
        float(filled["INS_GYRO_FILTER"]),
        float(filled["MOT_SPD_SCA_BASE"]),
        right,
        left,
        math.radians(filled["ATC_STR_RAT_MAX"]),
        math.radians(filled["ATC_STR_ACC_MAX"]),
        max(float(filled["ATC_TURN_MAX_G"]), 0.1),
        float(filled["ATC_STR_ANG_P"]),
        servo,
        swap,
        tuple(lacking),
        {n: float(filled[n]) for n in unusual if filled[n]},
    )


def steering_servo(parameters: Mapping[str, float]) -> int:
    """Number of the servo output that steers, 1 if the parameters do not name one."""
    found = (
        n for n in range(1, SERVO_OUTPUTS + 1) if parameters.get(f"SERVO{n}_FUNCTION") == STEERING_FUNCTION
    )
    return next(found, 1)


# The controller's plant: road-wheel angle to filtered yaw rate, sampled in the main loop.


@dataclass(frozen=True, eq=False)
class SampledPlant:
    """x(k+1) = a x(k) + b u(k - delay_steps), y(k) = c x(k), from the road-wheel angle u [rad], held over
    `period` [s], to the filtered yaw rate y [rad/s]. delay_steps: whole periods of delay; a and b include the
    rest of the delay."""

    a: Array
    b: Array
    c: Array
    delay_steps: int
    period: float
    speed: float
    label: str = ""

    @property
    def gain(self) -> float:
        """Steady y/u, 1/s."""
        return float(self.c @ np.linalg.solve(np.eye(len(self.a)) - self.a, self.b))

    @property
    def stable(self) -> bool:
        return bool(np.all(np.abs(np.linalg.eigvals(self.a)) < 1.0))

    def response(self, w: Array) -> NDArray[np.complex128]:
        """Frequency response (n,) at w (n,) rad/s, up to pi / period."""
        z = np.exp(1j * w * self.period)
        system = z[:, None, None] * np.eye(len(self.a)) - self.a
        x = np.linalg.solve(
            system, np.broadcast_to(self.b.astype(complex)[:, None], (w.size, len(self.b), 1))
        )
        return np.asarray(x[:, :, 0] @ self.c.astype(complex) * z**-self.delay_steps, complex)


def sampled_plant(
    structure: ModelStructure,
    speed: float,
    autopilot: Autopilot,
    hidden: Sequence[LowPass] = (),
    label: str = "",
) -> SampledPlant:
    """The plant at a speed [m/s]. hidden: low-passes before the autopilot's own.

    Raises ValueError if the yaw rate follows the steering without any lag (an algebraic loop).
    """
    sensors = {"r": LowPass(autopilot.gyro_hz, "INS_GYRO_FILTER")} if autopilot.gyro_hz > 0 else {}
    delay_steps, rest = _split_delay(structure, autopilot.period)
    system = to_scipy(rest, speed, dt=autopilot.period, sensors=sensors)
    row = structure.outputs.index("r")
    if abs(system.D[row, 0]) > 1e-12:
        raise ValueError(f"in the {structure.name} model the yaw rate follows the steering without lag")
    a, b, c = np.asarray(system.A), np.asarray(system.B)[:, 0], np.asarray(system.C)[row]
    for low_pass in hidden:
        a, b, c = _with_low_pass(a, b, c, low_pass, autopilot.period)
    return SampledPlant(*_observable(a, b, c), delay_steps, autopilot.period, speed, label)


def _split_delay(structure: ModelStructure, period: float) -> tuple[int, ModelStructure]:
    """Whole periods of the steering's delay, and the structure with the rest of the delay."""
    name = structure.input_delays.get(structure.inputs[0])
    if name is None:
        return 0, structure
    delay_steps = int(np.floor(structure.values[name] / period + 1e-9))
    return delay_steps, structure.with_values({name: max(structure.values[name] - delay_steps * period, 0.0)})


def _with_low_pass(
    a: Array, b: Array, c: Array, low_pass: LowPass, period: float
) -> tuple[Array, Array, Array]:
    """The system with a second-order low-pass at its output, by Tustin's rule as in ArduPilot's filters."""
    from scipy.signal import butter, tf2ss

    cutoff = min(low_pass.cutoff_hz, 0.4 / period)
    fa, fb, fc, fd = tf2ss(*butter(2, cutoff, fs=1 / period))
    n, m = len(a), len(fa)
    combined = np.block([[a, np.zeros((n, m))], [fb @ c[None, :], fa]])
    return combined, np.concatenate((b, np.zeros(m))), np.concatenate((fd[0, 0] * c, fc[0]))


def _observable(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """The system without unobservable states, such as the filters of other outputs."""
    observed, grown = np.abs(c) > 0, True
    while grown:
        wider = observed | (np.abs(a[observed]) > 0).any(axis=0)
        grown, observed = bool(np.any(wider != observed)), wider
    return a[np.ix_(observed, observed)], b[observed], c[observed]
