"""A recorded conversation played back, byte by byte, to the code that talks to a live vehicle.

Time is the recording's and passes only while the code waits, so a minute takes as long as the code needs
to read it. What was received then is given out in its order, and not before the code has sent what was
sent before it; what the code sends is compared with what was sent then. The first difference is told in
`ConversationDiffers`, and nothing goes on after it.

Not compared: sequence numbers and checksums of frames, and how often a message of a fixed period was
repeated (HEARTBEAT, an RC_CHANNELS_OVERRIDE that says the same as the one before).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from conversation_file import Conversation

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.mavlink import Codec, kind
from rover_sweep.vehicle.link.recorded_transport import ConversationKind
from rover_sweep.vehicle.link.transport import Transport

_SLACK = 0.05  # s: a wait here may end that much before it did then, since the code itself takes no time
_EARLY = 0.5  # s: ... and a message may be sent that much sooner
_PATIENCE = 3.0  # s that the code may wait where something was sent then; less than a link takes for silence
_LEAST = 1e-4  # s that pass in a wait, so that no loop without a wait runs for ever
_SPOKEN = (ConversationKind.SENT, ConversationKind.UNSENT)
_OPENING = (ConversationKind.OPENED, ConversationKind.REFUSED)


class ConversationDiffers(Exception):
    """What the code does is not what was done then. No RoverSweepError: none of its handlers may take it
    for a vehicle that misbehaves."""


@dataclass(frozen=True)
class _Said:
    """A message sent: name and fields."""

    name: str
    fields: tuple[tuple[str, Any], ...]

    def __str__(self) -> str:
        shown = ", ".join(
            f"{name}={_short(value)}" for name, value in self.fields if value not in (0, 0xFFFF)
        )
        return f"{self.name}({shown})"


class _Hearing:
    """Tells which of the messages sent count, in their order."""

    def __init__(self) -> None:
        self._codec, self._override = Codec(), _Said("", ())

    def said(self, data: bytes) -> _Said | None:
        """The message in a frame that was sent; None for a repetition that is not compared."""
        message = self._codec.decode(data)
        if message is None:
            return _Said("bytes", (("data", data),))
        if kind(message) == "HEARTBEAT":
            return None
        said = _Said(kind(message), tuple(sorted(_plain(message.to_dict()).items())))
        if said.name == "RC_CHANNELS_OVERRIDE":
            repeated, self._override = said == self._override, said
            return None if repeated else said
        return said


@dataclass(frozen=True)
class _Turn:
    """An entry of the conversation; said: where it is a message sent that counts."""

    kind: ConversationKind
    t: float
    data: bytes
    said: _Said | None


class ReplayedLine:
    """A line on which a conversation is repeated; its clock is the recording's [s]."""

    def __init__(self, conversation: Conversation) -> None:
        then, turns = _Hearing(), []
        for entry in conversation.entries:
            said = then.said(entry.data) if entry.kind in _SPOKEN else None
            if (
                said is not None or entry.kind != ConversationKind.SENT
            ):  # a heartbeat that failed told of the end
                turns.append(_Turn(entry.kind, entry.t, entry.data, said))
        self._turns = turns
        self._now_hearing = _Hearing()
        self._early: set[int] = set()  # turns of ours that came before something that is still to be received
        self._at, self._now = 0, 0.0
        self._difference = ""

    # ---- the line

    def open(self, url: str, timeout: float = 5.0) -> Transport:
        turn = self._next()
        if turn is None or turn.kind not in _OPENING:
            raise self._differs("opens a connection", turn)
        self._take(turn)
        if turn.kind == ConversationKind.REFUSED:
            raise LinkError(turn.data.decode())
        return ReplayedTransport(self)

    def monotonic(self) -> float:
        return self._now

    def since_boot(self) -> float:
        return self._now

    def wall(self) -> float:
        return self._now

    def sleep(self, seconds: float) -> None:
        self._now += max(seconds, _LEAST)

    def finish(self) -> None:
        """After the code has ended: ConversationDiffers where it has not done all that was done then."""
        left = next((t for i, t in enumerate(self._turns) if i >= self._at and self._counts(i)), None)
        if self._difference or left is not None:
            raise self._differs("has ended", left)

    # ---- what its transport asks

    def receive(self, timeout: float) -> bytes:
        self._refuse_after_difference()
        turn, until = self._next(), self._now + max(timeout, _LEAST)
        if turn is not None and _comes(turn) and turn.t <= until + _SLACK:
            self._take(turn)
            if turn.kind != ConversationKind.RECEIVED:
                raise ConnectionResetError("the connection had ended")
            return turn.data
        since = self._turns[-1].t if turn is None else turn.t
        if until > since + _PATIENCE:
            raise self._differs("waits", turn)
        self._now = until
        return b""

    def send(self, data: bytes) -> None:
        self._refuse_after_difference()
        said = self._now_hearing.said(data)
        index = self._at
        while index < len(self._turns) and (
            self._turns[index].kind == ConversationKind.RECEIVED or index in self._early
        ):
            index += 1
        turn = self._turns[index] if index < len(self._turns) else None
        if (
            turn is not None
            and turn.kind == ConversationKind.UNSENT
            and turn.said is None
            and turn.t <= self._now + _SLACK
        ):
            self._at = index + 1
            raise BrokenPipeError("the connection had ended")
        if said is None:
            return
        if turn is None or turn.said != said or turn.t > self._now + _EARLY:
            raise self._differs(f"sends {said}", turn)
        if index == self._at:
            self._take(turn)
        else:
            self._early.add(index)
        if turn.kind == ConversationKind.UNSENT:
            raise BrokenPipeError("the connection had ended")

    def close(self) -> None:
        while (turn := self._next()) is not None and _comes(turn):
            self._at += 1
        if turn is None or turn.kind != ConversationKind.CLOSED:
            if not self._difference:  # a close while another difference is on its way must not hide it
                raise self._differs("closes the connection", turn)
            return
        self._take(turn)

    # ---- its place

    def _next(self) -> _Turn | None:
        while self._at in self._early:
            self._at += 1
        return self._turns[self._at] if self._at < len(self._turns) else None

    def _take(self, turn: _Turn) -> None:
        self._at += 1
        self._now = max(self._now, turn.t)

    def _counts(self, index: int) -> bool:
        return index not in self._early and not _comes(self._turns[index])

    def _refuse_after_difference(self) -> None:
        if self._difference:
            raise ConversationDiffers(self._difference)

    def _differs(self, does: str, then: _Turn | None) -> ConversationDiffers:
        if not self._difference:
            where = f"{self._now:.2f} s into the conversation (turn {self._at} of {len(self._turns)})"
            self._difference = f"{where} the code {does}, where then {_words(then, self._now)}"
        return ConversationDiffers(self._difference)


class ReplayedTransport(Transport):
    """A connection of a `ReplayedLine`."""

    def __init__(self, line: ReplayedLine) -> None:
        self._line = line

    def receive(self, timeout: float) -> bytes:
        return self._line.receive(timeout)

    def send(self, data: bytes) -> None:
        self._line.send(data)

    def close(self) -> None:
        self._line.close()


def _comes(turn: _Turn) -> bool:
    """Whether it came from outside: bytes, or the end of the connection."""
    return turn.kind in (ConversationKind.RECEIVED, ConversationKind.ENDED) or (
        turn.kind == ConversationKind.UNSENT and turn.said is None
    )


def _words(turn: _Turn | None, now: float) -> str:
    if turn is None:
        return "nothing more was said"
    if turn.said is not None:
        later = f", {turn.t - now:.1f} s later" if turn.t > now + _EARLY else ""
        return f"it sent {turn.said}{later}"
    if turn.kind == ConversationKind.RECEIVED:
        return f"{len(turn.data)} bytes came"
    return f"the connection was {turn.kind.name.lower()}"


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    """Fields as values that compare: a NaN with itself, a list with a list."""
    return {
        n: repr(v) if isinstance(v, list | float) else v for n, v in fields.items() if n != "mavpackettype"
    }


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
