"""Which message goes out how often on one link: ArduPilot's interval buckets and the cap by the loop rate.

Rules of GCS_MAVLINK (Rover-4.6.3): an interval is cut to whole ms, at most 60 s; faster than 0.8 loops is
DENIED and the old one stays; there are 10 buckets, and an eleventh interval joins the nearest.
"""

from __future__ import annotations

from collections.abc import Callable

BUCKETS = 10
ACCEPTED, DENIED = 0, 2  # MAV_RESULT
LONGEST_US, LONGEST_MS = 60_000_000, 60_000
TRANSFER_SLOWDOWN = 4  # streams wait so much longer while parameters or files are being sent


class StreamSchedule:
    """Message intervals of one link.

    loop_period_us: of the main loop; clock: vehicle time in ms; default_ms: the interval of a message id
    after a reset, 0 for not sent, None for a message that the vehicle does not have.
    """

    def __init__(
        self, loop_period_us: int, clock: Callable[[], int], default_ms: Callable[[int], int | None]
    ) -> None:
        self.loop_period_us = loop_period_us
        self.interval_ms: dict[int, int] = {}
        self._clock, self._default_ms = clock, default_ms
        self._buckets: dict[int, list[int]] = {}
        self._last_sent: dict[int, int] = {}
        self._next_ms = 0

    def known(self, message_id: int) -> bool:
        """Whether the vehicle has that message."""
        return self._default_ms(message_id) is not None

    def capped_ms(self, interval_ms: int) -> int:
        """The interval, or the shortest that the loop rate allows (cap_message_interval)."""
        if interval_ms and interval_ms * 800 < self.loop_period_us:
            return int(self.loop_period_us / 800)
        return interval_ms

    def request(self, message_id: int, interval_us: int) -> int:
        """MAV_CMD_SET_MESSAGE_INTERVAL: -1 stops, 0 resets to the default. Returns the MAV_RESULT."""
        default = self._default_ms(message_id)
        if default is None or interval_us < -1:
            return DENIED
        if interval_us == 0:
            wanted = default
        elif interval_us == -1:
            wanted = 0
        else:
            wanted = LONGEST_MS if interval_us > LONGEST_US else max(1, interval_us // 1000)
        if self.capped_ms(wanted) > wanted:
            return DENIED
        self.set(message_id, wanted)
        return ACCEPTED

    def set(self, message_id: int, interval_ms: int) -> None:
        """Puts a message into the bucket of that interval (capped; 0 stops it)."""
        interval_ms = self.capped_ms(interval_ms)
        old = self.interval_ms.pop(message_id, 0)
        if old:
            self._buckets[old].remove(message_id)
            if not self._buckets[old]:
                del self._buckets[old], self._last_sent[old]
        if not interval_ms:
            return
        if interval_ms not in self._buckets and len(self._buckets) >= BUCKETS:
            interval_ms = min(self._buckets, key=lambda ms: abs(ms - interval_ms))
        self.interval_ms[message_id] = interval_ms
        self._buckets.setdefault(interval_ms, []).append(message_id)
        self._last_sent.setdefault(interval_ms, self._clock())
        self._next_ms = 0

    def due(self, transferring: bool = False) -> list[int]:
        """Messages to send now. A bucket keeps its grid: at 50 Hz, 25 ms comes out as 20, 20, 20, 40 ms."""
        now_ms = self._clock()
        if now_ms < self._next_ms:
            return []
        slowdown = TRANSFER_SLOWDOWN if transferring else 1
        ids: list[int] = []
        for interval_ms, members in self._buckets.items():
            wait, last = interval_ms * slowdown, self._last_sent[interval_ms]
            if now_ms - last < wait:
                continue
            ids += members
            last += wait
            self._last_sent[interval_ms] = now_ms if now_ms - last > wait else last
        self._next_ms = min((self._last_sent[ms] + ms for ms in self._buckets), default=now_ms + 100)
        return ids
