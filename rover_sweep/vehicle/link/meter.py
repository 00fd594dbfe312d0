"""Measures a link while it is used, from each frame, request and answer."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field

from rover_sweep.vehicle.link.link_quality import LinkQuality

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
        """The vehicle could not answer these requests, so they say nothing of the link."""
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
