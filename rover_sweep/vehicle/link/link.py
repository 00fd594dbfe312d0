"""A MAVLink link to one vehicle: connecting, choosing the vehicle, and finding it again after a reboot."""

from __future__ import annotations

import struct
import threading
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.link.connection import Access, Connection
from rover_sweep.vehicle.link.inbox import LONGEST, BadLink
from rover_sweep.vehicle.link.mavlink import (
    GCS_COMPONENT,
    GCS_SYSTEM,
    Codec,
    Framer,
    Message,
    constant,
    kind,
    message_id,
    result_name,
    sender,
    signs,
)
from rover_sweep.vehicle.link.recorded_transport import TlogWriter
from rover_sweep.vehicle.link.statustext import SILENCE
from rover_sweep.vehicle.link.transport import Line, LiveLine, speeds_tried

if TYPE_CHECKING:
    from mavsdk.mavsdk import Mavsdk
    from mavsdk.system import System

# Requests to a vehicle, repeated until their answer comes: commands and single messages.


_IN_PROGRESS = 5  # MAV_RESULT_IN_PROGRESS
_NEVER = (2, 3, 4)  # MAV_RESULT: DENIED, UNSUPPORTED, FAILED (ArduPilot, for a message that it does not have)
_TRIES, _TIMEOUT = 3, 2.0  # of a request, s


class Refused(LinkError):
    """The vehicle answered, and refuses the command."""


class Requests(Connection):
    """A connection with requests and answers. Times are s of our clock (`line`)."""

    def attempts(self, timeout: float | None, tries: int | None) -> Iterator[float]:
        """The time to wait for each attempt [s], from the measured link; given values are used unchanged.

        Before the first answer the link may be slow: the last wait is long enough for that.
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

        Repeated while no answer comes: as often as the link requires, or `tries` times with `timeout` s each.
        LinkError when no answer comes.
        """
        number, began = constant(name), self.line.monotonic()
        self.take_received()  # it may include a late acknowledgement of the previous command
        attempt = 0
        for attempt, wait in enumerate(self.attempts(timeout, tries)):
            sent = self.line.monotonic()
            self._send_command(number, params, attempt)
            answer = self._acknowledgement(number, wait)
            if answer is not None:
                self._absorb(number, attempt, sent)
                return int(answer.result)
        seconds = self.line.monotonic() - began
        asked = f"the vehicle did not answer {name} in {attempt + 1} tries and {seconds:.0f} s"
        raise self.no_answer(asked, "is the link too slow?")

    def _acknowledgement(self, number: int, wait: float) -> Message | None:
        return self.wait_for("COMMAND_ACK", wait, lambda m: m.command == number and m.result != _IN_PROGRESS)

    def _absorb(self, number: int, repeated: int, sent: float) -> None:
        """Take the other acknowledgements of a repeated command, so that the next command does not."""
        until = sent + self.quality.wait(0.0)
        for _ in range(repeated):
            left = until - self.line.monotonic()
            if left <= 0 or self._acknowledgement(number, left) is None:
                return

    def no_answer(self, what: str, otherwise: str) -> LinkError:
        """The error for a request without an answer: it names the link's measured fault, else `otherwise`."""
        fault = self.quality.words
        return BadLink(f"{what}: {fault}") if fault else LinkError(f"{what}; {otherwise}")

    def _send_command(self, number: int, params: tuple[float, ...], confirmation: int = 0) -> None:
        self.asked(("COMMAND_ACK", number))
        values = {f"param{i}": params[i - 1] if i <= len(params) else 0.0 for i in range(1, 8)}
        self.to_vehicle("COMMAND_LONG", command=number, confirmation=confirmation, **values)

    def require(self, what: str, name: str, *params: float, tries: int = 3) -> None:
        """Send a command that must be accepted; Refused, with the vehicle's status texts, if it is not."""
        before = len(self.texts)
        result = self.command(name, *params, tries=tries)
        if result == 0:
            return
        self.wait_for("STATUSTEXT", 0.3)
        reasons = "; ".join(text.text for text in list(self.texts)[before:][-3:])
        raise Refused(
            f"the vehicle refuses to {what} ({result_name(result)})" + (f": {reasons}" if reasons else "")
        )

    def request_message(
        self, name: str, timeout: float | None = None, tries: int | None = None
    ) -> Message | None:
        """Request one message by name and wait for it. None if it does not come, or if the vehicle says that
        it does not have it. Repeated like `command`."""
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
                    self.take_received()  # the acknowledgement measures the latency
                return answer if kind(answer) == name else None
        return None

    def _request(self, name: str) -> None:
        self._send_command(constant("MAV_CMD_REQUEST_MESSAGE"), (message_id(name),))


