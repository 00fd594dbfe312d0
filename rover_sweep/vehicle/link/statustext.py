"""Joins STATUSTEXT messages: MAVLink 2 cuts texts over 50 characters into chunks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import log

from rover_sweep.errors import LinkError
from rover_sweep.files.documents import printable
from rover_sweep.vehicle.link.mavlink import Message

_CHUNK = 50  # characters
_CHUNKS = 5  # of a text: ArduPilot's longest fit in two
_OPEN = 16  # most texts that wait for chunks at a time
_LONGEST = 256  # characters of a whole text
_WAITS = 5.0  # s of the vehicle's clock after which a text is shown without its lost chunks
LOST = "[...]"  # where a chunk was lost


@dataclass(frozen=True)
class Said:
    """A printable status text; t: arrival on the vehicle's clock [s]; severity: MAV_SEVERITY (0: worst)."""

    t: float
    severity: int
    text: str


@dataclass
class _Open:
    """A text with the chunks received, by number. last: number of its final chunk, if known."""

    severity: int
    since: float
    chunks: dict[int, str] = field(default_factory=dict)
    last: int | None = None

    def whole(self) -> bool:
        return self.last is not None and all(n in self.chunks for n in range(self.last + 1))


@dataclass
class TextAssembler:
    """Joins the chunks of texts, in any order.

    A lost chunk is replaced by `[...]` when the vehicle begins another text with the same id, after some
    seconds, or when too many texts are open.
    """

    _open: dict[int, _Open] = field(default_factory=dict)  # by id, oldest first

    def add(self, message: Message, t: float) -> tuple[Said, ...]:
        """The texts that end with this message, complete or not, oldest first. t: vehicle's clock [s]."""
        late, number = self.late(t), int(getattr(message, "id", 0))
        if not number:
            return (*late, _text(t, message.severity, message.text))
        return (*late, *self._chunk(number, message, t))

    def late(self, t: float) -> tuple[Said, ...]:
        """The texts that have waited too long for a lost chunk. t: vehicle's clock [s]."""
        waited = ((number, t - entry.since) for number, entry in self._open.items())
        # a clock that went back: the vehicle rebooted, the rest will not come
        return tuple(self._closed(n, t) for n in [n for n, seconds in waited if not -1 <= seconds <= _WAITS])

    def _chunk(self, number: int, message: Message, t: float) -> tuple[Said, ...]:
        text, at = _content(message.text), int(getattr(message, "chunk_seq", 0))
        ready: list[Said] = []
        if number in self._open and _another(self._open[number], at, text):
            ready.append(self._closed(number, t))
        if number not in self._open and len(self._open) >= _OPEN:
            ready.append(self._closed(next(iter(self._open)), t))
        entry = self._open.setdefault(number, _Open(message.severity, t))
        entry.chunks[at] = text
        if len(text) < _CHUNK:
            entry.last = at
        if entry.whole() or at >= _CHUNKS - 1:
            ready.append(self._closed(number, t))
        return tuple(ready)

    def _closed(self, number: int, t: float) -> Said:
        entry = self._open.pop(number)
        return _text(t, entry.severity, _joined(entry.chunks, entry.last))


def _another(entry: _Open, at: int, text: str) -> bool:
    """Whether a chunk belongs to another text than the earlier chunks with the same id."""
    return entry.chunks.get(at, text) != text or (entry.last is not None and at > entry.last)


def _joined(chunks: Mapping[int, str], last: int | None) -> str:
    end = max(chunks) + 1 if last is None else last + 1
    return "".join(chunks.get(n, LOST) for n in range(end)) + (LOST if last is None else "")


def _content(text: str) -> str:
    return text.rstrip("\0")


def _text(t: float, severity: int, text: str) -> Said:
    return Said(t, severity, printable(_content(text)[:_LONGEST])[:_LONGEST])


# Detects a vehicle that is silent, or sends no heartbeats.


SILENCE = 5.0  # s without any message from the vehicle
HEARTBEAT_LOSS = 10.0  # s of the vehicle's clock without a heartbeat while other messages come
_JUMP = 3.0  # s
_CHANCE = 1e-5  # probability that the link loses so many heartbeats in a row


@dataclass
class Watch:
    """Counts the time spent waiting without a message; time in which nobody reads does not count.

    lost: share of the frames that the link loses; the larger it is, the more heartbeats may be missing."""

    url: str
    lost: float = 0.0
    silent: float = 0.0  # s
    _heartbeat: float = 0.0  # vehicle's clock at the last one [s]
    _last: float | None = None  # and at the last message

    def waited(self, seconds: float, found: bool) -> None:
        """Nothing came for `seconds`. LinkError when that adds up to SILENCE. found: a vehicle was heard
        before."""
        self.silent += seconds
        if self.silent <= SILENCE:
            return
        if not found:
            raise LinkError(
                f"nothing was heard on {self.url} for {SILENCE:.0f} s; "
                "is a vehicle there, at that port or baud rate?"
            )
        raise LinkError(
            f"the vehicle on {self.url} has been silent for {SILENCE:.0f} s; check its power, the radio's "
            "range and the cable"
        )

    def heard(self, now: float | None, heartbeat: bool) -> None:
        """A message came at `now` on the vehicle's clock [s] (None: not known yet). LinkError if heartbeats
        are missing for too long. After a jump of the clock (nobody read, or a reboot) the count restarts."""
        self.silent = 0.0
        if now is None:
            return
        jumped = self._last is None or not 0 <= now - self._last <= _JUMP
        self._last = now
        if heartbeat or jumped:
            self._heartbeat = now
        elif now - self._heartbeat > (limit := self._limit()):
            raise LinkError(
                f"the vehicle on {self.url} sends messages but has sent no heartbeat for {limit:.0f} s of "
                "its clock; its main loop may hang: stop it by hand and read its messages"
            )

    def _limit(self) -> float:
        """Allowed time without a heartbeat [s]; the vehicle sends one a second."""
        return max(HEARTBEAT_LOSS, log(_CHANCE) / log(min(self.lost, 0.75))) if self.lost else HEARTBEAT_LOSS

    def forgive(self) -> None:
        """Restart the count: the vehicle is rebooting or booting."""
        self.silent, self._last = 0.0, None


class Unwatched(Watch):
    """A watch that never raises: the caller decides how long to wait."""

    def waited(self, seconds: float, found: bool) -> None:
        pass

    def heard(self, now: float | None, heartbeat: bool) -> None:
        pass
