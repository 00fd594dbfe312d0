"""What goes to disk while a vehicle is connected: the .tlog, and the folder of a session.

A .tlog is a sequence of (8-byte big-endian microseconds since 1970, MAVLink frame), as pymavlink's
mavlogfile, MAVProxy, Mission Planner and QGroundControl read it. The stamp is the time of arrival.
"""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_STAMP = struct.Struct(">Q")


class TlogWriter:
    """Writes frames unbuffered: after `write` returns they survive the death of this process.

    Bytes that belong to no frame go to `NAME.tlog.noise` (stamp, 4-byte length, bytes), because a
    reader of the .tlog would lose its place over them.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("ab", buffering=0)
        self._last_us = 0

    def write(self, pieces: Sequence[tuple[bytes, bool]]) -> None:
        """Append (bytes, is_frame) pieces that came together, in one write."""
        stamp = _STAMP.pack(self._now_us())
        frames = b"".join(stamp + data for data, is_frame in pieces if is_frame)
        if frames:
            self._file.write(frames)
        noise = b"".join(data for data, is_frame in pieces if not is_frame)
        if noise:
            with self.path.with_name(self.path.name + ".noise").open("ab") as file:
                file.write(stamp + struct.pack(">I", len(noise)) + noise)

    def close(self) -> None:
        self._file.close()

    def _now_us(self) -> int:
        # Lowest two bits zero: readers take them for the number of the link.
        self._last_us = max(self._last_us, time.time_ns() // 1000 & ~3)
        return self._last_us


@dataclass(frozen=True)
class Session:
    """A folder that explains itself: connect.tlog, NAME.tlog of each run, logs (.BIN), session.json."""

    folder: Path

    @classmethod
    def create(cls, folder: Path) -> Session:
        """Make the folder; recordings that lie there already are kept (tlogs get a number)."""
        folder.mkdir(parents=True, exist_ok=True)
        return cls(folder)

    def tlog(self, name: str) -> Path:
        """A path for a new tlog that overwrites none."""
        path, number = self.folder / f"{name}.tlog", 2
        while path.exists():
            path, number = self.folder / f"{name}-{number}.tlog", number + 1
        return path

    def describe(self, content: dict[str, Any]) -> Path:
        """Write session.json: what was run on which vehicle, with which settings, into which files."""
        path = self.folder / "session.json"
        partial = path.with_suffix(".json.part")
        partial.write_text(json.dumps(content, indent=2, default=str) + "\n")
        partial.replace(path)
        return path
