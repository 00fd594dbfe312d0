"""MAVSDK on an open link: its bytes go through the link and are recorded there.

MAVSDK 4 is a library in this process (`mavsdk`; no server). Its `raw://` connection takes and gives bytes, so
it needs no second connection. That also works on a serial port, which only one program may open. It sends as
system 255, component 190, like the link: ArduPilot ignores overrides of other systems (SYSID_MYGCS), and
MAVSDK's own 245 would be a second ground station. Only the link sends heartbeats.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, TypeVar

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import GCS_COMPONENT, GCS_SYSTEM, Codec, Framer, Message

if TYPE_CHECKING:
    from mavsdk.mavsdk import Mavsdk
    from mavsdk.system import System

Answer = TypeVar("Answer")
_FOUND = 10.0  # s within which MAVSDK must find the vehicle's heartbeat
TURN = 0.003  # s: longest delay of a message of MAVSDK


class MavsdkRider:
    """Use as a context manager. system: MAVSDK's view of the vehicle, for its plugins."""

    system: System

    def __init__(self, link: Link) -> None:
        self.link = link
        self._outgoing: deque[bytes] = deque()
        self._codec, self._framer = Codec(), Framer()
        self._undo = ExitStack()

    def __enter__(self) -> MavsdkRider:
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
