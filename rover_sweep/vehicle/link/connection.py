"""A MAVLink connection to one vehicle: it records every byte before it decodes it.

There is no reader thread: any wait on the link pumps it. That keeps one flow of control (Ctrl-C arrives where
the stop path is), and TCP slows down a rover that is simulated faster than real time while nobody reads. If
nobody reads while the rover drives, the RC override lapses (RC_OVERRIDE_TIME, 3 s) and the applet stops.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, Self

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.link.inbox import Inbox, LinkQuality, RefusedHeartbeats
from rover_sweep.vehicle.link.mavlink import (
    SAFETY_ARMED,
    Codec,
    Message,
    SigningKey,
    is_autopilot,
    kind,
    make,
    sender,
    vehicle_type_name,
)
from rover_sweep.vehicle.link.recorded_transport import TlogWriter
from rover_sweep.vehicle.link.statustext import Said, TextAssembler, Unwatched, Watch
from rover_sweep.vehicle.link.transport import Line, Transport

# The vehicle's clock, and periodic actions on it.


_MICROSECONDS_OF_BOOT = frozenset({"RAW_IMU", "HIGHRES_IMU"})  # time_usec since boot in ArduPilot
_REWIND = 1.0  # s: a larger step back is a reboot, not messages out of order


def vehicle_seconds(message: Message) -> float | None:
    """The time since boot in a message [s]; None if it has none.

    Not for SERVO_OUTPUT_RAW: its 32-bit microseconds wrap after 71 minutes.
    """
    if kind(message) in _MICROSECONDS_OF_BOOT:
        return message.time_usec * 1e-6
    boot_ms = getattr(message, "time_boot_ms", None)
    return None if boot_ms is None else boot_ms * 1e-3


@dataclass
class VehicleClock:
    """now: latest time since boot [s]; known: whether there is one; boots: number of reboots.

    A reboot is two messages in a row with an earlier time; a single one is a late message.
    """

    now: float = 0.0
    known: bool = False
    boots: int = 0
    _earlier: float | None = None

    def update(self, message: Message) -> None:
        seconds = vehicle_seconds(message)
        if seconds is None:
            return
        if self.known and seconds < self.now - _REWIND:
            self._went_back(seconds)
            return
        self.now, self.known, self._earlier = max(self.now, seconds), True, None

    def _went_back(self, seconds: float) -> None:
        if self._earlier is None or seconds < self._earlier:
            self._earlier = seconds
            return
        self.boots, self.now, self._earlier = self.boots + 1, seconds, None


@dataclass
class Periodic:
    """An action every `interval` s of the vehicle's clock or of ours, whichever is faster.

    The vehicle's clock serves a rover that is simulated faster than real time. Ours keeps the heartbeat going
    while the vehicle sends no time.
    """

    interval: float
    action: Callable[[], None]
    _vehicle: float = field(default=float("-inf"), init=False)
    _wall: float = field(default=float("-inf"), init=False)

    def run_if_due(self, vehicle: float, wall: float) -> None:
        if vehicle < self._vehicle:  # rebooted
            self._vehicle = float("-inf")
        if vehicle - self._vehicle >= self.interval or wall - self._wall >= self.interval:
            self._vehicle, self._wall = vehicle, wall
            self.action()


# Which vehicle a link connects to, its signing key, and how the user is asked and informed.


@dataclass(frozen=True)
class Heard:
    """An autopilot that is heard on a link. system: its MAVLink system id; kind: its MAV_TYPE as words."""

    system: int
    kind: str

    def __str__(self) -> str:
        return f"system {self.system} ({self.kind})"


class SeveralVehicles(UsageError):
    """More than one vehicle is heard and none was chosen. heard: all of them."""

    def __init__(self, url: str, heard: Sequence[Heard]) -> None:
        self.heard = tuple(heard)
        names = ", ".join(map(str, self.heard))
        super().__init__(f"{len(heard)} vehicles are heard on {url}: {names}; choose one with --system N")


def _nobody(sentence: str) -> None:
    """Ignore the sentence."""


@dataclass(frozen=True)
class Access:
    """system: id of the vehicle to connect to; None: the only one that is heard. choose: called for a system
    id if several are heard. tell: called with a sentence for each unexpected observation, such as a second
    rover; it may be called during any wait on the link. key: of MAVLink signing.
    """

    system: int | None = None
    choose: Callable[[Sequence[Heard]], int] | None = None
    tell: Callable[[str], None] = _nobody
    key: SigningKey | None = None

    def chosen(self, url: str, heard: Sequence[Heard]) -> int:
        """The system id to connect to, of those heard on `url`. SeveralVehicles if nobody can choose."""
        if len(heard) == 1:
            return heard[0].system
        if self.choose is None:
            raise SeveralVehicles(url, heard)
        return self.choose(heard)


# Which autopilots are heard on a link, and whether there was time to hear a second one.


HEARING = 1.2  # s after the first heartbeat; ArduPilot sends one a second


class HeardAutopilots:
    """heartbeats: the last one of each autopilot, by system id, in the order in which they were heard.

    only: the system id to wait for, None: any.
    """

    def __init__(self, only: int | None = None) -> None:
        self._only = only
        self.heartbeats: dict[int, Message] = {}
        self._began: float | None = None
        self._clock: tuple[int, float, float] | None = None  # of a vehicle: its id, first and last time [s]

    def hear(self, message: Message, now: float) -> None:
        """Take a message of any sender. now [s]: of a clock that never goes back."""
        system = sender(message)[0]
        if is_autopilot(message):
            self.heartbeats[system] = message
            if self._only in (None, system) and self._began is None:
                self._began = now
        seconds = vehicle_seconds(message)
        if seconds is None or system not in self.heartbeats:
            return
        if self._clock is None:
            self._clock = (system, seconds, seconds)
        elif self._clock[0] == system:
            self._clock = (system, self._clock[1], seconds)

    def over(self, now: float) -> bool:
        """Whether all vehicles had time to be heard: HEARING has passed by our clock, or by that of a vehicle
        that is simulated faster than real time. With `only`, it is enough to hear that one."""
        if self._began is None:
            return False
        passed = self._clock[2] - self._clock[1] if self._clock is not None else 0.0
        return self._only is not None or max(now - self._began, passed) >= HEARING

    @property
    def heard(self) -> tuple[Heard, ...]:
        """All autopilots heard, by id; with `only`, at most that one."""
        return tuple(
            heard_as(message)
            for system, message in sorted(self.heartbeats.items())
            if self._only in (None, system)
        )

    def others(self) -> str:
        """The autopilots heard, as a list in words; '' if none."""
        return ", ".join(str(heard_as(m)) for _, m in sorted(self.heartbeats.items()))


def heard_as(heartbeat: Message) -> Heard:
    """The sender of a heartbeat."""
    return Heard(sender(heartbeat)[0], vehicle_type_name(heartbeat.type))


_GCS_TYPE, _NO_AUTOPILOT = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID


class Connection:
    """Receives, records, dispatches and sends. Use as a context manager.

    url, tlog: the connection and the file it is recorded into. clock: the vehicle's. armed, mode
    (custom_mode), heartbeat: from its last HEARTBEAT. may_be_armed: a run armed it and has not heard that it
    is disarmed. version: of the firmware, () until asked for. texts: the last 200 status texts. line: opens
    the connection and gives the time for every wait on the link.
    """

    def __init__(
        self, url: str, transport: Transport, recorder: TlogWriter, line: Line, access: Access
    ) -> None:
        self.url, self._access = url, access
        self.line = line
        self.clock = VehicleClock()
        self.heartbeat: Message | None = None
        self.texts: deque[Said] = deque(maxlen=200)
        self._listeners: list[Callable[[Message], None]] = []
        self._text_listeners: list[Callable[[Said], None]] = []
        self._transport = transport
        self._recorder = recorder
        self._codec = Codec(key=access.key, wall=line.wall())
        self._inbox = Inbox(line, self._codec, RefusedHeartbeats(access.key))
        self._assembler = TextAssembler()
        self._periodic: list[Periodic] = [Periodic(1.0, self._send_heartbeat)]
        self._watch = Watch(url)
        self._heard_autopilots = HeardAutopilots(access.system)
        self._ended = False
        self.may_be_armed = False
        self.version: tuple[int, ...] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._transport.close()
        self._recorder.close()

    @property
    def target(self) -> tuple[int, int]:
        """(system, component) of the vehicle, (0, 0) until it is chosen."""
        return self._inbox.target

    @property
    def tlog(self) -> Path:
        """The file being recorded into."""
        return self._recorder.path

    def record_to(self, path: Path) -> None:
        """Continue the recording in another .tlog."""
        before, self._recorder = self._recorder, TlogWriter(path)
        before.close()

    @property
    def armed(self) -> bool:
        return self.heartbeat is not None and bool(self.heartbeat.base_mode & SAFETY_ARMED)

    @property
    def mode(self) -> int:
        """custom_mode of the last heartbeat, -1 before the first; on Rover 0 is MANUAL."""
        return int(self.heartbeat.custom_mode) if self.heartbeat is not None else -1

    @property
    def quality(self) -> LinkQuality:
        """How good the link has been in the last seconds."""
        return self._inbox.meter.quality(self.line.monotonic())

    # ---- receiving -----------------------------------------------------------------------------

    def receive(self, timeout: float) -> Message | None:
        """The next message of the vehicle within `timeout` s; sends periodic messages meanwhile.

        LinkError when the vehicle closed the connection or has been silent for too long.
        """
        deadline = self.line.monotonic() + timeout
        while True:
            self._send_due()
            if self._inbox.messages:
                message = self._inbox.messages.popleft()
                if self._take(message):
                    return message
                continue
            left = deadline - self.line.monotonic()
            if left <= 0 and timeout > 0:
                return None
            self._pump(min(max(left, 0.0), 0.2))
            if timeout <= 0 and not self._inbox.messages:
                return None

    def wait_for(
        self, kinds: str | tuple[str, ...], timeout: float, where: Callable[[Message], bool] | None = None
    ) -> Message | None:
        """The next message of these kinds (and for which `where` holds); None after `timeout` s."""
        wanted = (kinds,) if isinstance(kinds, str) else kinds
        deadline = self.line.monotonic() + timeout
        while (left := deadline - self.line.monotonic()) > 0:
            message = self.receive(left)
            if message is not None and kind(message) in wanted and (where is None or where(message)):
                return message
        return None

    def take_received(self) -> None:
        """Process the messages that have already been received."""
        while self._inbox.messages and self.receive(0.0):
            pass

    def _pump(self, wait: float) -> None:
        began = self.line.monotonic()
        try:
            data = self._transport.receive(wait)
        except (OSError, ValueError) as error:  # ValueError: a socket that was closed
            self._ended = True
            ended = f"the connection {self.url} ended ({error}); is the vehicle still running?"
            raise LinkError(ended) from error
        if sentence := self._transport.remark():
            self._access.tell(sentence)
        before = len(self._inbox.messages)
        if data:
            self._record(data)
        if not any(sender(m) == self.target for m in islice(self._inbox.messages, before, None)):
            self._watch.waited(self.line.monotonic() - began, found=self.target != (0, 0))

    def _record(self, data: bytes) -> None:
        """Record the bytes, then queue their messages, except those of other rovers."""
        pieces = self._inbox.pieces(data)
        try:
            self._recorder.write(pieces)
        finally:  # a full disk must not hide a message, such as the answer to a disarm command
            self._inbox.add(pieces)

    def _take(self, message: Message) -> bool:
        """Update the state from a message. False if it is not from our vehicle."""
        if sender(message) != self.target:
            self._note_other(message)
            return False
        boots = self.clock.boots
        self.clock.update(message)
        if self.clock.boots > boots:
            self._inbox.meter.restart()
        self._inbox.time_answer(message)
        self._watch.heard(self.clock.now if self.clock.known else None, kind(message) == "HEARTBEAT")
        if kind(message) == "HEARTBEAT":
            self.heartbeat, self._watch.lost = message, self.quality.lost
            self._take_texts(self._assembler.late(self.clock.now))
        elif kind(message) == "STATUSTEXT":
            self._take_texts(self._assembler.add(message, self.clock.now))
        for listener in self._listeners:
            listener(message)
        return True

    def _note_other(self, message: Message) -> None:
        """Ignore a message of another sender, but remember which vehicles are there."""
        others = self._inbox.others
        if self.target == (0, 0):
            self._heard_autopilots.hear(message, self.line.monotonic())
        elif is_autopilot(message) and sender(message)[0] not in {*others, self.target[0]}:
            other = heard_as(message)
            others.add(other.system)
            if self._access.system is None:
                self._access.tell(
                    f"another vehicle appeared on {self.url}: {other}; it is ignored and not recorded, "
                    f"this session goes on with system {self.target[0]}"
                )

    def _take_texts(self, texts: tuple[Said, ...]) -> None:
        self.texts.extend(texts)
        for text in texts:
            for listener in self._text_listeners:
                listener(text)

    def hear(self, messages: Callable[[Message], None]) -> None:
        """Call `messages` with each message from now on."""
        self._listeners.append(messages)

    @contextmanager
    def listening(
        self, messages: Callable[[Message], None], texts: Callable[[Said], None] | None = None
    ) -> Iterator[None]:
        """Inside the block, call `messages` with each message and `texts` with each complete status text."""
        self._listeners.append(messages)
        if texts is not None:
            self._text_listeners.append(texts)
        try:
            yield
        finally:
            self._listeners.remove(messages)
            if texts is not None:
                self._text_listeners.remove(texts)

    # ---- sending -------------------------------------------------------------------------------

    def send(self, message: Message) -> None:
        try:
            self._transport.send(self._codec.pack(message))
        except (OSError, ValueError) as error:
            self._ended = True
            raise LinkError(f"cannot send to {self.url} ({error}); is it still running?") from error

    def to_vehicle(self, name: str, **fields: Any) -> None:
        """Send a message that carries target_system and target_component."""
        self.send(make(name, target_system=self.target[0], target_component=self.target[1], **fields))

    def every(self, interval: float, action: Callable[[], None]) -> Periodic:
        """Run `action` at once and every `interval` s (see `Periodic`) until `cancel`."""
        periodic = Periodic(interval, action)
        self._periodic.append(periodic)
        return periodic

    def cancel(self, periodic: Periodic) -> None:
        if periodic in self._periodic:
            self._periodic.remove(periodic)

    def _send_due(self) -> None:
        now = self.line.monotonic()
        for periodic in tuple(self._periodic):
            periodic.run_if_due(self.clock.now, now)

    def _send_heartbeat(self) -> None:
        fields = {"base_mode": 0, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
        self.send(make("HEARTBEAT", type=_GCS_TYPE, autopilot=_NO_AUTOPILOT, **fields))

    def asked(self, what: Hashable) -> None:
        """Note that a request is sent: its answer measures the latency. what: ("PARAM_VALUE", name) or
        ("COMMAND_ACK", number)."""
        self._inbox.meter.asked(what, self.line.monotonic())

    def forget(self, what: Hashable) -> None:
        """Note that the vehicle could not answer the requests for `what`: they do not count as lost."""
        self._inbox.meter.forget(what)

    # ---- silence, and the end of the connection ------------------------------------------------

    @contextmanager
    def unwatched(self) -> Iterator[None]:
        """Inside the block, silence or missing heartbeats raise no error, so that a stop is not aborted."""
        before, self._watch = self._watch, Unwatched(self.url)
        try:
            yield
        finally:
            self._watch = before
            self._watch.forgive()

    def reopen_if_ended(self) -> None:
        """Reopen the connection if it ended; LinkError if that fails."""
        if self._ended and not self._reopen():
            raise LinkError(f"the connection {self.url} ended and cannot be opened again")

    def _reopen(self) -> bool:
        self._transport.close()
        self.line.sleep(0.2)  # the port may refuse for that long
        try:
            self._transport = self.line.open(self.url, timeout=2.0)
        except LinkError:
            return False
        self._require_signatures()
        self._transport.settle(self.target[0])
        self._ended = False
        self._inbox.restart()
        return True

    def _require_signatures(self) -> None:
        """With a signing key, the transport accepts signed heartbeats only."""
        if self._access.key is not None:
            self._transport.believe(self._access.key.signed)
