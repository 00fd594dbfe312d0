"""ATC_STR_RAT_MAX and ATC_TURN_MAX_G from the steering results: what the stops reach, what the runs
confirm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.gains.proposal import Proposal
from rover_sweep.gains.tuning import bound

REACH = 0.9  # share of the turn rate at the stops: the rest is left for feedback


@dataclass(frozen=True)
class SteeringLimits:
    """rate_max: ATC_STR_RAT_MAX [deg/s], from the turn rate at the stops; turn_g: ATC_TURN_MAX_G [g], the
    largest lateral acceleration that the runs confirm, at most that at the stops; None if
    unknown. Neither is raised beyond `tuning.bound` at once. now_g: the current one."""

    rate_max: float
    turn_g: float | None
    reach: float
    confirmed_g: float | None
    now_g: float

    @property
    def lowers(self) -> bool:
        """Whether turn_g is below the current value: a lack of evidence, which lowers nothing by itself."""
        return self.turn_g is not None and self.turn_g < self.now_g


def steering_limits(proposal: Proposal) -> SteeringLimits | None:
    """The limits at the design speed; None without a proposal of gains."""
    found, loop, speed = proposal.found, proposal.autopilot, proposal.speed
    if proposal.proposed is None or proposal.steady_gain is None or found.rad_per_us is None:
        return None
    travel = min(loop.us_right, loop.us_left)
    per_us = abs(proposal.steady_gain * found.rad_per_us)
    reach = per_us * travel
    confirmed = None
    if found.largest_us is not None:
        confirmed = per_us * min(found.largest_us, travel) * speed / STANDARD_GRAVITY
    most_g = REACH * reach * speed / STANDARD_GRAVITY
    largest_g = bound("ATC_TURN_MAX_G", loop.lateral_g_max)
    turn_g = (
        None if confirmed is None else max(math.floor(100 * min(confirmed, most_g, largest_g)) / 100, 0.1)
    )
    rate = math.floor(math.degrees(REACH * reach))
    if loop.rate_max > 0:  # 0 is no limit
        rate = min(rate, math.floor(bound("ATC_STR_RAT_MAX", math.degrees(loop.rate_max))))
    return SteeringLimits(rate, turn_g, math.degrees(reach), confirmed, loop.lateral_g_max)
