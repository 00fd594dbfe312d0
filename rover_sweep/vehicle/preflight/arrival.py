"""The two clocks of a .tlog compared: arrival at this computer, and the vehicle's clock in the messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rover_sweep.logs.readers.tlog import STAMP, parse_tlog
from rover_sweep.vehicle.preflight.clock_comparison import estimate
from rover_sweep.vehicle.preflight.observed import ClockComparison

_MADE = "ATTITUDE"  # in milliseconds since boot; the most frequent message whose time does not wrap


def arrival_clock(tlog: Path, span: tuple[float, float]) -> ClockComparison | None:
    """Compare the clocks over `span` (start, end) [s of the vehicle's clock]; None if too few messages.

    The offset is this computer's UTC [s since 1970] minus the vehicle's time since boot [s].
    """
    data = tlog.read_bytes()
    frames = parse_tlog(data, frozenset({_MADE})).messages.get(_MADE)
    if frames is None:
        return None
    made = frames.rows["time_boot_ms"].astype(float) * 1e-3
    stamps = np.frombuffer(data, np.uint8)[(frames.order - STAMP)[:, None] + np.arange(STAMP)]
    came = stamps.view(">u8")[:, 0].astype(float) * 1e-6
    inside = (made >= span[0]) & (made <= span[1])
    return estimate(tuple(zip(made[inside].tolist(), came[inside].tolist(), strict=True)))
