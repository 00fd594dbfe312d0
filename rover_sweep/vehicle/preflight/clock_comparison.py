"""The vehicle's clock compared with ours: when messages were sent, and when they arrived."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan
from statistics import linear_regression, median

from rover_sweep.vehicle.link.clock import vehicle_seconds
from rover_sweep.vehicle.link.mavlink import Message, kind
from rover_sweep.vehicle.link.transport import Line
from rover_sweep.vehicle.preflight.observed import ClockComparison

_LEAST = 20  # messages


@dataclass
class ClockMonitor:
    """A listener of a link on `line`. pairs: (vehicle's time, arrival) of each message [s]. behind_utc: this
    computer's UTC minus GPS time [s], NaN if unknown."""

    line: Line
    pairs: list[tuple[float, float]] = field(default_factory=list)
    behind_utc: float = nan

    def __call__(self, message: Message) -> None:
        seconds = vehicle_seconds(message)
        if seconds is not None:
            self.pairs.append((seconds, self.line.monotonic()))
        if kind(message) == "SYSTEM_TIME" and message.time_unix_usec:
            self.behind_utc = self.line.wall() - message.time_unix_usec * 1e-6


def estimate(pairs: Sequence[tuple[float, float]], behind_utc: float = nan) -> ClockComparison | None:
    """Rate, drift and jitter from (vehicle, arrival) pairs [s]; None if there are too few or no time passed.

    The slope of a line through all pairs gives the rate. A message is never early, so the earliest message of
    each half corrects the drift. Its bound comes from the median delay after the earliest message.
    """
    if len(pairs) < _LEAST or pairs[-1][0] <= pairs[0][0] or pairs[-1][1] <= pairs[0][1]:
        return None
    span = pairs[-1][0] - pairs[0][0]
    slope = linear_regression(*zip(*pairs, strict=True)).slope
    late = [arrival - slope * vehicle for vehicle, arrival in pairs]
    quickest, middle = min(late), len(late) // 2
    drift = slope - 1 + (min(late[middle:]) - min(late[:middle])) / (span / 2)
    return ClockComparison(
        span=span,
        rate=span / (pairs[-1][1] - pairs[0][1]),
        jitter=sorted(late)[int(0.95 * (len(late) - 1))] - quickest,
        drift=drift,
        bound=2 * (median(late) - quickest) / (span / 2),
        behind_utc=behind_utc,
        offset=min(arrival - vehicle for vehicle, arrival in pairs),
    )
