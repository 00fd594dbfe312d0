"""Records the .tlog while a vehicle is connected.

A .tlog is a sequence of (8-byte big-endian microseconds since 1970, MAVLink frame), as pymavlink's
mavlogfile, MAVProxy, Mission Planner and QGroundControl read it. The stamp is the time of arrival.
"""

from __future__ import annotations

import io
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rover_sweep.errors import UsageError

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
