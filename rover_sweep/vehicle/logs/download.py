"""The vehicle's .BIN logs over LOG_REQUEST_LIST/DATA, gaps asked for again.

`LogSource` is what a session needs of a downloader, so that another transport (MAVSDK) can take its place.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.events import LogProgress, LogSaved
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message
from rover_sweep.vehicle.link.recorder import writing

_BLOCK = 90  # bytes in a LOG_DATA
_WINDOW = 2048 * _BLOCK  # that is whole before it is written
# A larger log is asked for at once. Whenever no request is under way ArduPilot begins a new log, if it was
# armed before (AP_Logger_Backend::ShouldLog, 4.6.3): window by window, a log of 11.6 MB left 7 stumps.
_LARGE = 4 * _WINDOW
_COMPARED = 64 * _BLOCK  # of an earlier download's end, before it is gone on with
_LISTING = 60.0  # s for one list, however much the vehicle repeats itself; 500 logs come in 10 s
_QUIET, _TRIES = 0.5, 12  # s without data until the gaps are asked for again; how often without any progress


@dataclass(frozen=True)
class LogEntry:
    """A log on the vehicle. size in bytes (grows while written); time_utc in s since 1970, 0 unknown."""

    number: int
    size: int
    time_utc: int


class LogSource(Protocol):
    """Lists and fetches logs. Both raise LinkError in words while the rover is armed."""

    def logs(self) -> tuple[LogEntry, ...]:
        """All logs, oldest first."""
        ...

    def download(self, entry: LogEntry, path: Path) -> Iterator[LogProgress | LogSaved]:
        """Fetch one log into `path` (first as NAME.part); yields progress, at last LogSaved."""
        ...


@dataclass
class _Flow:
    """on: the vehicle was asked for the rest of the log, and sends."""

    on: bool = False


@dataclass(frozen=True)
class MavlinkLogs:
    """Logs by MAVLink's log messages. LinkError while armed: ArduPilot then answers nothing."""

    link: Link

    def logs(self) -> tuple[LogEntry, ...]:
        """All logs, oldest first."""
        refuse_download_if_armed(self.link)
        entries: dict[int, LogEntry] = {}
        for _ in range(3):
            self.link.to_vehicle("LOG_REQUEST_LIST", start=0, end=0xFFFF)
            until = self.link.line.monotonic() + _LISTING
            while (message := self._entry(until)) is not None:
                if message.num_logs == 0:
                    return ()
                entries[message.id] = LogEntry(message.id, message.size, message.time_utc)
                if len(entries) >= message.num_logs:
                    return tuple(entries[number] for number in sorted(entries))
        if not entries:
            raise LinkError(
                "the vehicle does not list its logs; is there a card in it, and another download running?"
            )
        return tuple(entries[number] for number in sorted(entries))

    def _entry(self, until: float) -> Message | None:
        """The next LOG_ENTRY before `until` [s], None where none comes."""
        left = until - self.link.line.monotonic()
        return self.link.wait_for("LOG_ENTRY", 1.5) if left > 0 else None

    def download(self, entry: LogEntry, path: Path) -> Iterator[LogProgress | LogSaved]:
        """Fetch one log into `path` (first as NAME.part); yields progress, at last LogSaved.

        What an interrupted download left in NAME.part is kept where its end is what the vehicle has there.
        """
        refuse_download_if_armed(self.link)
        partial = path.with_name(path.name + ".part")
        began = self.link.line.monotonic()
        try:
            done = self._resumed(entry, partial)
            with writing(path), partial.open("r+b" if done else "wb") as file:
                file.seek(done)
                file.truncate()
                flow = _Flow() if entry.size > _LARGE else None
                for start in range(done, entry.size, _WINDOW):
                    block = self._window(entry, start, min(_WINDOW, entry.size - start), flow)
                    file.write(block)
                    done += len(block)
                    yield LogProgress(entry.number, done, entry.size)
        finally:
            self.link.to_vehicle("LOG_REQUEST_END")
        with writing(path):
            partial.replace(path)
        yield LogSaved(path, done, self.link.line.monotonic() - began)

    def _resumed(self, entry: LogEntry, partial: Path) -> int:
        """Bytes of an earlier download that are good, whole blocks; 0 where it is of another log."""
        with suppress(OSError), partial.open("rb") as file:
            size = min(partial.stat().st_size, entry.size) // _BLOCK * _BLOCK
            tail = min(size, _COMPARED)
            file.seek(size - tail)
            if tail and self._window(entry, size - tail, tail) == file.read(tail):
                return size
        return 0

    def _window(self, entry: LogEntry, start: int, size: int, flow: _Flow | None = None) -> bytes:
        data, missing = bytearray(size), set(range(0, size, _BLOCK))
        tries = 0
        if flow is not None:
            self._flowing(entry, start, data, missing, flow)
        while missing:
            for first, last in _spans(missing):
                # ArduPilot serves one request at a time and ignores those that come meanwhile.
                self._ask(entry, start + first, min(last + _BLOCK, size) - first)
                got = self._receive(entry.number, start, data, missing, last)
                tries = 0 if got else tries + 1
                if tries >= _TRIES:
                    raise LinkError(
                        f"log {entry.number} stopped coming at {start + first} of {entry.size} bytes; "
                        "try again closer or by USB"
                    )
        return bytes(data)

    def _flowing(self, entry: LogEntry, start: int, data: bytearray, missing: set[int], flow: _Flow) -> None:
        """Take what comes of a window while the whole rest of the log is on its way; where something is lost
        the rest is called off, so that the vehicle listens again."""
        if not flow.on:
            self._ask(entry, start, entry.size - start)
            flow.on = True
        self._receive(entry.number, start, data, missing, max(missing))
        if missing:
            self.link.to_vehicle("LOG_REQUEST_END")
            flow.on = False
            while self.link.wait_for("LOG_DATA", _QUIET) is not None:
                pass

    def _ask(self, entry: LogEntry, offset: int, count: int) -> None:
        self.link.to_vehicle("LOG_REQUEST_DATA", id=entry.number, ofs=offset, count=count)

    def _receive(self, number: int, start: int, data: bytearray, missing: set[int], last: int) -> bool:
        """Take LOG_DATA until the block at `last` has come or nothing comes; whether any was new."""
        before = len(missing)
        while True:
            message = self.link.wait_for("LOG_DATA", _QUIET, lambda m: m.id == number)
            if message is None:
                return len(missing) < before
            at = message.ofs - start
            if 0 <= at < len(data) and at in missing:
                room = min(message.count, len(data) - at)
                data[at : at + room] = bytes(message.data[:room])
                if room == min(_BLOCK, len(data) - at):
                    missing.discard(at)
            if at >= last:
                return len(missing) < before


def refuse_download_if_armed(link: Link) -> None:
    """LinkError on an armed rover: ArduPilot then gives no logs."""
    if link.armed:
        raise LinkError("logs cannot be downloaded while the rover is armed; disarm first")


def _spans(offsets: set[int]) -> list[tuple[int, int]]:
    """Runs of consecutive blocks: [(first, last offset)]."""
    spans: list[tuple[int, int]] = []
    for offset in sorted(offsets):
        if spans and offset == spans[-1][1] + _BLOCK:
            spans[-1] = (spans[-1][0], offset)
        else:
            spans.append((offset, offset))
    return spans
