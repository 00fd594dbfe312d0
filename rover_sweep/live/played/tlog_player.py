"""Plays a telemetry log: its frames go through the same code as those of a vehicle on a link."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rover_sweep.files.printable import printable
from rover_sweep.live.played.frames import FrameIndex, frame_index
from rover_sweep.live.played.runs import RunSpan, runs_in
from rover_sweep.live.snapshot import Snapshot
from rover_sweep.live.telemetry import STALE_SLOW, Telemetry
from rover_sweep.logs.log import Log, finite_only
from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.vehicle_clock import BootMessages
from rover_sweep.vehicle.events import Event
from rover_sweep.vehicle.link.mavlink import Codec, kind
from rover_sweep.vehicle.link.statustext import TextAssembler
from rover_sweep.vehicle.link.streams import StreamQuality, stream_quality
from rover_sweep.vehicle.run.follow import Follower

JUDGED = ("ATTITUDE", "RAW_IMU", "SERVO_OUTPUT_RAW")
READ = (
    "HEARTBEAT",
    "ATTITUDE",
    "RAW_IMU",
    "LOCAL_POSITION_NED",
    "SERVO_OUTPUT_RAW",
    "RC_CHANNELS",
    "SYS_STATUS",
    "GPS_RAW_INT",
    "EKF_STATUS_REPORT",
    "NAMED_VALUE_FLOAT",
    "PARAM_VALUE",
    "STATUSTEXT",
)


class TlogTrack:
    """Where a telemetry log stands while it is played.

    length [s]; places: its runs and the positions [s from the start] where each begins and ends;
    remarks: what has to be said of the recording; log: of the first start of the vehicle. Raises
    DataRefused as `logs.read` does.
    """

    def __init__(self, path: Path) -> None:
        logs = read_logs(str(path))
        self.index = frame_index(path)
        self.length, self.log = self.index.length, logs[0]
        self._read = self.index.of(*READ)
        self._codec, self._next = Codec(), 0
        self._changes = _changes(self.index)
        found = [self._runs(path, k, log) for k, log in enumerate(logs)]
        self.places = tuple(place for places, _ in found for place in places)
        self.remarks = tuple(refusal for _, refusal in found if refusal)
        self.seek(0.0)

    def seek(self, at: float) -> None:
        """Go to a position [s]; what would be known there after playing up to it is known."""
        self._telemetry, self._follower, self._assembler = Telemetry(), Follower(), TextAssembler()
        k = self.index.before(at)
        now = self.index.t[k - 1] if k else self.index.t[0]
        lately = self.index.t[:k] >= now - STALE_SLOW - 1.0
        lately &= self.index.start[:k] == self.index.start[max(k - 1, 0)]
        needed = lately | self.index.of("PARAM_VALUE")[:k]
        needed[[j for j, _ in self._changes if j < k]] = True
        needed[np.flatnonzero(self.index.of("HEARTBEAT")[:k])[-1:]] = True
        for j in np.flatnonzero(needed).tolist():
            self._take(j)
        list(self._follower.take())
        self._next = k

    def play(self, at: float) -> Iterator[Event]:
        """Go on to a position [s], with what happens on the way."""
        for j in range(self._next, self.index.before(at)):
            self._next = j + 1
            self._take(j)
            yield from self._follower.take()

    def snapshot(self) -> Snapshot:
        """The rover at the position."""
        recorded = int(self.index.starts[self._next - 1]) if self._next else 0
        return self._telemetry.snapshot(recorded)

    def _take(self, j: int) -> None:
        t = float(self.index.t[j])
        message = self._codec.decode(self.index.bytes_of(j)) if self._read[j] else None
        if message is None:
            self._telemetry.heard(t)
            return
        self._telemetry.message(message, t)
        self._follower.steering = self._telemetry.steering
        self._follower.message(message, t)
        if kind(message) == "STATUSTEXT":
            for text in self._assembler.add(message, t):
                self._follower.text(text)

    def _runs(self, path: Path, k: int, log: Log) -> tuple[tuple[RunSpan, ...], str]:
        """Of start number `k` of the vehicle: runs with their positions, and why there are none."""
        session, index = self.index.sessions[k], self.index
        states = tuple((float(index.t[j]), state) for j, state in self._changes if index.start[j] == k)

        def quality(a: float, b: float) -> tuple[StreamQuality, ...]:
            stamps = {n: session.seconds(n) for n in JUDGED if n in session.messages}
            return tuple(stream_quality(n, t[(t >= a) & (t <= b)].tolist()) for n, t in stamps.items())

        runs, refusal = runs_in(log, path, states, lambda t: _parameters(session, t), quality)
        places = (
            RunSpan(run, index.position(k, run.begin), index.position(k, run.end), bool(states))
            for run in runs
        )
        return tuple(places), refusal


def _changes(index: FrameIndex) -> tuple[tuple[int, int], ...]:
    """(frame, state) wherever the applet tells another state than before, or the first after a start."""
    found = []
    for session in index.sessions:
        if (frames := session.messages.get("NAMED_VALUE_FLOAT")) is not None:
            mine = frames.rows["name"] == b"SWP_ST"
            state, order = frames.rows["value"][mine].astype(int), frames.order[mine]
            first = np.flatnonzero(np.diff(state, prepend=-1))
            frame = np.searchsorted(index.starts, order[first])
            found += list(zip(frame.tolist(), state[first].tolist(), strict=True))
    return tuple(found)


def _parameters(session: BootMessages, until: float) -> dict[str, float]:
    """Those that were heard up to a time on the vehicle's clock [s]."""
    if (frames := session.messages.get("PARAM_VALUE")) is None:
        return {}
    rows = frames.rows[session.seconds("PARAM_VALUE") <= until]
    names = [printable(name.decode("ascii", "replace")) for name in rows["param_id"].tolist()]
    return finite_only(zip(names, rows["param_value"].astype(float).tolist(), strict=True))
