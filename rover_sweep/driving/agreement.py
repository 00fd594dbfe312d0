"""Whether the numbers of several logs are of one rover that did not change between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from rover_sweep.data.results import ByName, Quantity

CHANCE = 0.001  # of numbers that are said to disagree and do not
HALF_90 = 1.645  # standard deviations in half a 90 % interval
ALIKE = 1.2  # ratio of speeds up to which response times are compared


class Matters(NamedTuple):
    """The smallest difference of a number that is said: in its unit, and as a share of it."""

    least: float
    share: float


COMPARED = {
    "straight": Matters(0.0, 0.0),  # see LEAST_STRAIGHT
    "curvature": Matters(0.0, 0.05),
    "wheelbase_seen": Matters(0.0, 0.05),
    "response_time": Matters(0.02, 0.1),
}
LEAST_STRAIGHT = {"us": 5.0, "rad": 0.005}


def disagreeing(logs: Sequence[tuple[ByName[Quantity], float]]) -> tuple[str, ...]:
    """Names of the numbers that differ between the logs by more than their intervals, and by what matters.

    logs: the numbers of each, and the speed of its turns [m/s], on which the response time depends. Of a
    number in k logs, the squared differences from the weighted mean in standard deviations add up to chi
    squared with k - 1 degrees of freedom.
    """
    found = []
    speeds = [speed for _, speed in logs]
    alike = max(speeds, default=0.0) < ALIKE * min(speeds, default=0.0)
    for name, matters in COMPARED.items():
        known = [numbers[name] for numbers, _ in logs if name in numbers]
        ends = [q.interval_90 or (-np.inf, np.inf) for q in known]
        if len(known) < 2 or (name == "response_time" and not alike):
            continue
        value = np.array([q.value for q in known])
        weight = np.square(2 * HALF_90 / np.maximum(np.diff(ends)[:, 0], 1e-9))
        mean = float(weight @ value / weight.sum())
        squares = float(weight @ np.square(value - mean))
        least = LEAST_STRAIGHT[known[0].unit] if name == "straight" else matters.least
        if np.ptp(value) > least + matters.share * abs(mean) and chi2.sf(squares, len(known) - 1) < CHANCE:
            found.append(name)
    return tuple(found)
