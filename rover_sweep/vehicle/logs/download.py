"""Downloads the vehicle's .BIN logs by LOG_REQUEST_LIST/DATA, and requests missing blocks again.

`LogSource` is the interface that a session needs, so that MAVSDK can replace this one.
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
_WINDOW = 2048 * _BLOCK  # bytes that are complete before they are written
# A larger log is requested as a whole. Whenever no request is active, ArduPilot begins a new log if it was
# armed before (AP_Logger_Backend::ShouldLog, 4.6.3): a log of 11.6 MB, by windows, left 7 short logs.
_LARGE = 4 * _WINDOW
_COMPARED = 64 * _BLOCK  # bytes at the end of an earlier download to compare before it is continued
_LISTING = 60.0  # s for one list, also if the vehicle repeats entries; 500 logs come in 10 s
_QUIET, _TRIES = 0.5, 12  # s without data before gaps are requested again; tries without any progress


@dataclass(frozen=True)
class LogEntry:
    """A log on the vehicle. size [bytes] (grows while it is written); time_utc [s since 1970], 0: unknown."""

    number: int
    size: int
    time_utc: int


class LogSource(Protocol):
    """Lists and fetches logs. Both raise LinkError while the rover is armed."""

    def logs(self) -> tuple[LogEntry, ...]:
        """All logs, oldest first."""
        ...

    def download(self, entry: LogEntry, path: Path) -> Iterator[LogProgress | LogSaved]:
        """Fetch one log into `path` (first as NAME.part); yields progress, at last LogSaved."""
        ...


@dataclass
class _Flow:
    """on: the vehicle is sending the rest of the log."""

    on: bool = False


@dataclass(frozen=True)
class MavlinkLogs:
    """Logs by MAVLink's log messages. LinkError while armed: ArduPilot then does not answer."""

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
                "the vehicle does not list its logs; is there a card in it, or is another download running?"
            )
        return tuple(entries[number] for number in sorted(entries))

    def _entry(self, until: float) -> Message | None:
        """The next LOG_ENTRY before `until` [s], None if none comes."""
        left = until - self.link.line.monotonic()
        return self.link.wait_for("LOG_ENTRY", 1.5) if left > 0 else None

    def download(self, entry: LogEntry, path: Path) -> Iterator[LogProgress | LogSaved]:
        """Fetch one log into `path` (first as NAME.part); yields progress, then LogSaved.

        An interrupted download in NAME.part is continued if its end matches the vehicle's log.
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
        """Valid bytes of an earlier download, in whole blocks; 0 if it is of another log."""
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
                # ArduPilot serves one request at a time and ignores others.
                self._ask(entry, start + first, min(last + _BLOCK, size) - first)
                got = self._receive(entry.number, start, data, missing, last)
                tries = 0 if got else tries + 1
                if tries >= _TRIES:
                    raise LinkError(
                        f"the download of log {entry.number} stopped at {start + first} of {entry.size} "
                        "bytes; try again closer to the rover or by USB"
                    )
        return bytes(data)

    def _flowing(self, entry: LogEntry, start: int, data: bytearray, missing: set[int], flow: _Flow) -> None:
        """Receive a window while the vehicle sends the rest of the log. If a block is lost, cancel the
        request, so that the vehicle accepts requests again."""
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
        """Take LOG_DATA until the block at `last` or a silence. Returns whether any block was new."""
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
    """LinkError on an armed rover: ArduPilot then sends no logs."""
    if link.armed:
        raise LinkError("logs cannot be downloaded while the rover is armed; disarm first")


def _spans(offsets: set[int]) -> list[tuple[int, int]]:
    """Groups of consecutive blocks: [(first, last offset in bytes)]."""
    spans: list[tuple[int, int]] = []
    for offset in sorted(offsets):
        if spans and offset == spans[-1][1] + _BLOCK:
            spans[-1] = (spans[-1][0], offset)
        else:
            spans.append((offset, offset))
    return spans
