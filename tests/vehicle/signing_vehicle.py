"""A vehicle that signs, made of one that does not: its frames are signed on the way, by pymavlink. What is
sent to it comes through only if it is signed with its key, as in ArduPilot (GCS_Signing.cpp)."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.vehicle.link.mavlink import Codec, Framer, timestamp
from rover_sweep.vehicle.link.transport import Line, LiveLine, Transport

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))


class SigningLine(LiveLine):
    """A line to a vehicle of system 1 that signs with `secret`, its clock `late` s behind. open_port: it
    takes unsigned messages too, as ArduPilot on its first port. heard: names of what came through."""

    def __init__(
        self, secret: bytes = KEY, late: float = 0.0, open_port: bool = False, line: Line | None = None
    ) -> None:
        self.secret, self.late, self.open_port = secret, late, open_port
        self.line = line or LiveLine()
        self.heard: list[str] = []

    def open(self, url: str, timeout: float = 5.0) -> Transport:
        return _Signing(self.line.open(url, timeout), self)

    def monotonic(self) -> float:
        return self.line.monotonic()


class _Signing(Transport):
    def __init__(self, inner: Transport, line: SigningLine) -> None:
        self._inner, self._line = inner, line
        self._down, self._up, self._plain = Framer(), Framer(), Codec()
        self._mav = m.MAVLink(None, srcSystem=1, srcComponent=1)
        self._mav.signing.secret_key, self._mav.signing.sign_outgoing = line.secret, True
        self._mav.signing.timestamp = timestamp(line.wall() - line.late)

    def receive(self, timeout: float) -> bytes:
        frames = self._down.feed(self._inner.receive(timeout))
        return b"".join(self._signed(frame) for frame, whole in frames if whole)

    def send(self, data: bytes) -> None:
        for frame, whole in self._up.feed(data):
            message = self._plain.decode(frame) if whole else None
            if message is not None and (self._line.open_port or self._accepts(frame)):
                self._line.heard.append(message.get_type())
                self._inner.send(self._plain.pack(message))

    def close(self) -> None:
        self._inner.close()

    def _signed(self, frame: bytes) -> bytes:
        message = self._plain.decode(frame)
        if message is None:
            return b""
        self._mav.seq = frame[4]
        return bytes(message.pack(self._mav))

    def _accepts(self, frame: bytes) -> bool:
        try:
            self._mav.decode(bytearray(frame))
        except m.MAVError:
            return False
        return True
