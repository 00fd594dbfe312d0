"""Downloads the vehicle's .BIN logs by LOG_REQUEST_LIST/DATA, and requests missing blocks again.

`LogSource` is the interface that a session needs, so that MAVSDK can replace this one.
"""

from __future__ import annotations

import datetime
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.events import LogProgress, LogSaved
from rover_sweep.vehicle.link.link import TURN, Link, MavsdkOnLink, crc32, remote_crc32, remote_sizes
from rover_sweep.vehicle.link.mavlink import Message
from rover_sweep.vehicle.link.recorded_transport import writing
from rover_sweep.vehicle.parameters import ParameterSet, read_all, write_parameter

if TYPE_CHECKING:
    from mavsdk.plugins.log_files import LogFiles

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


HOW_TO_DISARM = (
    "Disarm it with the transmitter, or with `rover-sweep preflight --connect URL --fix armed`; after a run "
    "that was cut short, `rover-sweep resume` disarms it and goes on"
)


def refuse_download_if_armed(link: Link) -> None:
    """LinkError on an armed rover: ArduPilot then sends no logs."""
    if link.armed:
        raise LinkError(f"logs cannot be downloaded while the rover is armed. {HOW_TO_DISARM}")


def _spans(offsets: set[int]) -> list[tuple[int, int]]:
    """Groups of consecutive blocks: [(first, last offset in bytes)]."""
    spans: list[tuple[int, int]] = []
    for offset in sorted(offsets):
        if spans and offset == spans[-1][1] + _BLOCK:
            spans[-1] = (spans[-1][0], offset)
        else:
            spans.append((offset, offset))
    return spans


# Fetches logs into a folder: skips those already there, and compares the new ones with the card.


_FOLDERS = ("/APM/LOGS", "logs")  # on a flight controller, in SITL
_CRC_START, _CRC_RATE = 3.0, 0.5e6  # s, B/s: time that a card may take to read its file again
_CHUNK = 1 << 20
_WRITTEN_ON, _LOOK_AGAIN = 25.0, 1.5  # s
_SHORT = 200_000  # bytes: formats and parameters take up to 90 kB (4.6.3), 10 s of driving 250 kB


@dataclass(frozen=True)
class FetchedFile:
    """A log in the folder. size [bytes]; seconds: duration of the download, 0 if it was there before.
    checked: its checksum equals that on the card; False if the vehicle reports none."""

    number: int
    path: Path
    size: int
    seconds: float
    checked: bool


def chosen_logs(entries: tuple[LogEntry, ...], which: str) -> tuple[LogEntry, ...]:
    """The requested logs: a number, 'latest' or 'all'. UsageError with a list of the logs if none fits.

    The latest is the last one long enough for a drive: ArduPilot begins a new log after each download.
    """
    if not entries:
        raise UsageError("there is no log on the vehicle: it writes one once it is armed")
    if which == "all":
        return entries
    if which == "latest":
        return tuple(e for e in entries if e.size >= _SHORT)[-1:] or entries[-1:]
    found = tuple(e for e in entries if str(e.number) == which)
    if not found:
        there = f"{entries[0].number} to {entries[-1].number}" if len(entries) > 1 else f"{entries[0].number}"
        raise UsageError(f"there is no log {which} on the vehicle; there are {there}, latest and all")
    return found


def settled(link: Link, source: LogSource) -> tuple[LogEntry, ...]:
    """The list of logs, once none grows any more: ArduPilot continues to log for 15 s after disarming."""
    entries = source.logs()
    deadline = link.line.monotonic() + _WRITTEN_ON
    while entries and link.line.monotonic() < deadline:
        link.wait_for("", _LOOK_AGAIN)
        before, entries = entries, source.logs()
        if entries == before:
            break
    return entries


