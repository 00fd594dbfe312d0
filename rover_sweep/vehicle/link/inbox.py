"""From the bytes of a connection to the messages of a vehicle. Of two equal answers, the first counts."""

from __future__ import annotations

from collections import deque

from rover_sweep.vehicle.link.mavlink import (
    Codec,
    Framer,
    Message,
    frame_number,
    frame_source,
    is_known,
    kind,
    source_system,
)
from rover_sweep.vehicle.link.meter import LinkMeter
from rover_sweep.vehicle.link.refusals import Refusals
from rover_sweep.vehicle.link.transport import Line

# The answers that the meter times, and the field that says which request they answer.
_ANSWERS = {"COMMAND_ACK": "command", "PARAM_VALUE": "param_id", "PARAM_ERROR": "param_id"}

Pieces = list[tuple[bytes, bool]]  # (bytes, is_frame)


class Inbox:
    """messages: decoded and not read yet. target: (system, component) of our vehicle, (0, 0) until it is
    chosen. others: system ids of other vehicles, whose frames are dropped. meter: measures our vehicle's
    frames. refusals: why frames of an unchosen vehicle failed the check of the signing key."""

    def __init__(self, line: Line, codec: Codec, refusals: Refusals) -> None:
        self.messages: deque[Message] = deque()
        self.target = (0, 0)
        self.others: set[int] = set()
        self.meter = LinkMeter()
        self.refusals = refusals
        self._line, self._codec, self._framer = line, codec, Framer()
        self._last_ack = b""

    def restart(self) -> None:
        """Forget what came on the connection before; the vehicle may have rebooted."""
        self._framer = Framer()
        self.messages.clear()
        self.meter.restart()

    def pieces(self, data: bytes) -> Pieces:
        """Frames and noise in the bytes received, without the frames of other vehicles."""
        pieces = list(self._framer.feed(data))
        if self.others:
            pieces = [p for p in pieces if not (p[1] and source_system(p[0]) in self.others)]
        return pieces

    def add(self, pieces: Pieces) -> None:
        """Measure and decode frames, and queue their messages."""
        for frame, is_frame in pieces:
            message = self._codec.decode(frame) if is_frame else None
            again = is_frame and self._measure(frame, message)
            if message is not None and not (self._repeats_ack(frame, message) and again):
                self.messages.append(message)
            elif is_frame and self.target == (0, 0):
                self.refusals.look(frame, self._line.monotonic())

    def time_answer(self, message: Message) -> None:
        """Measure the latency if the message answers a request."""
        if field := _ANSWERS.get(kind(message)):
            what = "COMMAND_ACK" if field == "command" else "PARAM_VALUE"
            self.meter.answered((what, getattr(message, field)), self._line.monotonic())

    def _repeats_ack(self, frame: bytes, message: Message) -> bool:
        """Whether the frame is the acknowledgement that came last: the next command of the same number must
        not take it as its own answer."""
        if kind(message) != "COMMAND_ACK":
            return False
        before, self._last_ack = self._last_ack, frame
        return before == frame

    def _measure(self, frame: bytes, message: Message | None) -> bool:
        """Count a frame of our vehicle. Returns whether it had come before."""
        if frame_source(frame) != self.target:
            return False
        now = self._line.monotonic()
        if message is None and is_known(frame):
            self.meter.damaged(now)
            return False
        return self.meter.frame(frame_number(frame), now)