class Link(Requests):
    """One vehicle on one connection: see `Connection` for its state, `Requests` for requests."""

    @classmethod
    def open(
        cls,
        url: str,
        tlog_path: Path,
        timeout: float = 15.0,
        line: Line | None = None,
        meanwhile: Callable[[], None] | None = None,
        access: Access | None = None,
    ) -> Self:
        """Connect, record into `tlog_path` and wait up to `timeout` s for a vehicle's heartbeat.

        line: a live line if not given. meanwhile: called repeatedly, here and during every wait on the link;
        its exceptions pass through. access: system id, signing key and callbacks (see `Access`).
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

    def _find_vehicle(self, timeout: float) -> None:
        self._require_signatures()
        called, deadline = self._heard_autopilots, self.line.monotonic() + timeout
        while not called.over(now := self.line.monotonic()) and now < deadline:
            if not called.heard and self._inbox.refused.final(now):
                break
            self._watch.forgive()  # a vehicle that boots may take its time; `timeout` is the limit here
            self.receive(0.05)
        if not called.heard:
            raise LinkError(self._why_nobody(timeout))
        system = self._access.chosen(self.url, called.heard)
        self.heartbeat = called.heartbeats[system]
        self._inbox.target = sender(self.heartbeat)
        self._inbox.others = set(called.heartbeats) - {system}
        self._transport.settle(system)
        self._watch.forgive()
        self._require_key()

    def _require_key(self) -> None:
        """LinkError if the vehicle signs, we do not, and it answers no unsigned request. On its first port
        (USB) ArduPilot accepts unsigned messages too (GCS_Signing.cpp, accept_unsigned_callback)."""
        assert self.heartbeat is not None
        if self._access.key is not None or not signs(bytes(self.heartbeat.get_msgbuf())):
            return
        if self.request_message("AUTOPILOT_VERSION", timeout=1.5) is None:
            raise LinkError(
                f"the vehicle on {self.url} signs its messages and answers no unsigned ones; "
                "give the key set up on it with --signing-key FILE"
            )

    def _why_nobody(self, timeout: float) -> str:
        if refused := self._inbox.refused.words(self.url):
            return refused
        if others := self._heard_autopilots.others():
            return (
                f"system {self._access.system} was not heard on {self.url} within {timeout:.0f} s, but "
                f"{others}; give the id of your rover with --system"
            )
        return (
            f"no heartbeat of an autopilot on {self.url}{speeds_tried(self.url)} within {timeout:.0f} s; "
            "is the vehicle on, is it the right port or baud rate, does that port speak MAVLink?"
        )

    def reconnect(self, timeout: float = 60.0) -> None:
        """Wait until the vehicle is back after a reboot and sends heartbeats. LinkError after `timeout` s.

        It has rebooted when its clock has started again, or when it answers on a connection that had to be
        reopened because the vehicle closed it or was silent.
        """
        boots, deadline, quiet, rebooted = self.clock.boots, self.line.monotonic() + timeout, 0.0, False
        while self.line.monotonic() < deadline:
            try:
                self._request("SYSTEM_TIME")  # shows its clock
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


# MAVSDK on an open link: its bytes go through the link and are recorded there.
#
# MAVSDK 4 is a library in this process (`mavsdk`; no server). Its `raw://` connection takes and gives bytes,
# so it needs no second connection. That also works on a serial port, which only one program may open. It
# sends as system 255, component 190, like the link: ArduPilot ignores overrides of other systems
# (SYSID_MYGCS), and MAVSDK's own 245 would be a second ground station. Only the link sends heartbeats.


Answer = TypeVar("Answer")
_FOUND = 10.0  # s within which MAVSDK must find the vehicle's heartbeat
TURN = 0.003  # s: longest delay of a message of MAVSDK


class MavsdkOnLink:
    """Use as a context manager. system: MAVSDK's view of the vehicle, for its plugins."""

    system: System

    def __init__(self, link: Link) -> None:
        self.link = link
        self._outgoing: deque[bytes] = deque()
        self._codec, self._framer = Codec(), Framer()
        self._undo = ExitStack()

    def __enter__(self) -> MavsdkOnLink:
        with ExitStack() as undo:
            self._mavsdk = undo.enter_context(_instance())
            self._mavsdk.add_any_connection("raw://")
            handle = self._mavsdk.subscribe_raw_bytes_to_be_sent(self._outgoing.append)
            undo.callback(self._mavsdk.unsubscribe_raw_bytes_to_be_sent, handle)
            undo.enter_context(self.link.listening(self._hear))
            undo.callback(self.link.cancel, self.link.every(0.0, self._speak))
            found = self.call(lambda: self._mavsdk.first_autopilot(_FOUND))
            if found is None:
                raise LinkError(f"MAVSDK did not find the vehicle on {self.link.url}; use --via mavlink")
            self.system = found
            self._undo = undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    def call(self, blocking: Callable[[], Answer]) -> Answer:
        """Run `blocking` in a thread while this one pumps the link; returns or raises as `blocking` does."""
        done: list[Answer] = []
        failed: list[BaseException] = []

        def work() -> None:
            try:
                done.append(blocking())
            except BaseException as error:
                failed.append(error)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        while thread.is_alive():
            self.link.receive(TURN)
        if failed:
            raise failed[0]
        return done[0]

    def _hear(self, message: Message) -> None:
        self._mavsdk.pass_received_raw_bytes(bytes(message.get_msgbuf()))

    def _speak(self) -> None:
        """Send MAVSDK's frames through the link, renumbered, so that its sequence numbers have no gaps."""
        while self._outgoing:
            for frame, is_frame in self._framer.feed(self._outgoing.popleft()):
                message = self._codec.decode(frame) if is_frame else None
                if message is not None:
                    self.link.send(message)


