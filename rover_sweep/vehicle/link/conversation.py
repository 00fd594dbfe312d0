"""A recorded conversation with a vehicle: everything sent and received, in order, with times.

A .tlog holds only the vehicle's frames, for all tools that read a .tlog. This file holds both directions
byte for byte, and when the connection opened and ended (a reboot ends it), so
that tests can play it back to the same code (tests/vehicle/transport_replayed.py).

The file is gzip: a line of JSON (the header), then entries: kind (1 byte), microseconds since the first
entry (8), length of the data (4), data; numbers big-endian.
"""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any

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
