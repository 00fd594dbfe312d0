"""ArduRover's speed loop from commanded speed to throttle, and its parameters.

Source: ArduRover 4.6.3 (tag Rover-4.6.3):

- `Rover/mode.cpp` calc_throttle calls `AR_AttitudeControl::get_throttle_out_speed` in every main loop: the
  desired speed changes by at most ATC_ACCEL_MAX (ATC_DECEL_MAX when slowing down, if that is set), then
  AC_PID on (desired, EKF forward speed) plus ATC_SPEED_FF, plus the base throttle desired * CRUISE_THROTTLE /
  CRUISE_SPEED. Below zero the output brakes or reverses if ATC_BRAKE is 1, else it is 0.
- `libraries/AR_Motors/AP_MotorsUGV.cpp` slew_limit_throttle: the throttle changes by at most MOT_SLEWRATE
  %/s; get_scaled_throttle: MOT_THR_MIN + (100 - MOT_THR_MIN)/100 * throttle, so a dead zone is left out;
  then +-MOT_THR_MAX. The limit flags stop the integrator from growing.
- `libraries/SRV_Channel`: 100 % is SERVOn_MAX, 0 SERVOn_TRIM, straight between.
- CRUISE_THROTTLE is a whole number. CRUISE_SPEED is also the speed of missions unless WP_SPEED is set.
- Defaults: AR_ATTCONTROL_THR_* in AR_AttitudeControl.cpp. The error filter is ATC_SPEED_FLTE, 10 Hz.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from rover_sweep.data.recording import Array
from rover_sweep.gains.steering_chain import Gains

Throttle = TypeVar("Throttle", float, Array)

SPEED_DEFAULTS: Mapping[str, float] = {
    "CRUISE_SPEED": 2.0,
    "CRUISE_THROTTLE": 50.0,
    "ATC_SPEED_P": 0.2,
    "ATC_SPEED_I": 0.2,
    "ATC_SPEED_D": 0.0,
    "ATC_SPEED_IMAX": 1.0,
    "ATC_SPEED_FF": 0.0,
    "ATC_SPEED_FLTT": 0.0,
    "ATC_SPEED_FLTE": 10.0,
    "ATC_SPEED_FLTD": 0.0,
    "ATC_SPEED_D_FF": 0.0,
    "ATC_ACCEL_MAX": 1.0,
    "ATC_DECEL_MAX": 0.0,
    "ATC_BRAKE": 1.0,
    "MOT_THR_MIN": 0.0,
    "MOT_THR_MAX": 100.0,
    "MOT_SLEWRATE": 100.0,
    "MOT_THST_EXPO": 0.0,
    "SCHED_LOOP_RATE": 50.0,
}
"""Defaults of ArduRover 4.6.3."""


@dataclass(frozen=True)
class SpeedSettings:
    """What is proposed. cruise_speed [m/s], cruise_throttle [%]; p, d, i: of the speed PID, to a throttle of
    -1..1; accel_max [m/s^2], 0 for no limit."""

    cruise_speed: float
    cruise_throttle: float
    p: float
    i: float
    d: float
    accel_max: float

    @property
    def parameters(self) -> dict[str, float]:
        """By the firmware's parameter names."""
        return {
            "CRUISE_SPEED": self.cruise_speed,
            "CRUISE_THROTTLE": self.cruise_throttle,
            "ATC_SPEED_P": self.p,
            "ATC_SPEED_I": self.i,
            "ATC_SPEED_D": self.d,
            "ATC_ACCEL_MAX": self.accel_max,
        }


@dataclass(frozen=True)
class SpeedLoop:
    """The loop around the speed controller. filters: low-passes and IMAX in `Gains`; loop_hz: main loop.

    decel_max [m/s^2], 0 for accel_max; brakes: ATC_BRAKE; least, most: MOT_THR_MIN, MOT_THR_MAX as shares;
    slew: of the throttle [1/s], 0 for none. assumed: parameters that were not given.
    """

    now: SpeedSettings
    filters: Gains
    loop_hz: float
    decel_max: float = 0.0
    brakes: bool = True
    least: float = 0.0
    most: float = 1.0
    slew: float = 1.0
    assumed: tuple[str, ...] = ()
    not_modelled: Mapping[str, float] = field(default_factory=dict)

    @property
    def period(self) -> float:
        """Period of the main loop, s."""
        return 1.0 / self.loop_hz

    def at_motor(self, throttle: Throttle) -> Throttle:
        """Throttle at the motor, a share, for a positive throttle (or an array) of the controller."""
        return self.least + (1.0 - self.least) * throttle

    def from_motor(self, throttle: float) -> float:
        """Throttle of the controller for one at the motor."""
        return (throttle - self.least) / (1.0 - self.least)

    def base(self, settings: SpeedSettings) -> float:
        """Throttle per speed [1/(m/s)] without feedback."""
        if settings.cruise_speed <= 0 or settings.cruise_throttle <= 0:
            return self.filters.ff
        return self.filters.ff + settings.cruise_throttle / 100 / settings.cruise_speed


def speed_loop(parameters: Mapping[str, float], assumed: Mapping[str, float] | None = None) -> SpeedLoop:
    """The loop from the autopilot's parameters by name. assumed: values to use before the defaults.

    Raises ValueError for an impossible loop rate or throttle range.
    """
    filled = {n: float(f"{v:.7g}") for n, v in {**SPEED_DEFAULTS, **(assumed or {}), **parameters}.items()}
    if not (filled["SCHED_LOOP_RATE"] > 0 and 0 <= filled["MOT_THR_MIN"] < filled["MOT_THR_MAX"] <= 100):
        raise ValueError(
            f"SCHED_LOOP_RATE {filled['SCHED_LOOP_RATE']:g} Hz, MOT_THR_MIN {filled['MOT_THR_MIN']:g} and "
            f"MOT_THR_MAX {filled['MOT_THR_MAX']:g} % are not possible; check these parameters"
        )
    pid = {k.removeprefix("ATC_SPEED_"): v for k, v in filled.items() if k.startswith("ATC_SPEED_")}
    now = SpeedSettings(
        filled["CRUISE_SPEED"],
        filled["CRUISE_THROTTLE"],
        pid["P"],
        pid["I"],
        pid["D"],
        filled["ATC_ACCEL_MAX"],
    )
    filters = Gains(pid["FF"], 0.0, 0.0, 0.0, pid["IMAX"], pid["FLTT"], pid["FLTE"], pid["FLTD"], pid["D_FF"])
    return SpeedLoop(
        now,
        filters,
        filled["SCHED_LOOP_RATE"],
        max(filled["ATC_DECEL_MAX"], 0.0),
        bool(filled["ATC_BRAKE"]),
        filled["MOT_THR_MIN"] / 100,
        filled["MOT_THR_MAX"] / 100,
        max(filled["MOT_SLEWRATE"], 0.0) / 100,
        tuple(name for name in SPEED_DEFAULTS if name not in parameters),
        {n: filled[n] for n in ("MOT_THST_EXPO", "ATC_SPEED_D_FF") if filled[n]},
    )
