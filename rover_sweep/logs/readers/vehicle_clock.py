"""The vehicle's time for every message of a telemetry log, independent of the times of arrival."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.logs.readers.tlog import Frames

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
REBOOT = 1.0  # s; a clock that falls by more has restarted
CONFIRMING = 5  # messages that must confirm a restart
REPEATED = 1 << 18  # bytes of a .tlog, within which an identical frame is a repetition


@dataclass(frozen=True, eq=False)
class BootMessages:
    """The vehicle's messages between two restarts, with a clock for messages without time.

    clock (n,) [s] at positions clock_order (n,) [bytes] of the file.
    """

    messages: Mapping[str, Frames]
    clock_order: NDArray[np.int64]
    clock: Array

    def seconds(self, name: str) -> Array:
        """Vehicle time (n,) [s] of each message of a name; without a time, that of the previous message."""
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


def sessions(messages: Mapping[str, Frames]) -> Iterator[BootMessages]:
    """The vehicle's messages, split where its clock restarts; empty if no message has a time.

    Repeated frames are removed, and frames that arrived in a wrong order are sorted.
    """
    single = {name: _without_repeats(frames) for name, frames in messages.items()}
    clocks = [single[n] for n in CLOCKS if n in single]
    if not clocks:
        return
    order = np.concatenate([f.order for f in clocks])
    times = np.concatenate([_own_time(f) for f in clocks])
    sorting = np.argsort(order)
    order, times = order[sorting], times[sorting]
    edges = [-1, *order[_restarts(times)].tolist(), int(np.iinfo(np.int64).max)]
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        inside = (order >= start) & (order < end)
        parts = {n: f.where((f.order >= start) & (f.order < end)) for n, f in single.items()}
        clock = np.maximum.accumulate(times[inside])  # a late message does not move it back
        session = BootMessages({n: f for n, f in parts.items() if len(f)}, order[inside], clock)
        yield replace(session, messages={n: _in_order(session, n) for n in session.messages})


def _restarts(times: Array) -> NDArray[np.int64]:
    """Indices (k,) at which stamps (n,) [s] fall by more than `REBOOT` and stay low.

    A message that the link delayed is low alone, among newer ones.
    """
    falls = np.flatnonzero(np.diff(times) < -REBOOT) + 1
    stays = [k for k in falls if np.max(times[k : k + CONFIRMING]) < times[k - 1] - REBOOT]
    return np.array(stays, np.int64)


def _in_order(session: BootMessages, name: str) -> Frames:
    frames = session.messages[name]
    return frames.where(np.argsort(session.seconds(name), kind="stable"))


def _without_repeats(frames: Frames) -> Frames:
    """Without frames that repeat an earlier one in content and sequence number, as links do."""
    heads = np.stack((frames.system, frames.component, frames.sequence), axis=1)
    bodies = np.ascontiguousarray(frames.rows).view(np.uint8).reshape(len(frames), -1)
    whole = np.concatenate((heads, bodies), axis=1)
    keys: list[bytes] = whole.view(f"V{whole.shape[1]}")[:, 0].tolist()
    if len(set(keys)) == len(keys):
        return frames
    seen: dict[bytes, int] = {}
    keep = np.ones(len(frames), bool)
    for k, (key, at) in enumerate(zip(keys, frames.order.tolist(), strict=True)):
        keep[k] = at - seen.get(key, -REPEATED) >= REPEATED
        seen[key] = at
    return frames.where(keep)


def _own_time(frames: Frames) -> Array:
    if "time_boot_ms" in (frames.rows.dtype.names or ()):
        return frames.rows["time_boot_ms"].astype(float) * 1e-3
    return frames.rows["time_usec"].astype(float) * 1e-6
