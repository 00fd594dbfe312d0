"""A radio link in between: a TCP relay from one program at a time to the firmware, which can fail.

Its end at the firmware stays open whatever becomes of the program, as a radio's does. Each override that the
program sends is written down before the link does anything to it.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from typing import Literal, NamedTuple

from rover_sweep.vehicle.link.mavlink import Codec, Framer, kind

Mode = Literal["open", "hole", "stall"]
TRIM_US, HIGH_US, LEFT_ALONE = 1500, 1800, 0xFFFE
_THROTTLE, _SWITCH = 3, 6
_LOOK = 0.02  # s


class Sent(NamedTuple):
    """An override [us] that left the program at `t`, `heard` s after it was last given anything to read."""

    t: float
    throttle: int
    switch: int
    heard: float

    @property
    def driving(self) -> bool:
        return TRIM_US < self.throttle < LEFT_ALONE

    @property
    def high(self) -> bool:
        return HIGH_US < self.switch < LEFT_ALONE


class Way:
    """One direction. mode: hole drops what comes, stall keeps it until the way is open again."""

    def __init__(self) -> None:
        self.mode: Mode = "open"
        self._pending = b""

    def take(self, data: bytes) -> None:
        if self.mode != "hole":
            self._pending += data

    def flush(self, to: socket.socket) -> bool:
        """Pass on what waits; whether any went."""
        if self.mode != "open" or not self._pending:
            return False
        try:
            gone = to.send(self._pending)
        except BlockingIOError:
            return False
        except OSError:  # the other end is gone, and what was for it
            gone = len(self._pending)
        self._pending = self._pending[gone:]
        return gone > 0

    def forget(self) -> None:
        self._pending = b""


class Relay:
    """url: where the program connects. up, down: towards the firmware and from it. heard: time at which the
    program was last given something. sent: all its overrides since `begin`. Times are `time.monotonic` [s].
    Use as a context manager."""

    def __init__(self, connection: str) -> None:
        _, host, port = connection.split(":")
        self._firmware = socket.create_connection((host, int(port)), timeout=10.0)
        self._firmware.setblocking(False)
        self._listener = socket.create_server((host, 0))
        self._program: socket.socket | None = None
        self._ends = False
        self.url = f"tcp:{host}:{self._listener.getsockname()[1]}"
        self.begin()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def begin(self) -> None:
        """Another scenario: an open link, nothing written down yet."""
        self.up, self.down, self.sent, self.heard = Way(), Way(), list[Sent](), time.monotonic()
        self._framer, self._codec = Framer(), Codec()

    def set(self, mode: Mode, direction: str = "both") -> None:
        for way, name in ((self.up, "up"), (self.down, "down")):
            if direction in ("both", name):
                way.mode = mode

    def __enter__(self) -> Relay:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        self._thread.join()
        for one in (self._listener, self._firmware):
            one.close()
        self._dismiss()

    def _serve(self) -> None:
        while not self._ends:
            sockets = [s for s in (self._listener, self._firmware, self._program) if s is not None]
            for ready in select.select(sockets, [], [], _LOOK)[0]:
                self._read(ready)
            if self._program is not None and self.down.flush(self._program):
                self.heard = time.monotonic()
            self.up.flush(self._firmware)

    def _read(self, ready: socket.socket) -> None:
        if ready is self._listener:
            self._dismiss()
            self._program, _ = ready.accept()
            self._program.setblocking(False)
            self._program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        elif ready is self._firmware:
            data = ready.recv(65536)
            if self._program is not None:
                self.down.take(data)
        elif ready is self._program:
            self._from_program(ready)

    def _from_program(self, program: socket.socket) -> None:
        data = b""
        with contextlib.suppress(OSError):
            data = program.recv(65536)
        if not data:
            self._dismiss()
        self._note(data)
        self.up.take(data)

    def _note(self, data: bytes) -> None:
        for frame, whole in self._framer.feed(data):
            message = self._codec.decode(frame) if whole else None
            if message is not None and kind(message) == "RC_CHANNELS_OVERRIDE":
                now = time.monotonic()
                pwm = [int(getattr(message, f"chan{n}_raw")) for n in (_THROTTLE, _SWITCH)]
                self.sent.append(Sent(now, *pwm, now - self.heard))

    def _dismiss(self) -> None:
        if self._program is not None:
            self._program.close()
            self._program = None
        self.down.forget()
