"""A recording as the source of a screen: played at any rate, paused, forwards and backwards.

Nothing here talks to a vehicle; a screen's requests are refused with a sentence.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from firmware_params.applet_parameters import STATES
from rover_sweep.errors import UsageError
from rover_sweep.live.played_runs import IDLE, RunSpan
from rover_sweep.live.source import Began, Ended, Judged, Play, Played, Request, Snapshot, Update
from rover_sweep.logs.log import Log
from rover_sweep.vehicle.events import Connected, Event, Notice, StateChanged
from rover_sweep.vehicle.identity import VehicleIdentity

# The interface of a recording that is played, .tlog or .BIN: its position, and the events on the way.


class Track(Protocol):
    """Positions are s of the vehicle's clock from the start of the recording; a restart takes no time.

    length [s]; places: its runs; remarks: sentences on the recording; log: the first in it.
    """

    length: float
    places: tuple[RunSpan, ...]
    remarks: tuple[str, ...]
    log: Log

    def seek(self, at: float) -> None:
        """Go to a position; the state is as after playing up to it."""
        ...

    def play(self, at: float) -> Iterator[Event]:
        """Continue to a position, with the events on the way."""
        ...

    def snapshot(self) -> Snapshot:
        """The rover at the position."""
        ...


def open_track(path: Path) -> Track:
    """A .tlog or .BIN. UsageError for anything else, DataRefused for one that cannot be played."""
    if path.is_dir():
        raise UsageError(f"{path} is a folder; give the path of a .BIN or .tlog in it")
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file; give the path of a .BIN or .tlog")
    match path.suffix.lower():
        case ".tlog":
            from rover_sweep.live.players import TlogTrack

            return TlogTrack(path)
        case ".bin":
            from rover_sweep.live.players import FlashTrack

            return FlashTrack(path)
    raise UsageError(f"{path.name}: {path.suffix or 'no extension'} cannot be played; give a .BIN or .tlog")


TICK = 0.1  # s between two snapshots
STRIDE = 5.0  # s of the recording that are played without looking at what was asked
AT_ONCE = 0.5  # s of the recording between two snapshots, as fast as it goes
EDGE = 1e-6  # s: positions are sums, so what happens at one may lie a rounding error off
MANOEUVRE = 6  # state of the applet


class PlayedSource:
    """A `live.source.Source` over a .tlog or .BIN. rate: 1 is real time, 0 paused, math.inf as fast as it
    goes; at: where it begins [s]. Raises UsageError or DataRefused for a file that cannot be played.
    """

    def __init__(self, path: str | Path, rate: float = 1.0, at: float = 0.0) -> None:
        self.path = Path(path).expanduser()
        self.track: Track = open_track(self.path)
        self.rate, self.at = rate, min(max(at, 0.0), self.track.length)
        self._tell: Callable[[Update], None] = lambda update: None
        self._requests: deque[Request] = deque()
        self._asked = threading.Condition()
        self._closed = False
        self._anchor()
        self._thread = threading.Thread(target=self._work, name=f"playing {self.path.name}", daemon=True)

    # ---- the screen's side ---------------------------------------------------------------------

    def start(self, tell: Callable[[Update], None]) -> None:
        """Begin to play; `tell` is called in the source's own thread."""
        self._tell = tell
        self._thread.start()

    def ask(self, request: Request) -> None:
        """`Play` is done, anything else refused in words."""
        with self._asked:
            self._requests.append(request)
            self._asked.notify()

    def abort(self) -> None:
        """Pause; nothing moves in a recording."""
        with self._asked:
            self._requests.appendleft(Play(rate=0.0))
            self._asked.notify()

    def close(self) -> str:
        """End the thread. Returns ''."""
        with self._asked:
            self._closed = True
            self._asked.notify()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)
        return ""

    # ---- the thread ----------------------------------------------------------------------------

    def _work(self) -> None:
        for update in _introduced(self.path, self.track):
            self._tell(update)
        self._jump(self.at)
        self._anchor()
        while not self._closed:
            for request in self._taken():
                self._answer(request)
                self._anchor()
            if self.rate <= 0 or self.at >= self.track.length:
                self._wait(None)
            elif math.isinf(self.rate):
                self._advance(self.at + AT_ONCE)
            else:
                self._keep_time()

    def _anchor(self) -> None:
        """From now on, play from the present position at the set rate."""
        self._since, self._from = time.monotonic(), self.at

    def _keep_time(self) -> None:
        """Wait for the next tick and play up to it; if it is behind, do not wait."""
        behind = self._from + (time.monotonic() - self._since) * self.rate - self.at
        if behind < TICK * self.rate:
            self._wait(TICK - behind / self.rate)
            behind = self._from + (time.monotonic() - self._since) * self.rate - self.at
        self._advance(self.at + min(behind, STRIDE))
        if behind > 2 * STRIDE:
            self._anchor()

    def _taken(self) -> list[Request]:
        with self._asked:
            taken = list(self._requests)
            self._requests.clear()
        return taken

    def _wait(self, seconds: float | None) -> None:
        with self._asked:
            self._asked.wait_for(lambda: self._closed or bool(self._requests), seconds)

    def _answer(self, request: Request) -> None:
        self._tell(Began(request))
        if not isinstance(request, Play):
            self._tell(Ended(request, f"{self.path.name} is a recording; its rover accepts no requests"))
            return
        if request.rate is not None:
            self.rate = request.rate if request.rate > 0 else 0.0
        if request.at is not None and math.isfinite(request.at):
            self._jump(request.at)
        else:
            self._tell(self._played())
        self._tell(Ended(request))

    def _jump(self, at: float) -> None:
        """Jump, and report the state there; for a run that it leaves, also how it ended."""
        left = self._place()
        self.at = min(max(at, 0.0), self.track.length)
        self.track.seek(self.at)
        if left is not None and self.at >= left.end:
            self._tell(left.run.finished)
            self._tell(Judged(left.run.verdict))
        place = self._place()
        if place is not None:
            self._tell(place.run.started)
        now = self._snapshot()
        self._tell(StateChanged(now.t, now.state, now.state_name))
        self._tell(now)
        self._tell(self._played())

    def _advance(self, at: float) -> None:
        to = min(at, self.track.length)
        for event in played(self.track, self.at, to):
            self._tell(event)
        self.at = to
        self._tell(self._snapshot())
        self._tell(self._played())

    def _place(self) -> RunSpan | None:
        return next((p for p in self.track.places if p.begin <= self.at < p.end), None)

    def _snapshot(self) -> Snapshot:
        """The snapshot; without an applet, with the state that it would have."""
        now = self.track.snapshot()
        place = self._place()
        if place is None or place.from_applet:
            return now
        progress = (self.at - place.begin) / (place.end - place.begin)
        return replace(now, state=MANOEUVRE, state_name=STATES[MANOEUVRE], progress=progress)

    def _played(self) -> Played:
        return Played(self.at, self.track.length, self.rate if self.at < self.track.length else 0.0)


