"""One direction of a bad link in virtual time, and the laptop's door to the virtual world.

    pipe = Pipe(seed=1)
    pipe.put(frame, now_us)                # one MAVLink frame a call
    pipe.weather = Weather(drop=0.2)       # from now on; Weather() is a perfect link
    frames = pipe.take(now_us)             # what has arrived

The same seed and the same calls give the same bytes. Nothing here knows MAVLink or who listens.
"""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass
from itertools import count


@dataclass(frozen=True)
class Weather:
    """What a link does to each frame. drop, corrupt, duplicate, reorder: probabilities. delay, jitter [s]:
    jitter is uniform from 0 on and keeps the order. hole: nothing passes. stall: kept until the weather
    changes, then all at once."""

    drop: float = 0.0
    corrupt: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    hole: bool = False
    stall: bool = False


FAIR = Weather()
_OVERTAKEN_US = 60_000  # how much later a reordered frame comes


@dataclass(frozen=True)
class Frame:
    """data: as it comes out. sent_us: when it was put in. whole: undamaged. own: of the vehicle itself."""

    data: bytes
    sent_us: int
    whole: bool = True
    own: bool = True


class Pipe:
    """See above. weather: may be set at any time."""

    def __init__(self, seed: int) -> None:
        self.weather = FAIR
        self._random = random.Random(seed)
        self._under_way: list[tuple[int, int, Frame]] = []
        self._kept: list[Frame] = []
        self._number = count()
        self._latest_us = 0

    def put(self, data: bytes, now_us: int, own: bool = True) -> None:
        """One frame into the pipe. own: False for one of somebody else on the same channel."""
        weather, frame = self.weather, Frame(data, now_us, own=own)
        if weather is FAIR:
            self._arrive(frame, now_us, in_order=True)
        elif weather.stall:
            self._kept.append(frame)
        elif not weather.hole and self._random.random() >= weather.drop:
            self._pass(frame, now_us)

    def take(self, now_us: int) -> list[Frame]:
        """The frames that have arrived by now, in their order."""
        if self._kept and not self.weather.stall:
            kept, self._kept = self._kept, []
            for frame in kept:
                self._arrive(frame, now_us, in_order=True)
        arrived = []
        while self._under_way and self._under_way[0][0] <= now_us:
            arrived.append(heapq.heappop(self._under_way)[2])
        return arrived

    @property
    def empty(self) -> bool:
        return not (self._kept or self._under_way)

    def clear(self) -> None:
        """Everything under way is lost."""
        self._under_way, self._kept, self._latest_us = [], [], 0

    def _pass(self, frame: Frame, now_us: int) -> None:
        weather, chance = self.weather, self._random.random
        if weather.corrupt and chance() < weather.corrupt:
            frame = self._damaged(frame)
        late_us = round(1e6 * (weather.delay + weather.jitter * chance()))
        overtaken = bool(weather.reorder) and chance() < weather.reorder
        self._arrive(frame, now_us + late_us + _OVERTAKEN_US * overtaken, in_order=not overtaken)
        if weather.duplicate and chance() < weather.duplicate:
            self._arrive(frame, now_us + late_us, in_order=True)

    def _damaged(self, frame: Frame) -> Frame:
        data = bytearray(frame.data)
        data[self._random.randrange(len(data))] ^= self._random.randrange(1, 256)
        return Frame(bytes(data), frame.sent_us, whole=False, own=frame.own)

    def _arrive(self, frame: Frame, at_us: int, in_order: bool) -> None:
        if in_order:
            at_us = self._latest_us = max(at_us, self._latest_us)
        heapq.heappush(self._under_way, (at_us, next(self._number), frame))
