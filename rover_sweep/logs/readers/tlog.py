"""Columns of a telemetry log (.tlog), only for the requested MAVLink messages.

A .tlog is a sequence of records: 8 bytes of arrival time (us, big-endian), then one MAVLink 1 or 2 frame
(https://mavlink.io/en/guide/serialization.html). The frames are found in one pass, and the payloads of
a message are decoded together; layouts and checksum seeds are those of pymavlink's generated classes.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from fastcrc import crc16
from numpy.typing import NDArray

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
STAMP = 8  # bytes of arrival time before a frame
SIGNED, SIGNATURE = 0x01, 13  # incompatibility flag of MAVLink 2; bytes of the signature that follows then
LARGE = 1 << 23  # bytes; from here compiled code is faster, with its import (0.3 s)
_MAGIC = re.compile(b"[\xfe\xfd]")


@dataclass(frozen=True)
class Frames:
    """The frames of one message id: rows (n,) structured; system, component, order (byte offset in the file),
    sequence (modulo 256) and arrival (s, the recorder's clock) of each (n,)."""

    rows: NDArray[np.void]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    order: NDArray[np.int64]
    sequence: NDArray[np.uint8]
    arrival: NDArray[np.float64]

    def __len__(self) -> int:
        return int(self.rows.size)

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the message's fields."""
        return self.rows.dtype.names or ()

    def where(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Frames:
        """The frames selected by a mask `keep` (n,), or by indices in their order."""
        return Frames(
            self.rows[keep],
            self.system[keep],
            self.component[keep],
            self.order[keep],
            self.sequence[keep],
            self.arrival[keep],
        )


@dataclass(frozen=True)
class Walk:
    """The positions of the frames of a .tlog.

    starts: byte offsets of the requested frames by message id. frame_count: all frames. damaged: places where
    a frame was lost to wrong bytes. bad_bytes: bytes outside of records.
    """

    starts: dict[int, list[int]]
    frame_count: int
    damaged: int
    bad_bytes: int


@dataclass(frozen=True)
class Tlog(Walk):
    """The requested messages of a .tlog by name, and counts of losses. size: of the file, bytes."""

    messages: dict[str, Frames]
    size: int


def open_tlog(path: str | Path, names: frozenset[str]) -> Tlog:
    """Read the messages `names` of a .tlog."""
    return parse_tlog(Path(path).read_bytes(), names)


def parse_tlog(data: bytes, names: frozenset[str]) -> Tlog:
    """As `open_tlog`, from the bytes of a file."""
    wanted = {_message(name).id: name for name in names}
    found = walk(data, frozenset(wanted))
    raw = np.frombuffer(data, np.uint8)
    starts = {wanted[number]: np.array(at, np.int64) for number, at in found.starts.items()}
    messages = {name: _decode(raw, at, name) for name, at in starts.items()}
    return Tlog(found.starts, found.frame_count, found.damaged, found.bad_bytes, messages, len(data))


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


def walk(data: bytes, wanted: frozenset[int] | None = None) -> Walk:
    """Finds all frames of a .tlog with a correct checksum, or of a message without a known one.

    wanted: message ids, None for all. A damaged frame costs no other frame: the search continues at the next
    frame with a correct checksum, also when the length or the time stamp is damaged.
    """
    found: defaultdict[int, list[int]] = defaultdict(list)
    at = count = damaged = bad = 0
    size = len(data)
    follow = _follower(data)
    while at + STAMP + 8 <= size:
        at, starts, numbers = follow(at, size - STAMP - 12)
        count += len(starts)
        for start, number in zip(starts, numbers, strict=True):
            if wanted is None or number in wanted:
                found[number].append(start)
        start = at + STAMP
        if start + 8 > size:
            break
        end, number = _header(data, start)
        right = end > 0 and _checksum_right(data, start, end, number)
        if right or (right is None and _goes_on(data, end)):
            if wanted is None or number in wanted:
                found[number].append(start)
            at = end
            count += 1
            continue
        if end > 0 and _goes_on(data, end) and _next_frame(data, start + 1, end) == end:
            damaged, at = damaged + 1, end
            continue
        following = _next_frame(data, start + 1, size)
        after = following - STAMP if following < size else size
        damaged += following < size
        bad += after - at
        at = after
    return Walk(found, count, damaged, bad + size - at)


def _follower(data: bytes) -> Callable[[int, int], tuple[int, list[int], list[int]]]:
    """`_sound_frames` of the data, compiled where that pays."""
    if len(data) < LARGE:
        return partial(_sound_frames, data)
    from rover_sweep.logs.readers.compiled_scan import follower

    return follower(data, _seeds())


def _sound_frames(data: bytes, at: int, last: int) -> tuple[int, list[int], list[int]]:
    """Follows records with a known message and a correct checksum: (end of the last, starts, message ids).

    last: largest offset at which a record is looked at. One loop without calls of its own, since a log has
    half a million frames an hour.
    """
    seeds, checksum = _seeds(), crc16.mcrf4xx
    starts: list[int] = []
    numbers: list[int] = []
    size = len(data)
    while at <= last:
        start = at + STAMP
        if data[start] == MAGIC_2:
            _, length, flags, _, _, _, _, low, middle, high = data[start : start + 10]
            number = low | middle << 8 | high << 16
            tail = start + 10 + length
            end = tail + 2 + SIGNATURE if flags & SIGNED else tail + 2
        elif data[start] == MAGIC_1:
            number = data[start + 5]
            tail = start + 6 + data[start + 1]
            end = tail + 2
        else:
            break
        seed = seeds.get(number)
        if seed is None or end > size:
            break
        if checksum(data[start + 1 : tail] + seed) != data[tail] | data[tail + 1] << 8:
            break
        starts.append(start)
        numbers.append(number)
        at = end
    return at, starts, numbers


def _header(data: bytes, start: int) -> tuple[int, int]:
    """(end, message id) of the frame that seems to start there; end 0 if it cannot be complete."""
    size = len(data)
    if start + 8 > size:
        return 0, 0
    if data[start] == MAGIC_1:
        end, number = start + 8 + data[start + 1], data[start + 5]
    elif data[start] == MAGIC_2 and start + 12 <= size:
        end = start + 12 + data[start + 1] + (SIGNATURE if data[start + 2] & SIGNED else 0)
        number = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
    else:
        return 0, 0
    return (end, number) if end <= size else (0, 0)


def _goes_on(data: bytes, end: int) -> bool:
    """True when another record, or the end of the file, follows."""
    return end == len(data) or (end + STAMP < len(data) and data[end + STAMP] in (MAGIC_1, MAGIC_2))


def _next_frame(data: bytes, start: int, stop: int) -> int:
    """Start of the next frame with a correct checksum, `stop` for none before."""
    for match in _MAGIC.finditer(data, start, stop):
        end, number = _header(data, match.start())
        if end > 0 and _checksum_right(data, match.start(), end, number):
            return match.start()
    return stop


def _checksum_right(data: bytes, start: int, end: int, number: int) -> bool | None:
    """True when the frame's checksum is correct; None for an unknown message."""
    seed = _seeds().get(number)
    if seed is None:
        return None
    at = start + data[start + 1] + (10 if data[start] == MAGIC_2 else 6)
    right = crc16.mcrf4xx(data[start + 1 : at] + seed)
    return bool(right == data[at] | data[at + 1] << 8)


@cache
def _seeds() -> dict[int, bytes]:
    """The byte that the checksum of each message also covers."""
    from pymavlink.dialects.v20 import ardupilotmega

    return {number: bytes([message.crc_extra]) for number, message in ardupilotmega.mavlink_map.items()}


def _decode(raw: NDArray[np.uint8], starts: NDArray[np.int64], name: str) -> Frames:
    """The frames at `starts`."""
    layout = _dtype(name)
    payload = np.zeros((starts.size, layout.itemsize), np.uint8)
    new = raw[starts] == MAGIC_2
    shapes = new * 256 + raw[starts + 1].astype(np.int64)
    for shape in np.flatnonzero(np.bincount(shapes)).tolist():
        version, length = divmod(shape, 256)
        k = np.flatnonzero(shapes == shape)
        body = min(length, layout.itemsize)  # a newer sender may add fields; trailing zeros are not sent
        payload[k, :body] = raw[starts[k, None] + (10 if version else 6) + np.arange(body)]
    sequence = starts + np.where(new, 4, 2)
    stamps = np.ascontiguousarray(raw[starts[:, None] - STAMP + np.arange(STAMP)]).view(">u8")[:, 0] * 1e-6
    return Frames(
        payload.view(layout)[:, 0], raw[sequence + 1], raw[sequence + 2], starts, raw[sequence], stamps
    )
