"""Checks with every message that the rover is at rest, disarmed, in MANUAL, with the throttle at rest."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isnan, nan

from rover_sweep.bench.steering_output import SteeringOutput
from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message, kind

MOVING = 0.5  # m/s; a GPS at rest shows up to about 0.2
FIX_3D = 3  # GPS_FIX_TYPE
MANUAL = 0  # custom_mode of Rover
ASTRAY = 12.0  # us that the output may differ from what was asked for


class NotAtStandstill(LinkError):
    """The steering must not move, and is released; the sentence says why."""


@dataclass
class Standstill:
    """A listener of the link. pwm: steering output [us]; speed [m/s]; throttle: stick [us]; NaN: unknown."""

    link: Link
    output: SteeringOutput
    pwm: float = nan
    speed: float = nan
    throttle: float = nan

    def __call__(self, message: Message) -> None:
        name = kind(message)
        if name == "SERVO_OUTPUT_RAW":
            self.pwm = float(getattr(message, f"servo{self.output.servo}_raw"))
        elif name == "RC_CHANNELS":
            self.throttle = float(getattr(message, f"chan{self.output.throttle_channel}_raw"))
        elif name == "GPS_RAW_INT":
            fixed = message.fix_type >= FIX_3D and message.vel != 65535
            self.speed = 0.01 * message.vel if fixed else nan
        elif name == "LOCAL_POSITION_NED":
            self.speed = hypot(message.vx, message.vy)

    @property
    def why_not(self) -> str:
        """Why the steering must not move, in a sentence; '' if it may."""
        if self.link.armed:
            return "the rover is armed; disarm it for the bench, so that its motor cannot turn"
        if self.link.mode != MANUAL:
            return f"the rover is not in MANUAL (mode {self.link.mode})"
        if self.speed > MOVING:
            return f"the rover moves ({self.speed:.1f} m/s); it must be at rest, front wheels off the ground"
        if isnan(self.pwm) or isnan(self.throttle):
            return "the rover does not send SERVO_OUTPUT_RAW and RC_CHANNELS; is the link too slow?"
        if self.throttle == 0:
            return "the rover has no radio; the pilot must be able to stop the bench with the mode switch"
        if abs(self.throttle - self.output.throttle_trim) > self.output.throttle_zone:
            return (
                f"the throttle stick is not at rest ({self.throttle:.0f} us, rest "
                f"{self.output.throttle_trim:.0f}); this program does not touch it, center it on the radio"
            )
        return ""

    def require(self) -> None:
        """NotAtStandstill if the steering must not move, or must stop."""
        if why := self.why_not:
            raise NotAtStandstill(why)
