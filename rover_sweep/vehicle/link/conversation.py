"""A conversation with a vehicle on disk: what was sent and what was received, in order, with times.

A .tlog holds the frames of the vehicle alone, for every tool that reads one. This holds both directions
byte for byte as they went through the connection, its openings and ends included (a reboot is one), so
that tests can play it back to the same code (tests/vehicle/transport_replayed.py).

The file is gzip: a line of JSON (format, what is known), then entries of kind (1 byte), microseconds since
the first entry (8), length of the data (4), data; numbers big-endian.
"""

from __future__ import annotations

import gzip
import json
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any

from rover_sweep.errors import DataRefused
from rover_sweep.files.documents import read_json

FORMAT = "rover-sweep conversation 1"
_HEAD = struct.Struct(">BQI")
_FLUSH_US = 1_000_000  # what a killed program loses of it at most; the .tlog loses nothing


class ConversationKind(IntEnum):
    """What happened. data: the URL opened, the reason refused or ended, the bytes sent or received."""

    OPENED = 0
    REFUSED = 1
    SENT = 2
    UNSENT = 3  # was to be sent on a connection that had ended
    RECEIVED = 4
    ENDED = 5  # by the other side
    CLOSED = 6


@dataclass(frozen=True)
class ConversationEntry:
    """t: s since the first entry."""

    kind: ConversationKind
    t: float
    data: bytes = b""


@dataclass(frozen=True)
class Conversation:
    """about: what stands in the header. whole: the file was closed; else its last second may lack."""

    entries: tuple[ConversationEntry, ...]
    about: Mapping[str, Any] = field(default_factory=dict)
    whole: bool = True


class ConversationWriter:
    """Appends entries. A disk that is full ends the recording, never the connection: `failure` says so."""

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
            self._file.write(_HEAD.pack(kind, us - self._first_us, len(data)) + data)
            if us - self._flushed_us >= _FLUSH_US:
                self._file.flush()
                self._flushed_us = us
        except OSError as error:
            self.failure = f"{self.path} cannot be written ({error.strerror}): the conversation ends there"

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or f"{self.path} cannot be written ({error.strerror})"


def write_conversation(path: Path, conversation: Conversation) -> None:
    """A conversation into a file, as it would have been recorded."""
    writer = ConversationWriter(path, {k: v for k, v in conversation.about.items() if k != "format"})
    for entry in conversation.entries:
        writer.write(entry.kind, round(entry.t * 1e6), entry.data)
    writer.close()


def read_conversation(path: Path) -> Conversation:
    """DataRefused where it is none or is damaged; one whose writer was killed is read as far as it goes."""
    content, whole = _unpacked(path)
    line, newline, body = content.partition(b"\n")
    try:
        about = read_json(line.decode("utf-8"))
        known = about.get("format") == FORMAT
    except (ValueError, AttributeError):
        known = False
    if not newline or not known:
        raise DataRefused(f"{path} is no conversation recording of this program ({FORMAT})")
    entries, at = list[ConversationEntry](), 0
    while at + _HEAD.size <= len(body):
        kind, us, length = _HEAD.unpack_from(body, at)
        if kind not in ConversationKind.__members__.values():
            raise DataRefused(f"{path} is damaged: entry {len(entries)} is of no known kind ({kind})")
        at += _HEAD.size
        if at + length > len(body):
            break
        entries.append(ConversationEntry(ConversationKind(kind), us * 1e-6, body[at : at + length]))
        at += length
    return Conversation(tuple(entries), about, whole)


def _unpacked(path: Path) -> tuple[bytes, bool]:
    """(content as far as it is there, whether the file ends properly)."""
    unpacker = zlib.decompressobj(wbits=31)
    try:
        content = unpacker.decompress(path.read_bytes())
    except OSError as error:
        raise DataRefused(f"{path} cannot be read: {error.strerror}") from error
    except zlib.error as error:
        raise DataRefused(f"{path} is damaged, or no conversation recording: {error}") from error
    return content, unpacker.eof