def _instance() -> Mavsdk:
    try:
        from mavsdk import logging as mavsdk_logging
        from mavsdk.mavsdk import Configuration, Mavsdk
    except Exception as error:  # ImportError, or its library does not load on this system
        raise UsageError(f"MAVSDK cannot be loaded here ({error}); use --via mavlink") from error
    mavsdk_logging.log_subscribe(_silence)
    return Mavsdk(Configuration.create_manual(GCS_SYSTEM, GCS_COMPONENT, False))


def _silence(*_: Any) -> bool:
    """Drop a log line: MAVSDK would write it to stdout, and its results are enough."""
    return True


# Files on the vehicle, by single exchanges of MAVLink FTP: checksum and listing, without reading them.


# Sequence, session, opcode, size, the request's opcode, burst complete, padding, offset (MAVLink FTP).
_HEADER = struct.Struct("<HBBBBBxI")
_LIST, _CRC32, _ACK = 3, 14, 128
_DATA, _PAYLOAD = 12, 251
_FILE_TRIES, _FILE_TIMEOUT = 2, 1.5
_MOST = 5000  # entries of a folder: ArduPilot keeps at most 500 logs (LOG_MAX_FILES)


def crc32(data: bytes, before: int = 0) -> int:
    """ArduPilot's CRC-32 (AP_Math/crc.cpp, crc_crc32): starts at 0 and is not inverted at the end. before:
    CRC of the preceding bytes."""
    return zlib.crc32(data, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


def remote_crc32(link: Link, path: str, timeout: float = _FILE_TIMEOUT) -> int | None:
    """CRC-32 of a file on the vehicle; None without such a file or without MAVLink FTP. timeout [s]."""
    data = _ask(link, _CRC32, path, 0, timeout)
    return int.from_bytes(data[:4], "little") if data is not None and len(data) >= 4 else None


def remote_sizes(link: Link, folder: str) -> dict[str, int]:
    """Size [bytes] by name of the files in a folder of the vehicle; {} without it or without MAVLink FTP."""
    found: dict[str, int] = {}
    for entry in _entries(link, folder):
        name, _, size = entry[1:].partition("\t")
        if entry.startswith("F") and size.isascii() and size.isdecimal():
            found[name] = int(size)
    return found


def _entries(link: Link, folder: str) -> Iterator[str]:
    """Lines of a directory's listing, requested in parts by the number of entries already received.

    At most about `_MOST` lines, so that an endless listing ends.
    """
    offset = 0
    while data := _ask(link, _LIST, folder, offset, _FILE_TIMEOUT):
        lines = [line for line in data.decode("utf-8", "replace").split("\0") if line]
        yield from lines
        offset += len(lines)
        if not lines or offset >= _MOST:
            return


def _ask(link: Link, opcode: int, path: str, offset: int, timeout: float) -> bytes | None:
    """The data of an acknowledged answer; None if it is refused or none comes."""
    name = path.encode()
    # ArduPilot repeats its last answer to a repeated sequence number, so each request has its own. That of a
    # checksum is the one in the recorded conversations.
    sequence = (zlib.crc32(name) + opcode - _CRC32 + offset) & 0x7FFF
    request = _HEADER.pack(sequence, 0, opcode, len(name), 0, 0, offset) + name
    for _ in range(_FILE_TRIES):
        link.to_vehicle(
            "FILE_TRANSFER_PROTOCOL", target_network=0, payload=list(request.ljust(_PAYLOAD, b"\0"))
        )
        answer = link.wait_for("FILE_TRANSFER_PROTOCOL", timeout, lambda m: _answers(m, opcode, sequence))
        if answer is not None:
            data = bytes(answer.payload)
            return data[_DATA : _DATA + data[4]] if data[3] == _ACK else None
    return None


def _answers(message: Message, opcode: int, sequence: int) -> bool:
    came, _, _, _, asked, *_ = _HEADER.unpack_from(bytes(message.payload))
    return bool(asked == opcode and came == sequence + 1)
