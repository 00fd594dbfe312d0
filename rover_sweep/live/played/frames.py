"""Where the frames of a telemetry log lie, in the file and in time: made once, so that jumps are cheap."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_sweep.errors import DataRefused
from rover_sweep.logs.readers.tlog import MAGIC_2, SIGNED, Frames, parse_tlog, walk
from rover_sweep.logs.readers.vehicle_clock import CLOCKS, BootMessages, sessions
from rover_sweep.vehicle.link.mavlink import message_id

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

ARDUPILOT = 3  # MAV_AUTOPILOT
WANTED = frozenset(("HEARTBEAT", "NAMED_VALUE_FLOAT", "PARAM_VALUE", "SERVO_OUTPUT_RAW", *CLOCKS))


@dataclass(frozen=True, eq=False)
class FrameIndex:
    """The frames of one vehicle in a telemetry log, in the order in which they came.

    starts (n,): byte offsets; kinds (n,): message ids; t (n,): s of the vehicle's clock when each came, as
    a link that is live has it; at (n,): position, s from the first frame, on which a restart of the
    vehicle takes no time; start (n,): which start of the vehicle, from 0.
    """

    data: bytes
    starts: Numbers
    kinds: Numbers
    t: Array
    at: Array
    start: Numbers
    sessions: tuple[BootMessages, ...]

    @property
    def length(self) -> float:
        return float(self.at[-1])

    def bytes_of(self, k: int) -> bytes:
        """The whole frame."""
        a, data = int(self.starts[k]), self.data
        if data[a] == MAGIC_2:
            return data[a : a + 12 + data[a + 1] + (13 if data[a + 2] & SIGNED else 0)]
        return data[a : a + 8 + data[a + 1]]

    def before(self, at: float) -> int:
        """How many frames have come up to a position, that one included."""
        return int(np.searchsorted(self.at, at, "right"))

    def position(self, start: int, t: float) -> float:
        """Position of a time on the vehicle's clock [s] after its start number `start`."""
        first = int(np.searchsorted(self.start, start))
        return float(self.at[first] + t - self.t[first])

    def of(self, *names: str) -> NDArray[np.bool_]:
        """Which frames are of these kinds (n,)."""
        return np.isin(self.kinds, [message_id(name) for name in names])


def frame_index(path: Path) -> FrameIndex:
    """Index a telemetry log. DataRefused where no frame of an ArduPilot vehicle carries its time."""
    data = path.read_bytes()
    parsed = parse_tlog(data, WANTED)
    system, component = _vehicle(path, parsed.messages)
    own = {
        name: found
        for name, frames in parsed.messages.items()
        if len(found := frames.where((frames.system == system) & (frames.component == component)))
    }
    starts_of_vehicle = tuple(sessions(own))
    if not starts_of_vehicle:
        raise DataRefused(f"{path.name} holds no ATTITUDE or IMU messages, so there is no time to play it by")
    starts, kinds = _frames(data, system, component)
    t, at, number = _times(starts, starts_of_vehicle)
    return FrameIndex(data, starts, kinds, t, at, number, starts_of_vehicle)


def _vehicle(path: Path, messages: dict[str, Frames]) -> tuple[int, int]:
    """System and component that most of the heartbeats of ArduPilot come from."""
    hearts = messages.get("HEARTBEAT")
    if hearts is None or not np.any(hearts.rows["autopilot"] == ARDUPILOT):
        raise DataRefused(f"{path.name} holds no heartbeat of an ArduPilot vehicle")
    hearts = hearts.where(hearts.rows["autopilot"] == ARDUPILOT)
    system = int(np.bincount(hearts.system).argmax())
    return system, int(np.bincount(hearts.component[hearts.system == system]).argmax())


def _frames(data: bytes, system: int, component: int) -> tuple[Numbers, Numbers]:
    """Offsets and message ids of the vehicle's frames, in the order of the file."""
    found = walk(data).starts
    starts = np.concatenate([np.array(offsets, np.int64) for offsets in found.values()])
    kinds = np.concatenate([np.full(len(offsets), kind, np.int64) for kind, offsets in found.items()])
    order = np.argsort(starts)
    starts, kinds = starts[order], kinds[order]
    raw = np.frombuffer(data, np.uint8)
    new = raw[starts] == MAGIC_2
    sender = np.where(new, 5, 3)
    own = (raw[starts + sender] == system) & (raw[starts + sender + 1] == component)
    return starts[own], kinds[own]


def _times(starts: Numbers, found: tuple[BootMessages, ...]) -> tuple[Array, Array, Numbers]:
    """(vehicle's clock [s], position [s], number of the start) of each frame (n,)."""
    begins = np.array([session.clock_order[0] for session in found])
    number = np.clip(np.searchsorted(begins, starts, "right") - 1, 0, None)
    t, at = np.empty(starts.size), np.empty(starts.size)
    offset = 0.0
    for k, session in enumerate(found):
        inside = number == k
        before = np.searchsorted(session.clock_order, starts[inside], "right") - 1
        t[inside] = session.clock[np.clip(before, 0, None)]
        at[inside] = offset + t[inside] - session.clock[0]
        offset += float(session.clock[-1] - session.clock[0])
    return t, at, number
