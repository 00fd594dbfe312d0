"""Plays a DataFlash log: the state at any time, as the vehicle's telemetry would have shown it.

The signals come from `rover_sweep.logs`; the other values of a screen (armed, mode, battery, GPS, switch) are
read here. Message names and units: ArduPilot, libraries/AP_Logger/LogStructure.h, as seen in logs of
ArduRover 4.5.7 and 4.6.3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_params.applet_parameters import STATES
from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused
from rover_sweep.files.documents import printable
from rover_sweep.live.played_runs import RunSpan, runs_in
from rover_sweep.live.source import STALE, STALE_SLOW, Snapshot, Telemetry
from rover_sweep.logs.applet import is_old
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.dataflash import DataFlash, open_parts
from rover_sweep.logs.readers.dataflash_channels import logged_parameters
from rover_sweep.logs.readers.tlog import MAGIC_2, SIGNED, parse_tlog, walk
from rover_sweep.logs.readers.tlog_channels import messages_of_vehicle
from rover_sweep.logs.readers.vehicle_clock import CLOCKS, BootMessages, extent, sessions
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, configured_manoeuvre
from rover_sweep.vehicle.events import Event, Sample, StateChanged
from rover_sweep.vehicle.identity import has_position
from rover_sweep.vehicle.link.mavlink import Codec, kind, message_id
from rover_sweep.vehicle.link.statustext import Said, TextAssembler
from rover_sweep.vehicle.link.streams import StreamQuality, stream_quality
from rover_sweep.vehicle.preflight.rates import switch_of
from rover_sweep.vehicle.run.follow import Follower

SILENT = 0.5  # s without a message of the applet, which logs at 84 Hz while it does anything: it is idle
SAMPLE_EVERY = 0.1  # s
INFO = 6  # MAV_SEVERITY; the log does not tell the severity of a message
STEERED = range(3, 9)
FIX_3D = 3  # GPS_FIX_TYPE


class PlayedColumn:
    """The last value at or before a time, nan where there is none or it is older than `stale` s."""

    def __init__(self, t: Array, x: Array, stale: float) -> None:
        self.t, self.x, self.stale = t, x, stale

    def at(self, t: float) -> float:
        k = int(np.searchsorted(self.t, t, "right")) - 1
        return float(self.x[k]) if k >= 0 and t - self.t[k] <= self.stale else math.nan


class FlashPart:
    """One log of a file: everything at a time on its clock. begin, end: [s]."""

    def __init__(self, log: Log, flash: DataFlash) -> None:
        self.log = log
        self.begin, self.end = extent(log)
        self._flash = flash
        self._set = logged_parameters(flash)
        self._set_at = np.array([t for t, *_ in self._set])
        self._planned: dict[int, Manoeuvre | None] = {}
        self._columns = {n: PlayedColumn(s.t, s.x, STALE) for n, s in log.signals.items()}
        if log.steering:
            self._columns["pwm"] = PlayedColumn(log.steering[0].t, log.steering[0].x, STALE)
        switch = f"C{switch_of(log.parameters)}"
        for name, message, column, stale in (
            ("volts", "BAT", "Volt", STALE_SLOW),
            ("remaining", "BAT", "RemPct", STALE_SLOW),
            ("satellites", "GPS", "NSats", STALE_SLOW),
            ("fix", "GPS", "Status", STALE_SLOW),
            ("switch", "RCIN", switch, STALE),
            ("mode", "MODE", "ModeNum", math.inf),
            ("ekf", "XKF4", "SS", STALE_SLOW),  # nav_filter_status, whose bits are EKF_STATUS_FLAGS
        ):
            if flash.has(message, column):
                self._columns[name] = PlayedColumn(
                    flash.seconds(message), flash.column(message, column), stale
                )
        self._armed = self._arming()
        self.states = self._states()
        self._entered = np.array([t for t, _ in self.states])
        bytes_of = flash.positions("IMU")
        stamps = flash.seconds("IMU") if bytes_of.size else np.empty(0)
        self._bytes = PlayedColumn(stamps, bytes_of.astype(float), math.inf)

    def parameters(self, t: float) -> dict[str, float]:
        """Their values at a time: the last of each up to then."""
        count = int(np.searchsorted(self._set_at, t, "right"))
        return {name: value for _, name, value in self._set[:count]}

    def planned(self, t: float) -> Manoeuvre | None:
        """The manoeuvre configured in the parameters at a time [s]."""
        count = int(np.searchsorted(self._set_at, t, "right"))
        if count not in self._planned:
            self._planned[count] = configured_manoeuvre(self.parameters(t))
        return self._planned[count]

    def state(self, t: float) -> int:
        k = int(np.searchsorted(self._entered, t, "right")) - 1
        return self.states[k][1] if k >= 0 else 0

    def snapshot(self, t: float) -> Snapshot:
        state = self.state(t)
        progress, frequency = self._manoeuvre(t, state)
        remaining, fix = self._value("remaining", t), _whole(self._value("fix", t), 0)
        return Snapshot(
            t=t,
            armed=self._armed.at(t) == 1,
            mode=_whole(self._value("mode", t), -1),
            **{name: self._value(name, t) for name in ("pwm", "r", "p", "ay", "phi", "speed")},
            state=state,
            state_name=STATES.get(state, f"state {state}"),
            frequency=frequency,
            progress=progress,
            switch=self._value("switch", t),
            volts=self._value("volts", t),
            remaining=remaining / 100,
            satellites=_whole(self._value("satellites", t), 0),
            fix=fix,
            ekf=self._uses_gps(t, fix),
            recorded=_whole(self._bytes.at(t), 0),
            link="",
        )

    def events(self, since: float, to: float) -> Iterator[Event]:
        """What happens after `since` up to `to` [s], in time."""
        found: list[tuple[float, Event]] = [
            (t, Said(t, INFO, printable(text))) for t, text in self.log.marks if since < t <= to
        ]
        found += [
            (t, StateChanged(t, s, STATES.get(s, f"state {s}"))) for t, s in self.states if since < t <= to
        ]
        first = math.floor(since / SAMPLE_EVERY) + 1
        for k in range(first, math.floor(to / SAMPLE_EVERY) + 1):
            now = self.snapshot(k * SAMPLE_EVERY)
            found.append((now.t, Sample(now.t, now.state, now.pwm, now.r, now.ay, now.speed, now.frequency)))
        yield from (event for _, event in sorted(found, key=lambda entry: entry[0]))

    def _uses_gps(self, t: float, fix: int) -> bool:
        """As the estimator reports; a log without that (LOG_BITMASK) has a velocity if there is a fix."""
        if "ekf" in self._columns:
            return has_position(_whole(self._value("ekf", t), 0))
        return fix >= FIX_3D and math.isfinite(self._value("speed", t))

    def _arming(self) -> PlayedColumn:
        """1 armed, 0 not. Before its first entry the state is the opposite: a log opens on arming."""
        if not self._flash.has("ARM", "ArmState"):
            return PlayedColumn(np.empty(0), np.empty(0), math.inf)
        t, armed = self._flash.seconds("ARM"), self._flash.column("ARM", "ArmState")
        return PlayedColumn(np.append(-math.inf, t), np.append(1 - armed[0], armed), math.inf)

    def _value(self, name: str, t: float) -> float:
        return self._columns[name].at(t) if name in self._columns else math.nan

    def _states(self) -> tuple[tuple[float, int], ...]:
        """The changes of the applet's state; idle if it reports none. Empty for the applet of 2025."""
        rows = self.log.applet
        if rows is None or is_old(rows):
            return ()
        found: list[tuple[float, int]] = []
        silent = np.append(np.diff(rows.t) > SILENT, True)
        for t, state, last in zip(
            rows.t.tolist(), rows.state.astype(int).tolist(), silent.tolist(), strict=True
        ):
            if not found or found[-1][1] != state:
                found.append((t, state))
            if last and state and t + SILENT < self.end:
                found.append((t + SILENT, 0))
        return tuple(found)

    def _manoeuvre(self, t: float, state: int) -> tuple[float, float]:
        """(progress 0..1, frequency now [rad/s]) by the applet's clock."""
        rows = self.log.applet
        if rows is None or state == 0 or is_old(rows):
            return math.nan, math.nan
        planned = self.planned(t)
        if planned is None or state in (1, 2, 9):
            return {1: 0.0, 2: 0.0, 9: 1.0}.get(state, math.nan), math.nan
        clock = float(rows.clock[max(int(np.searchsorted(rows.t, t, "right")) - 1, 0)])
        progress = min(max(clock / planned.duration, 0.0), 1.0)
        if state not in STEERED or isinstance(planned, Doublet | Multisine):
            return progress, math.nan
        return progress, float(planned.rate(clock - planned.law_start))


