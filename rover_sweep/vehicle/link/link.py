"""A MAVLink link to one vehicle: everything is recorded first, then looked at.

There is no reader thread: whoever waits on the link pumps it. That keeps one flow of control (a
Ctrl-C lands where the stop path is), and lets a rover that is simulated faster than real time be
slowed by TCP while nobody reads. When this program stops reading while the rover drives, the RC
override lapses by itself (RC_OVERRIDE_TIME, 3 s) and the applet stops; see `run.py`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.access import Access
from rover_sweep.vehicle.link.clock import Periodic, VehicleClock
from rover_sweep.vehicle.link.link_quality import LONGEST, BadLink, LinkQuality
from rover_sweep.vehicle.link.mavlink import (
    Codec,
    Framer,
    Message,
    constant,
    frame_number,
    frame_source,
    is_autopilot,
    is_known,
    kind,
    make,
    message_id,
    result_name,
    sender,
    source_system,
)
from rover_sweep.vehicle.link.meter import LinkMeter
from rover_sweep.vehicle.link.recorder import TlogWriter
from rover_sweep.vehicle.link.refusals import Refusals
from rover_sweep.vehicle.link.roll_call import RollCall, heard_as
from rover_sweep.vehicle.link.signing import signs
from rover_sweep.vehicle.link.statustext import StatusText, TextAssembler
from rover_sweep.vehicle.link.transport import Line, LiveLine, Transport
from rover_sweep.vehicle.link.watch import SILENCE, Unwatched, Watch

_SAFETY_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_GCS_TYPE, _NO_AUTOPILOT = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID
_IN_PROGRESS = 5  # MAV_RESULT_IN_PROGRESS
_NEVER = (2, 3, 4)  # MAV_RESULT: DENIED, UNSUPPORTED, FAILED (ArduPilot, for a message it has not)
_TRIES, _TIMEOUT = 3, 2.0  # of a request, s


class Refused(LinkError):
    """The vehicle answered, and will not do it."""


class Link:
    """One vehicle on one connection. Use as a context manager.

    url, tlog: where it is connected and recorded. clock: the vehicle's. armed, mode (custom_mode),
    heartbeat: from its last HEARTBEAT. may_be_armed: a run armed it and has not heard that it is
    disarmed. version: of the firmware once it was asked for, () before. texts: the last 200 status
    texts. line: what opens the connection and gives the time; whoever waits on a link takes the time
    from there.
    """

    def __init__(
        self, url: str, transport: Transport, recorder: TlogWriter, line: Line, access: Access
    ) -> None:
        self.url, self._access = url, access
        self.line = line
        self.clock = VehicleClock()
        self.target = (0, 0)
        self.heartbeat: Message | None = None
        self.texts: deque[StatusText] = deque(maxlen=200)
        self._listeners: list[Callable[[Message], None]] = []
        self._text_listeners: list[Callable[[StatusText], None]] = []
        self._transport = transport
        self._recorder = recorder
        self._codec = Codec(key=access.key, wall=line.wall())
        self._framer, self._assembler = Framer(), TextAssembler()
        self._refusals = Refusals(access.key)
        self._queue: deque[Message] = deque()
        self._periodic: list[Periodic] = [Periodic(1.0, self._send_heartbeat)]
        self._watch = Watch(url)
        self._roll_call = RollCall(access.system)
        self._others: set[int] = set()  # system ids of other rovers on this link
        self._meter, self._ack = LinkMeter(), b""
        self._ended = False
        self.may_be_armed = False
        self.version: tuple[int, ...] = ()

    @classmethod
    def open(
        cls,
        url: str,
        tlog_path: Path,
        timeout: float = 15.0,
        line: Line | None = None,
        meanwhile: Callable[[], None] | None = None,
        access: Access | None = None,
    ) -> Link:
        """Connect, record into `tlog_path` and wait up to `timeout` s for a vehicle's heartbeat.

        line: a real one where none is given. meanwhile: called again and again, here and wherever the
        link is waited on; what it raises comes out there. access: see there.
        """
        line = line or LiveLine()
        transport = line.open(url)
        try:
            recorder = TlogWriter(tlog_path)
        except BaseException:
            transport.close()
            raise
        link = cls(url, transport, recorder, line, access or Access())
        if meanwhile is not None:
            link.every(0.0, meanwhile)
        try:
            link._find_vehicle(timeout)
        except BaseException:
            link.close()
            raise
        return link

    def __enter__(self) -> Link:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._transport.close()
        self._recorder.close()

    @property
    def tlog(self) -> Path:
        """The file being recorded into."""
        return self._recorder.path

    def record_to(self, path: Path) -> None:
        """Go on recording in another .tlog."""
        before, self._recorder = self._recorder, TlogWriter(path)
        before.close()

    @property
    def armed(self) -> bool:
        return self.heartbeat is not None and bool(self.heartbeat.base_mode & _SAFETY_ARMED)

    @property
    def mode(self) -> int:
        """custom_mode of the last heartbeat; on Rover 0 is MANUAL."""
        return int(self.heartbeat.custom_mode) if self.heartbeat is not None else -1

    @property
    def quality(self) -> LinkQuality:
        """How good the link has been in the last seconds."""
        return self._meter.quality(self.line.monotonic())

    # ---- receiving -----------------------------------------------------------------------------

    def receive(self, timeout: float) -> Message | None:
        """The next message of the vehicle within `timeout` s; sends what is due meanwhile.

        LinkError when the vehicle closed the connection or has been silent for too long.
        """
        deadline = self.line.monotonic() + timeout
        while True:
            self._send_due()
            if self._queue:
                message = self._queue.popleft()
                if self._take(message):
                    return message
                continue
            left = deadline - self.line.monotonic()
            if left <= 0 and timeout > 0:
                return None
            self._pump(min(max(left, 0.0), 0.2))
            if timeout <= 0 and not self._queue:
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

    def _pump(self, wait: float) -> None:
        began = self.line.monotonic()
        try:
            data = self._transport.receive(wait)
        except (OSError, ValueError) as error:  # ValueError: a socket that was closed
            self._ended = True
            raise LinkError(
                f"the connection {self.url} ended ({error}); is the vehicle still running?"
            ) from error
        if words := self._transport.remark():
            self._access.tell(words)
        before = len(self._queue)
        if data:
            self._keep(data)
        if not any(sender(message) == self.target for message in islice(self._queue, before, None)):
            self._watch.waited(self.line.monotonic() - began, found=self.target != (0, 0))

    def _keep(self, data: bytes) -> None:
        """Record what came, and queue its messages; not those of other rovers."""
        pieces = list(self._framer.feed(data))
        if self._others:
            pieces = [p for p in pieces if not (p[1] and source_system(p[0]) in self._others)]
        try:
            self._recorder.write(pieces)
        finally:  # also what a full disk does not take is heard, such as the answer to a disarm
            for frame, is_frame in pieces:
                message = self._codec.decode(frame) if is_frame else None
                again = is_frame and self._measure(frame, message)
                if message is not None and not (self._acknowledged(frame, message) and again):
                    self._queue.append(message)
                elif is_frame and self.target == (0, 0):
                    self._refusals.look(frame, self.line.monotonic())

    def _acknowledged(self, frame: bytes, message: Message) -> bool:
        """Whether it is an acknowledgement that came just before: the next command of its number must not
        take it for its own."""
        if kind(message) != "COMMAND_ACK":
            return False
        before, self._ack = self._ack, frame
        return before == frame

    def _measure(self, frame: bytes, message: Message | None) -> bool:
        """Count a frame of our vehicle; whether it had come before."""
        if frame_source(frame) != self.target:
            return False
        now = self.line.monotonic()
        if message is None and is_known(frame):
            self._meter.damaged(now)
            return False
        return self._meter.frame(frame_number(frame), now)

    def _take(self, message: Message) -> bool:
        """Keep the books on a message; False where it is not from our vehicle."""
        if sender(message) != self.target:
            self._overhear(message)
            return False
        boots = self.clock.boots
        self.clock.update(message)
        if self.clock.boots > boots:
            self._meter.restart()
        self._note_answer(message)
        self._watch.heard(self.clock.now if self.clock.known else None, kind(message) == "HEARTBEAT")
        if kind(message) == "HEARTBEAT":
            self.heartbeat, self._watch.lost = message, self.quality.lost
            self._take_texts(self._assembler.late(self.clock.now))
        elif kind(message) == "STATUSTEXT":
            self._take_texts(self._assembler.add(message, self.clock.now))
        for listener in self._listeners:
            listener(message)
        return True

    def _overhear(self, message: Message) -> None:
        """Somebody else's message counts for nothing; until the vehicle is chosen it shows who is there."""
        if self.target == (0, 0):
            self._roll_call.hear(message, self.line.monotonic())
        elif is_autopilot(message) and sender(message)[0] not in {*self._others, self.target[0]}:
            other = heard_as(message)
            self._others.add(other.system)
            if self._access.system is None:
                self._access.tell(
                    f"another vehicle is on {self.url} now, {other}; it is neither heeded nor recorded, this "
                    f"goes on with system {self.target[0]}"
                )

    def _take_texts(self, texts: tuple[StatusText, ...]) -> None:
        self.texts.extend(texts)
        for text in texts:
            for listener in self._text_listeners:
                listener(text)

    def hear(self, messages: Callable[[Message], None]) -> None:
        """Call `messages` with each message from now on."""
        self._listeners.append(messages)

    @contextmanager
    def listening(
        self, messages: Callable[[Message], None], texts: Callable[[StatusText], None] | None = None
    ) -> Iterator[None]:
        """Meanwhile call `messages` with each message and `texts` with each whole status text."""
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
        self.send(
            make(
                "HEARTBEAT",
                type=_GCS_TYPE,
                autopilot=_NO_AUTOPILOT,
                base_mode=0,
                custom_mode=0,
                system_status=4,
                mavlink_version=3,
            )
        )

    def asked(self, what: Hashable) -> None:
        """Note that a request leaves, so that its answer tells how good the link is: ("PARAM_VALUE", name)
        or ("COMMAND_ACK", number)."""
        self._meter.asked(what, self.line.monotonic())

    def _note_answer(self, message: Message) -> None:
        number = {"COMMAND_ACK": "command", "PARAM_VALUE": "param_id", "PARAM_ERROR": "param_id"}
        if field := number.get(kind(message)):
            what = "COMMAND_ACK" if field == "command" else "PARAM_VALUE"
            self._meter.answered((what, getattr(message, field)), self.line.monotonic())

    def attempts(self, timeout: float | None, tries: int | None) -> Iterator[float]:
        """s to wait for each of the attempts that the link as measured demands; those given are kept to.

        While no answer has ever come, the link may be slow: the last wait is long enough for that.
        """
        attempt, began = 0, self.line.monotonic()
        while attempt < (tries or self.quality.tries(_TRIES)):
            attempt += 1
            wait = self.quality.wait(_TIMEOUT) if timeout is None else timeout
            last = attempt >= (tries or _TRIES) and timeout is None and self.quality.latency is None
            yield max(wait, LONGEST - (self.line.monotonic() - began)) if last else wait

    def command(
        self, name: str, *params: float, timeout: float | None = None, tries: int | None = None
    ) -> int:
        """Send COMMAND_LONG `name` (MAV_CMD_...) and return its MAV_RESULT (0 accepted).

        Repeated while no answer comes, as often as the link demands, or `tries` times of `timeout` s.
        LinkError when none comes at all.
        """
        number, began = constant(name), self.line.monotonic()
        self._hear_out()  # an acknowledgement of the command before may be among it
        attempt = 0
        for attempt, wait in enumerate(self.attempts(timeout, tries)):
            sent = self.line.monotonic()
            self._send_command(number, params, attempt)
            answer = self._acknowledgement(number, wait)
            if answer is not None:
                self._absorb(number, attempt, sent)
                return int(answer.result)
        asked = f"the vehicle did not answer {name} in {attempt + 1} tries and "
        asked += f"{self.line.monotonic() - began:.0f} s"
        raise self.no_answer(asked, "is the link too slow?")

    def _acknowledgement(self, number: int, wait: float) -> Message | None:
        return self.wait_for("COMMAND_ACK", wait, lambda m: m.command == number and m.result != _IN_PROGRESS)

    def _absorb(self, number: int, repeated: int, sent: float) -> None:
        """Take the acknowledgements of a repeated command, so that the next one does not."""
        until = sent + self.quality.wait(0.0)
        for _ in range(repeated):
            left = until - self.line.monotonic()
            if left <= 0 or self._acknowledgement(number, left) is None:
                return

    def no_answer(self, what: str, otherwise: str) -> LinkError:
        """The error for a request that stayed without an answer: the link's fault where it is poor."""
        words = self.quality.words
        return BadLink(f"{what}: {words}") if words else LinkError(f"{what}; {otherwise}")

    def _send_command(self, number: int, params: tuple[float, ...], confirmation: int = 0) -> None:
        self.asked(("COMMAND_ACK", number))
        values = {f"param{i}": params[i - 1] if i <= len(params) else 0.0 for i in range(1, 8)}
        self.to_vehicle("COMMAND_LONG", command=number, confirmation=confirmation, **values)

    def require(self, what: str, name: str, *params: float, tries: int = 3) -> None:
        """A command that must be accepted; Refused with the vehicle's own words where it is not."""
        before = len(self.texts)
        result = self.command(name, *params, tries=tries)
        if result == 0:
            return
        self.wait_for("STATUSTEXT", 0.3)
        said = "; ".join(text.text for text in list(self.texts)[before:][-3:])
        raise Refused(
            f"the vehicle refuses to {what} ({result_name(result)})" + (f": {said}" if said else "")
        )

    def request_message(
        self, name: str, timeout: float | None = None, tries: int | None = None
    ) -> Message | None:
        """Ask for one message by name and wait for it; None where it does not come, or the vehicle says that
        it has none. Repeated as `command` is."""
        asked = constant("MAV_CMD_REQUEST_MESSAGE")
        for wait in self.attempts(timeout, tries):
            self._request(name)
            answer = self.wait_for(
                (name, "COMMAND_ACK"),
                wait,
                lambda m: kind(m) == name or (m.command == asked and m.result in _NEVER),
            )
            if answer is not None:
                if self.quality.latency is None:
                    self._hear_out()  # the acknowledgement tells how slow the link is
                return answer if kind(answer) == name else None
        return None

    def _hear_out(self) -> None:
        """Take what has come already."""
        while self._queue and self.receive(0.0):
            pass

    def _request(self, name: str) -> None:
        self._send_command(constant("MAV_CMD_REQUEST_MESSAGE"), (message_id(name),))

    def to_vehicle(self, name: str, **fields: Any) -> None:
        """Send a message that carries target_system and target_component."""
        self.send(make(name, target_system=self.target[0], target_component=self.target[1], **fields))

    # ---- finding and losing the vehicle --------------------------------------------------------

    def _find_vehicle(self, timeout: float) -> None:
        self._believe()
        called, deadline = self._roll_call, self.line.monotonic() + timeout
        while not called.over(now := self.line.monotonic()) and now < deadline:
            if not called.heard and self._refusals.final(now):
                break
            self._watch.forgive()  # a vehicle that boots may take its time; `timeout` is the limit here
            self.receive(0.05)
        if not called.heard:
            raise LinkError(self._nobody(timeout))
        system = self._access.chosen(self.url, called.heard)
        self.heartbeat = called.heartbeats[system]
        self.target = sender(self.heartbeat)
        self._others = set(called.heartbeats) - {system}
        self._transport.settle(system)
        self._watch.forgive()
        self._require_key()

    def _believe(self) -> None:
        if self._access.key is not None:
            self._transport.believe(self._access.key.signed)

    def _require_key(self) -> None:
        """LinkError where the vehicle signs, we do not, and it answers no unsigned request. On its first port
        (USB) ArduPilot takes unsigned messages all the same (GCS_Signing.cpp, accept_unsigned_callback)."""
        assert self.heartbeat is not None
        if self._access.key is not None or not signs(bytes(self.heartbeat.get_msgbuf())):
            return
        if self.request_message("AUTOPILOT_VERSION", timeout=1.5) is None:
            raise LinkError(
                f"the vehicle on {self.url} signs its messages and answers no unsigned ones; "
                "give the key that was set up on it with --signing-key FILE"
            )

    def _nobody(self, timeout: float) -> str:
        if refused := self._refusals.words(self.url):
            return refused
        if others := self._roll_call.others():
            return (
                f"system {self._access.system} is not heard on {self.url} within {timeout:.0f} s, but "
                f"{others}; give --system the id of the one that is meant"
            )
        return (
            f"no heartbeat of an autopilot on {self.url} within {timeout:.0f} s; "
            "is the vehicle on, is it the right port or baud rate, does that port speak MAVLink?"
        )

    @contextmanager
    def unwatched(self) -> Iterator[None]:
        """Meanwhile a vehicle that is silent, or sends no heartbeat, ends no wait: who stops it goes on."""
        before, self._watch = self._watch, Unwatched(self.url)
        try:
            yield
        finally:
            self._watch = before
            self._watch.forgive()

    def reopen_if_ended(self) -> None:
        """Open the connection again where it ended; LinkError where that fails."""
        if self._ended and not self._reopen():
            raise LinkError(f"the connection {self.url} ended and cannot be opened again")

    def reconnect(self, timeout: float = 60.0) -> None:
        """After a reboot was asked for: wait until the vehicle is back and sends heartbeats.

        It has rebooted when its clock has started anew, or when it answers on a connection that had
        to be opened again because the vehicle closed it or fell silent.
        """
        boots, deadline, quiet, rebooted = self.clock.boots, self.line.monotonic() + timeout, 0.0, False
        while self.line.monotonic() < deadline:
            try:
                self._request("SYSTEM_TIME")  # so that the clock shows
                quiet = 0.0 if self.receive(0.3) is not None else quiet + 0.3
                self._watch.forgive()
            except LinkError:
                quiet = SILENCE
            if not rebooted and self.clock.boots > boots:
                rebooted, self.heartbeat = True, None
            if rebooted and self.heartbeat is not None:
                return
            if quiet >= SILENCE and self._reopen():
                quiet, rebooted, self.heartbeat = 0.0, True, None
        raise LinkError(
            f"the vehicle did not come back within {timeout:.0f} s of its reboot; "
            "switch it off and on, and connect again"
        )

    def _reopen(self) -> bool:
        self._transport.close()
        self.line.sleep(0.2)  # for as long the port may still refuse
        try:
            self._transport = self.line.open(self.url, timeout=2.0)
        except LinkError:
            return False
        self._believe()
        self._transport.settle(self.target[0])
        self._framer, self._ended = Framer(), False
        self._queue.clear()
        self._meter.restart()
        return True
