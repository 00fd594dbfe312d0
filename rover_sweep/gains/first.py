"""A first FF from any driving, such as MANUAL, in which the steering rate controller did not run.

FF holds a steady turn: r = V g x u gives 1 / (V g x), with the curvature g of the path for each us (1/m), the
us x of the servo from trim to a stop, and the share u of it that the controller puts out after the firmware's
scaling with speed (MOT_SPD_SCA_BASE, `steering_chain`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rover_sweep.data.results import Quantity
from rover_sweep.driving.answer import DrivingAnswer
from rover_sweep.gains.steering_chain import SERVO_DEFAULTS, Autopilot
from rover_sweep.gains.tuning import bound


@dataclass(frozen=True)
class FirstFeedForward:
    """ATC_STR_RAT_FF with its 90 % interval, at the median speed [m/s] of the turns.

    name: of the log; why: the controller could not be checked; level: of the driving, "good" or "rough".
    now: the present FF. reversed_servo: SERVOn_REVERSED if the rover turns to the other side of the servo's
    output, else "". assumed: parameters that the log lacks, at the firmware's defaults.
    """

    name: str
    why: str
    level: str
    speed: float
    value: float
    low: float
    high: float
    now: float
    reversed_servo: str = ""
    assumed: tuple[str, ...] = ()

    @property
    def next(self) -> float:
        """FF to set now: no gain is raised by more than `tuning.MOST_CHANGE` at once."""
        return float(f"{min(self.value, bound('ATC_STR_RAT_FF', self.now)):.3g}")

    @property
    def fits(self) -> bool:
        """Whether the present FF is within the interval."""
        return self.low <= self.now <= self.high


def first_feed_forward(
    answer: DrivingAnswer, loop: Autopilot, name: str, why: str
) -> FirstFeedForward | None:
    """The first FF; None where the driving shows no curvature for each us, or not well enough.

    answer: of a log of this rover, with its parameters in `loop`.
    """
    if answer.fit is None or "curvature" not in answer.numbers:
        return None
    found: Quantity = answer.numbers["curvature"]
    low, high = found.interval_90 or (0.0, math.inf)
    speed = answer.speeds[1]
    if not (low > 0 and math.isfinite(high)):
        return None
    travel = 0.5 * (loop.us_right + loop.us_left) / 100.0  # of the curvature's 100 us
    per_curvature = 1.0 / (speed * travel * loop.speed_scale(speed))
    ends = [per_curvature / curvature for curvature in (found.value, high, low)]
    right_for_more = answer.fit["gain"] < 0  # a larger output; the yaw rate is positive to the left
    reversed_servo = "" if right_for_more != loop.reversed else f"SERVO{loop.servo}_REVERSED"
    needed = ("ATC_STR_RAT_FF", "MOT_SPD_SCA_BASE", *(f"SERVO{loop.servo}_{key}" for key in SERVO_DEFAULTS))
    assumed = tuple(name for name in needed if name in loop.assumed)
    return FirstFeedForward(
        name, why, answer.level, speed, ends[0], ends[1], ends[2], loop.gains.ff, reversed_servo, assumed
    )
