"""Fetches logs into a folder: skips those already there, and compares the new ones with the card."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.events import LogProgress
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.remote_files import crc32, remote_crc32, remote_sizes
from rover_sweep.vehicle.logs.download import LogEntry, LogSource

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
    """The requested logs: a number, 'latest' or 'all'. UsageError, which lists the logs, if there is none.

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
