"""The vehicle's own time for every message of a telemetry log, whatever the link did to the arrival times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.logs.tlog import Frames

Array = NDArray[np.float64]

CLOCKS = (
    "ATTITUDE",
    "RAW_IMU",
    "SCALED_IMU",
    "SCALED_IMU2",
    "HIGHRES_IMU",
    "LOCAL_POSITION_NED",
    "GLOBAL_POSITION_INT",
)
WRAP = 2.0**32 * 1e-6  # s after which SERVO_OUTPUT_RAW.time_usec starts again
REBOOT = 1.0  # s: a clock that falls by more has started again


@dataclass(frozen=True, eq=False)
class Session:
    """The vehicle's messages between two restarts, with a clock for those that carry no time."""

    messages: Mapping[str, Frames]
    clock_order: NDArray[np.int64]
    clock: Array

    def seconds(self, name: str) -> Array:
        """Vehicle time (n,) s of each message of a name; that of the message before, where it has none."""
        frames = self.messages[name]
        fields = frames.rows.dtype.names or ()
        if "time_boot_ms" in fields:
            return frames.rows["time_boot_ms"].astype(float) * 1e-3
        k = np.clip(np.searchsorted(self.clock_order, frames.order, "right") - 1, 0, None)
        before = self.clock[k]
        if "time_usec" not in fields:
            return before
        t = frames.rows["time_usec"].astype(float) * 1e-6
        return t + WRAP * np.round((before - t) / WRAP) if frames.rows["time_usec"].itemsize == 4 else t


def sessions(messages: Mapping[str, Frames]) -> Iterator[Session]:
    """The vehicle's messages, cut where its clock jumps back; none if no message carries its time."""
    clocks = [messages[n] for n in CLOCKS if n in messages]
    if not clocks:
        return
    order = np.concatenate([f.order for f in clocks])
    times = np.concatenate([_own_time(f) for f in clocks])
    sorting = np.argsort(order)
    order, times = order[sorting], times[sorting]
    cuts = np.flatnonzero(np.diff(times) < -REBOOT) + 1
    edges = [-1, *order[cuts].tolist(), int(np.iinfo(np.int64).max)]
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        inside = (order >= start) & (order < end)
        parts = {n: f.where((f.order >= start) & (f.order < end)) for n, f in messages.items()}
        yield Session({n: f for n, f in parts.items() if len(f)}, order[inside], times[inside])


def _own_time(frames: Frames) -> Array:
    if "time_boot_ms" in (frames.rows.dtype.names or ()):
        return frames.rows["time_boot_ms"].astype(float) * 1e-3
    return frames.rows["time_usec"].astype(float) * 1e-6
