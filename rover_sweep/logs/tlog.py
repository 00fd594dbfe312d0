"""Columns out of a telemetry log (.tlog), only for the MAVLink messages that are asked for.

A .tlog is a row of records: 8 bytes of arrival time (us, big-endian), then one MAVLink 1 or 2 frame
(https://mavlink.io/en/guide/serialization.html). The frames are found in one walk, and the payloads of
a message are decoded together; layouts and checksum seeds come from pymavlink's generated classes.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
STAMP = 8  # bytes of arrival time before a frame
SIGNED = 0x01  # incompatibility flag of MAVLink 2: a signature of 13 bytes follows


@dataclass(frozen=True)
class Frames:
    """The frames of one message id: rows (n,) structured; system, component, order in the file (n,)."""

    rows: NDArray[np.void]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    order: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.rows.size)

    def where(self, keep: NDArray[np.bool_]) -> Frames:
        """The frames for which `keep` (n,) holds."""
        return Frames(self.rows[keep], self.system[keep], self.component[keep], self.order[keep])


@dataclass(frozen=True)
class Tlog:
    """The wanted messages of a .tlog by name, and what was lost.

    frame_count: frames of all kinds. bad_bytes: bytes outside whole frames. bad_checksums: wanted frames
    that were dropped for their checksum. size: of the file, bytes.
    """

    messages: dict[str, Frames]
    frame_count: int
    bad_bytes: int
    bad_checksums: int
    size: int


def open_tlog(path: str | Path, names: frozenset[str]) -> Tlog:
    """Read the messages `names` of a .tlog."""
    return parse(Path(path).read_bytes(), names)


def parse(data: bytes, names: frozenset[str]) -> Tlog:
    """As `open_tlog`, from the bytes of a file."""
    wanted = {_message(name).id: name for name in names}
    starts, count, bad = walk(data, frozenset(wanted))
    raw = np.frombuffer(data, np.uint8)
    messages, failed = {}, 0
    for number, found in starts.items():
        frames, wrong = _decode(raw, np.array(found, np.int64), wanted[number])
        failed += wrong
        if len(frames):
            messages[wanted[number]] = frames
    return Tlog(messages, count, bad, failed, len(data))


def _message(name: str) -> Any:
    """pymavlink's generated class of a message."""
    from pymavlink.dialects.v20 import ardupilotmega

    return getattr(ardupilotmega, f"MAVLink_{name.lower()}_message")


@cache
def _dtype(name: str) -> np.dtype[np.void]:
    """Payload of a message as a packed little-endian structure, in the order of the wire."""
    message = _message(name)
    codes = bytes(message.native_format).decode().lstrip("<")
    fields: list[Any] = []
    for field, code, length in zip(message.ordered_fieldnames, codes, message.array_lengths, strict=True):
        if code == "c":
            fields.append((field, f"S{max(length, 1)}"))
        else:
            base = np.dtype(f"<{code}") if code not in "bB" else np.dtype("i1" if code == "b" else "u1")
            fields.append((field, base, (length,)) if length else (field, base))
    return np.dtype(fields)


def walk(data: bytes, wanted: frozenset[int] | None = None) -> tuple[dict[int, list[int]], int, int]:
    """Offsets of the wanted frames by message id, the number of all frames, and the bytes outside of them.

    wanted: ids of messages, None for all.
    """
    found: defaultdict[int, list[int]] = defaultdict(list)
    at = previous = count = good = 0
    size = len(data)
    while at + STAMP + 8 <= size:
        start = at + STAMP
        magic = data[start]
        if magic == MAGIC_2:
            length = 12 + data[start + 1] + (13 if data[start + 2] & SIGNED else 0)
        elif magic == MAGIC_1:
            length = 8 + data[start + 1]
        else:
            at = previous = _resynchronised(data, previous + 1)
            continue
        if start + length > size:
            break
        number = (
            data[start + 5]
            if magic == MAGIC_1
            else data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
        )
        if wanted is None or number in wanted:
            found[number].append(start)
        previous, at = at, start + length
        count += 1
        good += STAMP + length
    return found, count, max(size - good, 0)


def _resynchronised(data: bytes, start: int) -> int:
    """Where the next record starts that another one, or the end of the file, follows."""
    size = len(data)
    for at in range(start, size - STAMP - 12):
        magic = data[at + STAMP]
        if magic == MAGIC_2:
            end = at + STAMP + 12 + data[at + STAMP + 1] + (13 if data[at + STAMP + 2] & SIGNED else 0)
        elif magic == MAGIC_1:
            end = at + STAMP + 8 + data[at + STAMP + 1]
        else:
            continue
        if end == size or (end + STAMP < size and data[end + STAMP] in (MAGIC_1, MAGIC_2)):
            return at
    return size


def _decode(raw: NDArray[np.uint8], starts: NDArray[np.int64], name: str) -> tuple[Frames, int]:
    """The frames at `starts`, and how many were dropped for their checksum."""
    layout = _dtype(name)
    payload = np.zeros((starts.size, layout.itemsize), np.uint8)
    system, component = np.zeros(starts.size, np.uint8), np.zeros(starts.size, np.uint8)
    right = np.zeros(starts.size, bool)
    new = (raw[starts] == MAGIC_2).astype(np.int64)
    shapes = np.stack((new, raw[starts + 1].astype(np.int64)))
    for version, length in np.unique(shapes, axis=1).T.tolist():
        k = np.flatnonzero((shapes[0] == version) & (shapes[1] == length))
        head = 10 if version else 6
        frame = raw[starts[k, None] + np.arange(head + length + 2)]
        seed = np.full((k.size, 1), _message(name).crc_extra, np.uint8)
        crc = frame[:, -2].astype(np.uint16) | frame[:, -1].astype(np.uint16) << 8
        right[k] = _checksum(np.hstack((frame[:, 1:-2], seed))) == crc
        body = min(length, layout.itemsize)  # a newer sender may add fields; zeros at the end are left out
        payload[k, :body] = frame[:, head : head + body]
        system[k], component[k] = (
            frame[:, head - (5 if version else 3)],
            frame[:, head - (4 if version else 2)],
        )
    frames = Frames(payload.view(layout)[:, 0], system, component, starts)
    return frames.where(right), int(starts.size - right.sum())


def _checksum(rows: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """CRC-16/MCRF4XX (X.25 of MAVLink) of each row (n, k) of bytes."""
    crc = np.full(rows.shape[0], 0xFFFF, np.uint16)
    table = _crc_table()
    for column in rows.T:
        crc = (crc >> np.uint16(8)) ^ table[(crc ^ column) & np.uint16(0xFF)]
    return crc


@cache
def _crc_table() -> NDArray[np.uint16]:
    value = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        value = np.where(value & 1, value >> np.uint16(1) ^ np.uint16(0x8408), value >> np.uint16(1))
    return value.astype(np.uint16)