def played(track: Track, since: float, to: float) -> Iterator[Event | Judged]:
    """Play a track from `since` to `to` s: its events, and those of the runs that begin or end."""
    turns = sorted(
        [(p.begin, 1, p) for p in track.places if since < p.begin <= to]
        + [(p.end, 0, p) for p in track.places if since < p.end <= to],
        key=lambda turn: turn[:2],
    )
    for at, begins, place in turns:
        if begins:
            yield from track.play(at - EDGE)
            yield place.run.started
            if not place.from_applet:
                yield StateChanged(place.run.begin, MANOEUVRE, STATES[MANOEUVRE])
        else:
            yield from track.play(at + EDGE)
            if not place.from_applet:
                yield StateChanged(place.run.end, IDLE, STATES[IDLE])
            yield place.run.finished
            yield Judged(place.run.verdict)
    yield from track.play(to)


def _introduced(path: Path, track: Track) -> Iterator[Update]:
    firmware = track.log.firmware or "unknown firmware"
    yield Connected(str(path), VehicleIdentity(firmware, (0, 0, 0), "", 0, 0))
    for remark in track.remarks:
        yield Notice("warning", remark)
    for text in dict.fromkeys(n.text for n in track.log.notes if n.level == "warning"):
        yield Notice("warning", text)