def _whole(value: float, otherwise: int) -> int:
    return int(value) if math.isfinite(value) else otherwise


class FlashTrack:
    """The position in a DataFlash log that is played; a `played_track.Track`."""

    def __init__(self, path: Path) -> None:
        logs = read_logs(str(path))
        parts = [part for part in open_parts(path) if any(part.count(n) for n in part.formats if n != "FMT")]
        self._parts = [FlashPart(log, flash) for log, flash in zip(logs, parts, strict=True)]
        lengths = [part.end - part.begin for part in self._parts]
        self._offsets = np.concatenate(([0.0], np.cumsum(lengths)))
        self.length, self.log, self._at = float(self._offsets[-1]), logs[0], 0.0
        places: list[RunSpan] = []
        remarks: list[str] = []
        for part, offset in zip(self._parts, self._offsets.tolist(), strict=False):
            runs, refusal = runs_in(part.log, path, part.states, part.parameters)
            start, from_applet = offset - part.begin, bool(part.states)
            places += [RunSpan(run, start + run.begin, start + run.end, from_applet) for run in runs]
            remarks += [refusal] if refusal else []
        self.places, self.remarks = tuple(places), tuple(remarks)

    def seek(self, at: float) -> None:
        """Go to a position [s]."""
        self._at = at

    def play(self, at: float) -> Iterator[Event]:
        """Go on to a position [s], with what happens on the way."""
        for part, offset in zip(self._parts, self._offsets.tolist(), strict=False):
            since, to = self._at - offset + part.begin, at - offset + part.begin
            if to > part.begin and since < part.end:
                yield from part.events(since, min(to, part.end))
        self._at = max(at, self._at)

    def snapshot(self) -> Snapshot:
        """The rover at the position."""
        k = min(max(int(np.searchsorted(self._offsets, self._at, "right")) - 1, 0), len(self._parts) - 1)
        part = self._parts[k]
        return part.snapshot(min(self._at - float(self._offsets[k]) + part.begin, part.end))


