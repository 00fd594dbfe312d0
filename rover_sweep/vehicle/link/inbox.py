"""From the bytes of a connection to the messages of a vehicle. Of two equal answers, the first counts."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field
from math import ceil, log
from typing import Literal

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.mavlink import (
    Codec,
    Framer,
    Message,
    SigningKey,
    frame_number,
    frame_source,
    is_autopilot,
    is_known,
    kind,
    signs,
)
from rover_sweep.vehicle.link.transport import Line

# Why a link with a signing key does not accept a vehicle: its heartbeats fail the check of the key.


PATIENCE = 2.4  # s after the first refusal in which another vehicle, one with the key, may appear

Why = Literal["", "unsigned", "other key", "old"]
_WORDS = {
    "unsigned": "does not sign its messages, but --signing-key was given; "
    "leave --signing-key out, or set up signing on the vehicle",
    "other key": "signs with another key than that of --signing-key; give the key that was set up on it",
    "old": "signs with a time more than a minute behind this computer's; is this computer's clock right? "
    "A vehicle takes the time from GPS, or from the first signed message that it receives",
}


class RefusedHeartbeats:
    """why: reason for the last refused heartbeat of an autopilot; since: time of the first refusal [s]."""

    def __init__(self, key: SigningKey | None) -> None:
        self._key, self._codec = key, Codec()
        self.why: Why = ""
        self.since: float | None = None

    def look(self, frame: bytes, now: float) -> None:
        """Examine a frame that the link could not decode, at time `now` [s]."""
        message = self._codec.decode(frame) if self._key is not None else None
        if message is None or self._key is None or not is_autopilot(message):
            return
        self.since = now if self.since is None else self.since
        self.why = "unsigned" if not signs(frame) else "old" if self._key.signed(frame) else "other key"

    def final(self, now: float) -> bool:
        """Whether more waiting is useless: our messages correct an old time, but not a wrong key."""
        waited = self.since is not None and now - self.since > PATIENCE
        return waited and self.why in ("unsigned", "other key")

    def words(self, url: str) -> str:
        """The reason and what to do; '' if nothing was refused."""
        return f"the vehicle on {url} {_WORDS[self.why]}" if self.why else ""


# The quality of a link, and whether a missing answer means anything.
#
# A request needs two frames, its own and that of the answer. If frames are lost, a missing answer means
# nothing until the request was repeated often enough: `LinkQuality.tries` gives how often, and
# `LinkQuality.concludes` whether the link allows a conclusion at all.


LONGEST = 8.0  # s that an answer may take: 3 s each way and the vehicle's own time
MOST_TRIES = 30
_CHANCE = 1e-3  # probability to report something as absent that exists
_POOR_LOSS, _BAD_LOSS = 0.02, 0.2  # share of the frames: spoils a response, makes every request slow
_SLOW = 1.0  # s
_FEW = 10  # frames: fewer give no estimate of the lost share
_HASTE = 0.5  # s after which a request is repeated on a link that loses frames, if it is not slow too
_MARGIN, _STRETCH = 0.15, 1.25  # s, and factor of the latency: the latency varies
ADVICE = "move the antennas, go closer, lower the stream rates, or use USB"


class BadLink(LinkError):
    """The link is too poor for a conclusion; the sentence gives the measured quality."""


@dataclass(frozen=True)
class LinkQuality:
    """Measured over the last `seconds` s, on `frames` whole frames of the vehicle.

    All shares are 0..1. lost: frames that did not arrive whole; corrupted: frames that arrived damaged (part
    of lost); duplicated: whole frames that had arrived before. answered: share of the requests that the
    vehicle can answer. latency: from a request to its answer [s], None while unknown. silence, unanswered:
    time since the last frame, and since the last answer to a request [s].
    """

    seconds: float = 0.0
    frames: int = 0
    lost: float = 0.0
    corrupted: float = 0.0
    duplicated: float = 0.0
    answered: float = 1.0
    latency: float | None = None
    silence: float = 0.0
    unanswered: float = 0.0

    @property
    def passed(self) -> float:
        """Estimated probability that a request and its answer both arrive."""
        return min((1 - self.lost) ** 2, self.answered)

    def tries(self, least: int, of: int = 1) -> int:
        """Number of requests after which no answer on one of `of` items means that it is absent."""
        if self.passed >= 1 - _POOR_LOSS:
            return least
        needed = log(_CHANCE / max(of, 1)) / log(max(1 - self.passed, 1e-9))
        return min(max(least, ceil(needed)), MOST_TRIES)

    def concludes(self, tries: int, of: int = 1) -> bool:
        """Whether no answer on one of `of` items after `tries` requests means that it is absent."""
        return self.tries(1, of) <= tries and of * (1 - self.passed) ** tries <= _CHANCE

    def wait(self, usual: float) -> float:
        """The time to wait [s] for an answer that takes at most `usual` s on a good link."""
        patience = usual if self.lost < _POOR_LOSS else min(usual, _HASTE)
        return max(patience, _MARGIN + _STRETCH * min(self.latency or 0.0, LONGEST))

    @property
    def poor(self) -> bool:
        """Whether the link loses frames or answers, or answers slowly."""
        return self._loses or self.answered < 1 - _BAD_LOSS or (self.latency or 0.0) > _SLOW

    @property
    def bad(self) -> bool:
        """Whether the link is too poor to start a run over it."""
        return (self._loses and self.lost > _BAD_LOSS) or (self.latency or 0.0) > _SLOW

    @property
    def _loses(self) -> bool:
        return self.frames >= _FEW and self.lost > _POOR_LOSS

    @property
    def words(self) -> str:
        """The measured fault of the link and the remedy; '' if the link is good."""
        if not self.poor:
            return ""
        measured = f"measured over {max(self.seconds, 1):.0f} s"
        return f"{' and '.join(self._faults())} ({measured}); {ADVICE}"

    def _faults(self) -> list[str]:
        faults = []
        if self._loses:
            damaged = f", {self.corrupted:.0%} by damage" if self.corrupted >= 0.01 else ""
            faults.append(f"the link loses {self.lost:.0%} of the frames{damaged}")
        if self.answered < (1 - self.lost) ** 2 - _BAD_LOSS:  # the uplink is worse than the downlink
            faults.append(f"{1 - self.answered:.0%} of the requests get no answer")
        if (self.latency or 0.0) > _SLOW:
            faults.append(f"an answer takes {self.latency:.1f} s")
        return faults or [f"{1 - self.answered:.0%} of the requests get no answer"]


# Measures a link while it is used, from each frame, request and answer.


_WINDOW = 30  # s that a measurement looks back
_BEHIND = 64  # sequence numbers by which a frame may be late
_STALE = 10.0  # s within which a second answer to a repeated request may come
_SAMPLES = 5  # latencies kept
_ENOUGH = 4  # answers to repeated requests in a row that show a slower link
_SURE = 2  # answers assumed before the first came


@dataclass
class _Second:
    """Counts of one second of our clock."""

    began: float
    frames: int = 0
    lost: int = 0
    corrupted: int = 0
    duplicated: int = 0
    answers: int = 0
    vain: int = 0


@dataclass
class Sequence:
    """Sequence numbers of one component: MAVLink numbers the frames of a component modulo 256."""

    last: int | None = None
    missing: dict[int, None] = field(default_factory=dict)

    def take(self, number: int) -> tuple[int, bool]:
        """(frames lost before this one, whether it had come before); -1 lost for a late frame."""
        if self.last is None:
            self.last = number
            return 0, False
        ahead = (number - self.last) % 256
        if ahead == 0:
            return 0, True
        if ahead >= 256 - _BEHIND:
            return self._late(number)
        for skipped in range(1, ahead):
            self.missing[(self.last + skipped) % 256] = None
        self.last = number
        self.missing.pop(number, None)
        while len(self.missing) > _BEHIND:
            del self.missing[next(iter(self.missing))]
        return ahead - 1, False

    def _late(self, number: int) -> tuple[int, bool]:
        if number not in self.missing:
            return 0, True
        del self.missing[number]
        return -1, False


class LinkMeter:
    """Measures the quality of a link. All times are s of our monotonic clock."""

    def __init__(self) -> None:
        self._heard = float("-inf")  # when the last whole frame came
        self._answered = float("-inf")
        self._seconds: deque[_Second] = deque(maxlen=_WINDOW)
        self._sequence = Sequence()
        self._asked: dict[Hashable, list[float]] = {}
        self._stale: dict[Hashable, float] = {}
        self._exact: deque[float] = deque(maxlen=_SAMPLES)
        self._loose: deque[float] = deque(maxlen=_SAMPLES)

    def restart(self) -> None:
        """The vehicle rebooted: its sequence numbers start again."""
        self._sequence = Sequence()
        self._asked.clear()

    def frame(self, number: int, now: float) -> bool:
        """Count a whole frame of the vehicle by its sequence number. Returns whether it had come before."""
        lost, again = self._sequence.take(number)
        second, self._heard = self._second(now), now
        second.frames += not again
        second.duplicated += again
        second.lost += lost
        return again

    def damaged(self, now: float) -> None:
        """Count a frame with a wrong checksum. The next sequence number shows that it is lost."""
        self._second(now).corrupted += 1

    def asked(self, what: Hashable, now: float) -> None:
        """A request is sent; `what` identifies its answer."""
        self._asked.setdefault(what, []).append(now)

    def forget(self, what: Hashable) -> None:
        """Do not count these requests: the vehicle could not answer them."""
        self._asked.pop(what, None)

    def answered(self, what: Hashable, now: float) -> None:
        """An answer came, requested or not."""
        times = [t for t in self._asked.pop(what, []) if now - t < 3 * _STALE]
        if not times:
            return
        latency, second, self._answered = self.latency, self._second(now), now
        second.answers += 1
        second.vain += sum(b - a > (latency or _STALE) for a, b in zip(times, times[1:], strict=False))
        first, last = now - times[0], now - times[-1]
        stale = now <= self._stale.get(what, 0.0)
        if len(times) == 1 and not stale:
            self._sample(first)
        elif latency is not None and 0.8 * latency <= last <= 1.2 * latency + 0.1:
            self._sample(last)  # the usual latency: the earlier requests were lost
        elif not (stale and latency is not None and first < latency):  # it answers one of the requests
            self._loose.append(first)
        if len(times) > 1:
            self._stale[what] = now + max(latency or 0.0, first)

    def _sample(self, seconds: float) -> None:
        self._exact.append(seconds)
        self._loose.clear()

    @property
    def latency(self) -> float | None:
        """Time from a request to its answer [s]; None before the first answer."""
        if self._loose and len(self._loose) >= (_ENOUGH if self._exact else 1):
            return min(self._loose)
        return max(self._exact, default=None)

    def quality(self, now: float) -> LinkQuality:
        """The quality measured up to now."""
        seconds = [s for s in self._seconds if now - s.began <= _WINDOW]
        frames, lost = sum(s.frames for s in seconds), max(sum(s.lost for s in seconds), 0)
        answers = sum(s.answers for s in seconds) + _SURE
        repeated = sum(s.duplicated for s in seconds)
        return LinkQuality(
            seconds=now - seconds[0].began if seconds else 0.0,
            frames=frames,
            lost=lost / max(frames + lost, 1),
            corrupted=min(sum(s.corrupted for s in seconds), lost) / max(frames + lost, 1),
            duplicated=repeated / max(frames + repeated, 1),
            answered=answers / (answers + sum(s.vain for s in seconds)),
            latency=self.latency,
            silence=max(now - self._heard, 0.0),
            unanswered=max(now - self._answered, 0.0),
        )

    def _second(self, now: float) -> _Second:
        if not self._seconds or now - self._seconds[-1].began >= 1.0:
            self._seconds.append(_Second(now))
        return self._seconds[-1]


# The answers that the meter times, and the field that says which request they answer.
_ANSWERS = {"COMMAND_ACK": "command", "PARAM_VALUE": "param_id", "PARAM_ERROR": "param_id"}

Pieces = list[tuple[bytes, bool]]  # (bytes, is_frame)


class Inbox:
    """messages: decoded and not read yet. target: (system, component) of our vehicle, (0, 0) until it is
    chosen. others: system ids of other vehicles, whose frames are dropped. meter: measures our vehicle's
    frames. refused: why frames of an unchosen vehicle failed the check of the signing key."""

    def __init__(self, line: Line, codec: Codec, refused: RefusedHeartbeats) -> None:
        self.messages: deque[Message] = deque()
        self.target = (0, 0)
        self.others: set[int] = set()
        self.meter = LinkMeter()
        self.refused = refused
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
            pieces = [p for p in pieces if not (p[1] and frame_source(p[0])[0] in self.others)]
        return pieces

    def add(self, pieces: Pieces) -> None:
        """Measure and decode frames, and queue their messages."""
        for frame, is_frame in pieces:
            message = self._codec.decode(frame) if is_frame else None
            again = is_frame and self._measure(frame, message)
            if message is not None and not (self._repeats_ack(frame, message) and again):
                self.messages.append(message)
            elif is_frame and self.target == (0, 0):
                self.refused.look(frame, self._line.monotonic())

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