def fetch(
    link: Link, source: LogSource, entries: tuple[LogEntry, ...], folder: Path
) -> Iterator[LogProgress | FetchedFile]:
    """Fetch each log as log<NUMBER>.BIN, or with a suffix if another log has that name.

    LinkError if a log differs from the card; it is then kept as NAME.BIN.damaged.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for entry in entries:
        sums = _sums(link, entry)
        path, here = _place(folder, entry, sums)
        if here:
            yield FetchedFile(entry.number, path, entry.size, 0.0, bool(sums))
            continue
        seconds = 0.0
        for event in source.download(entry, path):
            if isinstance(event, LogProgress):
                yield event
            else:
                seconds = event.seconds
        _compare(path, entry, sums)
        yield FetchedFile(entry.number, path, path.stat().st_size, seconds, bool(sums))


def file_crc32(path: Path) -> int:
    """`remote_files.crc32` of a local file."""
    result = 0
    with path.open("rb") as file:
        while data := file.read(_CHUNK):
            result = crc32(data, result)
    return result


def _sums(link: Link, entry: LogEntry) -> tuple[int, ...]:
    """Checksum of the log on the card, () if the vehicle reports none. After old logs were erased, the
    numbers of logs and of their files differ, so the file is found by its size."""
    for folder in _FOLDERS:
        same = [
            n for n, size in remote_sizes(link, folder).items() if size == entry.size and n.endswith(".BIN")
        ]
        if len(same) == 1:
            patience = _CRC_START + entry.size / _CRC_RATE
            found = remote_crc32(link, f"{folder}/{same[0]}", patience)
            return () if found is None else (found,)
    return ()


def _place(folder: Path, entry: LogEntry, sums: tuple[int, ...]) -> tuple[Path, bool]:
    """(path for the log, whether the log is there already). No other file is overwritten."""
    number = 1
    while True:
        path = folder / (f"log{entry.number}.BIN" if number == 1 else f"log{entry.number}-{number}.BIN")
        if not path.exists():
            return path, False
        if path.stat().st_size == entry.size and (not sums or file_crc32(path) in sums):
            return path, True
        number += 1


def _compare(path: Path, entry: LogEntry, sums: tuple[int, ...]) -> None:
    size = path.stat().st_size
    if size == entry.size and (not sums or file_crc32(path) in sums):
        return
    kept = path.with_name(path.name + ".damaged")
    path.replace(kept)
    wrong = "its checksum differs from the card's"
    if size != entry.size:
        wrong = f"only {size} of {entry.size} bytes arrived"
    raise LinkError(f"log {entry.number} is damaged: {wrong}; it is kept as {kept.name}, fetch it again")


# The vehicle's logs by MAVSDK's log_files plugin, with the interface of `download.LogSource`.


@dataclass(frozen=True)
class MavsdkLogs:
    """Logs by MAVSDK, which restarts an interrupted download from the beginning."""

    link: Link

    def logs(self) -> tuple[LogEntry, ...]:
        """All logs, oldest first. The dates of MAVSDK become seconds since 1970."""
        refuse_download_if_armed(self.link)
        with MavsdkOnLink(self.link) as mavsdk:
            return tuple(_entry(e) for e in _listed(mavsdk, _plugin(mavsdk)))

    def download(self, entry: LogEntry, path: Path) -> Iterator[LogProgress | LogSaved]:
        """Fetch one log into `path` (first as NAME.part); yields progress, then LogSaved."""
        from mavsdk.plugins.log_files import LogFilesResult

        refuse_download_if_armed(self.link)
        partial = path.with_name(path.name + ".part")
        began, steps = self.link.line.monotonic(), deque[tuple[Any, float]]()
        with MavsdkOnLink(self.link) as mavsdk:
            files = _plugin(mavsdk)
            wanted = next((e for e in _listed(mavsdk, files) if e.id == entry.number), None)
            if wanted is None:
                raise LinkError(f"the vehicle has no log {entry.number}")
            with writing(path):
                partial.parent.mkdir(parents=True, exist_ok=True)
                partial.unlink(missing_ok=True)
            files.download_log_file_async(
                wanted, str(partial), lambda result, data, _: steps.append((result, data.progress))
            )
            while True:
                self.link.receive(TURN)
                while steps:
                    result, share = steps.popleft()
                    if result == LogFilesResult.NEXT:
                        yield LogProgress(entry.number, int(share * wanted.size_bytes), wanted.size_bytes)
                        continue
                    if result != LogFilesResult.SUCCESS:
                        raise LinkError(f"MAVSDK did not get log {entry.number} ({result.name.lower()})")
                    with writing(path):
                        partial.replace(path)
                    yield LogSaved(path, path.stat().st_size, self.link.line.monotonic() - began)
                    return


def _plugin(mavsdk: MavsdkOnLink) -> LogFiles:
    from mavsdk.plugins.log_files import LogFiles

    return LogFiles(mavsdk.system)


def _listed(mavsdk: MavsdkOnLink, files: LogFiles) -> list[Any]:
    """The same MAVSDK instance must list and download: it only knows the entries that it listed."""
    from mavsdk.plugins.log_files import LogFilesError, LogFilesResult

    try:
        found: list[Any] = mavsdk.call(files.get_entries)
    except LogFilesError as error:
        if LogFilesResult.NO_LOGFILES.name in str(error):
            return []
        raise LinkError(f"MAVSDK does not list the vehicle's logs ({error})") from error
    return sorted(found, key=lambda e: e.id)


def _entry(found: Any) -> LogEntry:
    date = found.date.decode() if isinstance(found.date, bytes) else str(found.date)
    try:
        seconds = int(datetime.datetime.fromisoformat(date).timestamp())
    except ValueError:
        seconds = 0
    return LogEntry(int(found.id), int(found.size_bytes), seconds)


# Which library fetches logs and parameters (`--via`): pymavlink, or MAVSDK, both through our link.
#
# Both are recorded in the same way and give the same bytes. The default is "mavlink", because it is faster.
# Measured on ArduRover 4.6.3 (SITL, real time, loop rate 100, TCP, MAVSDK 4.1): a log of 54.6 MB came at
# 1.21 MB/s by "mavlink" and 0.39 MB/s by "mavsdk", byte-identical; on a busy computer a log of 11.6 MB at
# 0.45 to 0.95 and 0.06 to 0.48 MB/s. Both read all 1298 parameters in 0.6 s, but MAVSDK needs another 0.4 to
# 0.8 s to find the vehicle, reports no progress, and restarts an interrupted download from the beginning.


Via = Literal["mavlink", "mavsdk"]
DEFAULT: Via = "mavlink"


class ParameterSource(Protocol):
    """Reads and writes parameters; both may raise LinkError."""

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        """Every parameter, by name; progress: called with (number received, total)."""
        ...

    def write(self, name: str, value: float) -> ParameterSet:
        """Set a parameter if it differs, read it back and compare as float32."""
        ...


@dataclass(frozen=True)
class MavlinkParameters:
    """By PARAM_REQUEST_LIST, PARAM_SET and PARAM_REQUEST_READ."""

    link: Link

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        return read_all(self.link, progress)

    def write(self, name: str, value: float) -> ParameterSet:
        return write_parameter(self.link, name, value)


def log_source(link: Link, via: Via = DEFAULT) -> LogSource:
    """The source of logs. With "mavsdk", the first use raises UsageError if that library does not load."""
    if via == "mavlink":
        return MavlinkLogs(link)

    return MavsdkLogs(link)


def parameter_source(link: Link, via: Via = DEFAULT) -> ParameterSource:
    """The source of parameters; errors as in `log_source`."""
    if via == "mavlink":
        return MavlinkParameters(link)
    from rover_sweep.vehicle.parameters import MavsdkParameters

    return MavsdkParameters(link)
