"""Connections recorded in both directions (see `conversation`)."""

from __future__ import annotations

import datetime
import gzip
import io
import json
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import Any

from rover_sweep._version import __version__
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.files.documents import numbered
from rover_sweep.vehicle.link.transport import Line, LiveLine, Transport

# A recorded conversation with a vehicle: everything sent and received, in order, with times.
#
# A .tlog holds only the vehicle's frames, for all tools that read a .tlog. This file holds both directions
# byte for byte, and when the connection opened and ended (a reboot ends it), so
# that tests can play it back to the same code (tests/vehicle/transport_replayed.py).
#
# The file is gzip: a line of JSON (the header), then entries: kind (1 byte), microseconds since the first
# entry (8), length of the data (4), data; numbers big-endian.


FORMAT = "rover-sweep conversation 1"
HEAD = struct.Struct(">BQI")  # kind, us since the first entry, length
_FLUSH_US = 1_000_000  # a killed program loses at most that much of it; the .tlog loses nothing


class ConversationKind(IntEnum):
    """What happened. data: the URL opened, the reason refused or ended, the bytes sent or received."""

    OPENED = 0
    REFUSED = 1
    SENT = 2
    UNSENT = 3  # not sent, because the connection had ended
    RECEIVED = 4
    ENDED = 5  # by the other side
    CLOSED = 6


class ConversationWriter:
    """Appends entries. A full disk ends the recording, never the connection: see `failure`."""

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self.path, self.failure = path, ""
        self._first_us: int | None = None
        self._flushed_us = 0
        self._file = gzip.GzipFile(path, "wb", 6)
        self._file.write(json.dumps({"format": FORMAT, **about}).encode() + b"\n")

    def write(self, kind: ConversationKind, us: int, data: bytes = b"") -> None:
        """us: of a clock that never goes back."""
        if self.failure:
            return
        self._first_us = us if self._first_us is None else self._first_us
        try:
            self._file.write(HEAD.pack(kind, us - self._first_us, len(data)) + data)
            if us - self._flushed_us >= _FLUSH_US:
                self._file.flush()
                self._flushed_us = us
        except OSError as error:
            self.failure = f"{self.path} cannot be written ({error.strerror}); its recording stops here"

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or f"{self.path} cannot be written ({error.strerror})"


# Records the .tlog while a vehicle is connected.
#
# A .tlog is a sequence of (8-byte big-endian microseconds since 1970, MAVLink frame), as pymavlink's
# mavlogfile, MAVProxy, Mission Planner and QGroundControl read it. The stamp is the time of arrival.


_STAMP = struct.Struct(">Q")


class TlogWriter:
    """Writes frames unbuffered: after `write` returns they survive the end of this process.

    Bytes that belong to no frame go to `NAME.tlog.noise` (stamp, 4-byte length, bytes), because they would
    disturb a reader of the .tlog. UsageError if the disk is full; it is raised once, and later frames are not
    recorded, so that the link can still stop the vehicle.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._last_us, self._failed = 0, False
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("ab", buffering=0)

    def write(self, pieces: Sequence[tuple[bytes, bool]]) -> None:
        """Append (bytes, is_frame) pieces that came together."""
        if self._failed:
            return
        stamp = _STAMP.pack(self._now_us())
        frames = b"".join(stamp + data for data, is_frame in pieces if is_frame)
        noise = b"".join(data for data, is_frame in pieces if not is_frame)
        try:
            with writing(self.path):
                _write_all(self._file, frames)
                if noise:
                    with self.path.with_name(self.path.name + ".noise").open("ab", buffering=0) as file:
                        _write_all(file, stamp + struct.pack(">I", len(noise)) + noise)
        except UsageError:
            self._failed = True
            raise

    def close(self) -> None:
        self._file.close()

    def _now_us(self) -> int:
        # Lowest two bits zero: readers interpret them as the number of the link.
        self._last_us = max(self._last_us, time.time_ns() // 1000 & ~3)
        return self._last_us


def _write_all(file: io.FileIO, data: bytes) -> None:
    """Write all data: an unbuffered file may take only a part of it at a time."""
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError on a recording's file into a UsageError with a sentence."""
    try:
        yield
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written ({error.strerror}), so nothing more is recorded there; "
            "free some space, or give another folder"
        ) from error


def conversation_in(folder: Path) -> Path:
    """A path for a new conversation in a session's folder; never an existing file."""
    return next(path for path in numbered(folder / "session.conversation") if not path.exists())


class RecordedLine:
    """A line that records everything that goes over it, from its first connection to `close`.

    failure: why the recording ended early, else ''. Use as a context manager.
    """

    def __init__(self, path: Path, line: Line | None = None, about: Mapping[str, Any] | None = None) -> None:
        self._line = line or LiveLine()
        began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = ConversationWriter(
                path, {"rover_sweep": __version__, "began": began, **(about or {})}
            )

    @property
    def failure(self) -> str:
        return self._writer.failure

    def open(self, url: str, timeout: float = 5.0) -> Transport:
        try:
            transport = self._line.open(url, timeout)
        except LinkError as error:
            self.note(ConversationKind.REFUSED, str(error).encode())
            raise
        self.note(ConversationKind.OPENED, url.encode())
        return RecordedTransport(transport, self)

    def monotonic(self) -> float:
        return self._line.monotonic()

    def since_boot(self) -> float:
        return self._line.since_boot()

    def wall(self) -> float:
        return self._line.wall()

    def sleep(self, seconds: float) -> None:
        self._line.sleep(seconds)

    def note(self, kind: ConversationKind, data: bytes = b"") -> None:
        """Write an entry stamped now."""
        self._writer.write(kind, round(self._line.monotonic() * 1e6), data)

    def close(self) -> None:
        self._writer.close()

    def __enter__(self) -> RecordedLine:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RecordedTransport(Transport):
    """A connection that passes everything to its line for recording."""

    def __init__(self, transport: Transport, line: RecordedLine) -> None:
        self._transport, self._line = transport, line

    def receive(self, timeout: float) -> bytes:
        try:
            data = self._transport.receive(timeout)
        except (OSError, ValueError) as error:
            self._line.note(ConversationKind.ENDED, str(error).encode())
            raise
        if data:
            self._line.note(ConversationKind.RECEIVED, data)
        return data

    def send(self, data: bytes) -> None:
        try:
            self._transport.send(data)
        except OSError:
            self._line.note(ConversationKind.UNSENT, data)
            raise
        self._line.note(ConversationKind.SENT, data)

    def settle(self, system: int) -> None:
        self._transport.settle(system)

    def believe(self, authentic: Callable[[bytes], bool]) -> None:
        self._transport.believe(authentic)

    def remark(self) -> str:
        return self._transport.remark()

    def close(self) -> None:
        self._transport.close()
        self._line.note(ConversationKind.CLOSED)