# Where the frames of a telemetry log lie, in the file and in time: made once, so that jumps are cheap.


Numbers = NDArray[np.int64]

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
        """Number of frames up to and including a position."""
        return int(np.searchsorted(self.at, at, "right"))

    def position(self, start: int, t: float) -> float:
        """Position of a time on the vehicle's clock [s] after its start number `start`."""
        first = int(np.searchsorted(self.start, start))
        return float(self.at[first] + t - self.t[first])

    def of(self, *names: str) -> NDArray[np.bool_]:
        """Which frames are of these kinds (n,)."""
        return np.isin(self.kinds, [message_id(name) for name in names])


def frame_index(path: Path) -> FrameIndex:
    """Index a telemetry log. DataRefused if no ArduPilot frame carries its time."""
    data = path.read_bytes()
    _, own, _ = messages_of_vehicle(path, parse_tlog(data, WANTED))
    starts_of_vehicle = tuple(sessions(own))
    if not starts_of_vehicle:
        raise DataRefused(f"{path.name} holds no ATTITUDE or IMU messages, so there is no time to play it by")
    hearts = own["HEARTBEAT"]
    starts, kinds = _frames(data, int(hearts.system[0]), int(hearts.component[0]))
    t, at, number = _times(starts, starts_of_vehicle)
    return FrameIndex(data, starts, kinds, t, at, number, starts_of_vehicle)


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


# Plays a telemetry log: its frames go through the same code as those of a vehicle on a link.


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
    """The position in a telemetry log that is played.

    length [s]; places: its runs and the positions [s from the start] where each begins and ends;
    remarks: sentences on the recording; log: of the first start of the vehicle. Raises
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
        """Go to a position [s]; the state is as after playing up to it."""
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
        """The runs after start `k` of the vehicle, with positions; the reason if there are none."""
        session, index = self.index.sessions[k], self.index
        states = tuple((float(index.t[j]), state) for j, state in self._changes if index.start[j] == k)

        def quality(a: float, b: float) -> tuple[StreamQuality, ...]:
            stamps = {n: session.seconds(n) for n in JUDGED if n in session.messages}
            return tuple(stream_quality(n, t[(t >= a) & (t <= b)].tolist()) for n, t in stamps.items())

        runs, refusal = runs_in(log, path, states, session.parameters, quality)
        places = (
            RunSpan(run, index.position(k, run.begin), index.position(k, run.end), bool(states))
            for run in runs
        )
        return tuple(places), refusal


def _changes(index: FrameIndex) -> tuple[tuple[int, int], ...]:
    """(frame, state) where the applet's state changes, or is the first after a start."""
    found = []
    for session in index.sessions:
        if (frames := session.messages.get("NAMED_VALUE_FLOAT")) is not None:
            mine = frames.rows["name"] == b"SWP_ST"
            state, order = frames.rows["value"][mine].astype(int), frames.order[mine]
            first = np.flatnonzero(np.diff(state, prepend=-1))
            frame = np.searchsorted(index.starts, order[first])
            found += list(zip(frame.tolist(), state[first].tolist(), strict=True))
    return tuple(found)
