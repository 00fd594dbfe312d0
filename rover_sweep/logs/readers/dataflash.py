"""Columns of an ArduPilot DataFlash log (.BIN), only for the requested message types.

A log is a sequence of messages: 0xA3 0x95, a type byte, a body. FMT messages (type 128) in the same log
define the layout of the bodies (source: ArduPilot libraries/AP_Logger/LogStructure.h). The file is scanned
once for message headers with numpy; bodies are decoded as columns when their type is read.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_sweep.errors import DataRefused

Array = NDArray[np.float64]

HEAD = (0xA3, 0x95)
FMT_TYPE, FMT_LENGTH = 128, 89
BLOCK = 1 << 25  # bytes per step of the scan; limits the memory for a log of a gigabyte

# Format character -> (numpy type, factor to the documented unit); AP_Logger/LogStructure.h
FORMATS: dict[str, tuple[str, float]] = {
    "b": ("<i1", 1),
    "B": ("<u1", 1),
    "M": ("<u1", 1),
    "h": ("<i2", 1),
    "H": ("<u2", 1),
    "i": ("<i4", 1),
    "I": ("<u4", 1),
    "q": ("<i8", 1),
    "Q": ("<u8", 1),
    "g": ("<f2", 1),
    "f": ("<f4", 1),
    "d": ("<f8", 1),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1e-7),
    "n": ("S4", 0),
    "N": ("S16", 0),
    "Z": ("S64", 0),
    "a": ("64u1", 0),
}
TEXTS, ARRAYS = "nNZ", "a"


@dataclass(frozen=True)
class MessageFormat:
    """The layout of the messages of `type`, from one FMT message. length: of the whole message, bytes."""

    type: int
    name: str
    length: int
    format: str
    columns: tuple[str, ...]

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """The whole message with its three bytes of header."""
        fields = [("_head", "3u1")]
        fields += [(c, FORMATS[f][0]) for c, f in zip(self.columns, self.format, strict=True)]
        return np.dtype(fields)

    @cached_property
    def numbers(self) -> frozenset[str]:
        """Columns that hold a number."""
        pairs = zip(self.columns, self.format, strict=True)
        return frozenset(column for column, code in pairs if code not in TEXTS + ARRAYS)

    @property
    def stamp(self) -> tuple[str, float] | None:
        """(column, s per unit) of the time since boot; None without one.

        In logs before 2015 GPS.TimeMS is the time of the GPS week and GPS.T the time since boot; MSG and PARM
        have none (source: libraries/DataFlash/DataFlash.h of ArduRover 2.4x).
        """
        of_week = {"TimeMS", "Week", "T"} <= self.numbers
        stamps = (("TimeUS", 1e-6), ("T", 1e-3) if of_week else ("TimeMS", 1e-3))
        return next((stamp for stamp in stamps if stamp[0] in self.numbers), None)


@dataclass(frozen=True)
class DataFlash:
    """An indexed log. Read columns with `rows`, `column` and `text`.

    formats: by message name. positions: byte offsets (n,) of the messages, by name. bad_bytes: bytes outside
    complete messages (damage, or a cut at the end: `tail_bytes`). breaks: number of messages that are not
    followed by a message. message_count: of all types.
    """

    data: NDArray[np.uint8]
    formats: dict[str, MessageFormat]
    positions: dict[str, NDArray[np.int64]]
    bad_bytes: int
    tail_bytes: int
    breaks: int
    message_count: int

    def count(self, name: str) -> int:
        """Number of messages of that name, 0 for an undefined name."""
        return int(self.positions[name].size) if name in self.positions else 0

    def has(self, name: str, *columns: str) -> bool:
        """True when there are such messages, with all these columns as numbers."""
        return self.count(name) > 0 and set(columns) <= self.formats[name].numbers

    def has_text(self, name: str, column: str) -> bool:
        """True when there are such messages, with this column as text."""
        if not self.count(name) or column not in self.formats[name].columns:
            return False
        layout = self.formats[name]
        return layout.format[layout.columns.index(column)] in TEXTS

    def rows(self, name: str) -> NDArray[np.void]:
        """All messages of a name (n,), structured as stored: integers without their factor."""
        layout = self.formats[name]
        if self.count(name) == 0:
            return np.empty(0, layout.dtype)
        windows = np.lib.stride_tricks.sliding_window_view(self.data, layout.length)
        return np.ascontiguousarray(windows[self.positions[name]]).view(layout.dtype)[:, 0]

    def column(self, name: str, column: str, rows: NDArray[np.void] | None = None) -> Array:
        """A numeric column (n,) in the documented unit (degrees, not centidegrees)."""
        layout = self.formats[name]
        factor = FORMATS[layout.format[layout.columns.index(column)]][1]
        values = (self.rows(name) if rows is None else rows)[column].astype(float)
        return values * factor if factor != 1 else values

    def text(self, name: str, column: str) -> list[str]:
        """A column of text as logged, without padding; not yet printable."""
        return [cell.split(b"\0")[0].decode("ascii", "replace") for cell in self.rows(name)[column].tolist()]

    def seconds(self, name: str, rows: NDArray[np.void] | None = None) -> Array:
        """Time since boot (n,) [s] of each message; without a time, that of the previous message with one.

        DataRefused for selected rows of messages without time, as a sensor without time cannot be used.
        """
        stamp = self.formats[name].stamp
        if stamp is not None:
            return (self.rows(name) if rows is None else rows)[stamp[0]].astype(float) * stamp[1]
        if rows is None:
            return self._seconds_before(name)
        raise DataRefused(
            f"the {name} messages of the log have no time (TimeUS or TimeMS), only "
            f"{', '.join(self.formats[name].columns)}: the firmware is too old, or the log is damaged; "
            "record again with ArduRover 4.1 or newer"
        )

    def _seconds_before(self, name: str) -> Array:
        """Times (n,) [s] from the most frequent message with a time."""
        stamped = [n for n, layout in self.formats.items() if layout.stamp is not None and self.count(n)]
        if not stamped:
            return np.zeros(self.count(name))
        clock = max(stamped, key=self.count)
        k = np.searchsorted(self.positions[clock], self.positions[name], "right") - 1
        return self.seconds(clock)[np.clip(k, 0, None)]


def open_parts(path: str | Path) -> tuple[DataFlash, ...]:
    """The logs in one .BIN file, usually one, each with its own formats and clock.

    ArduPilot starts each log, and nothing else, with the format of FMT.
    """
    data = _mapped(path)
    heads = _headers(data)
    heads = heads[heads + FMT_LENGTH <= data.size]
    for at, byte in ((2, FMT_TYPE), (3, FMT_TYPE), (4, FMT_LENGTH)):
        heads = heads[data[heads + at] == byte]
    edges = [0, *heads[1:].tolist(), data.size]
    return tuple(index(data[a:b]) for a, b in pairwise(edges))


def _mapped(path: str | Path) -> NDArray[np.uint8]:
    size = Path(path).stat().st_size
    return np.memmap(path, dtype=np.uint8, mode="r") if size else np.empty(0, np.uint8)


def index(data: NDArray[np.uint8]) -> DataFlash:
    """The formats and messages of a log in `data` (n,) bytes; no formats if it holds none."""
    by_type = {
        layout.type: layout for layout in _formats(data).values()
    }  # of two with one type, one is damaged
    formats = {layout.name: layout for layout in by_type.values()}
    lengths = np.zeros(256, np.int64)
    for layout in formats.values():
        lengths[layout.type] = layout.length
    starts, good_bytes = _messages(data, lengths)
    kinds = data[starts + 2] if starts.size else np.empty(0, np.uint8)
    order = np.argsort(kinds, kind="stable")
    edges = np.searchsorted(kinds[order], np.arange(257))
    positions = {f.name: starts[order[edges[f.type] : edges[f.type + 1]]] for f in formats.values()}
    ends = starts + lengths[kinds]
    tail = int(data.size - ends[-1]) if starts.size else int(data.size)
    breaks = int(np.sum(starts[1:] != ends[:-1]))
    return DataFlash(data, formats, positions, int(data.size - good_bytes), tail, breaks, int(starts.size))


def _headers(data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Offsets (n,) of all byte pairs that look like a header, ascending."""
    found = []
    for start in range(0, max(data.size - 2, 0), BLOCK):
        block = data[start : start + BLOCK + 1]
        first = np.flatnonzero(block[:-1] == HEAD[0])
        hits = first[block[first + 1] == HEAD[1]] + start
        found.append(hits[hits < data.size - 2])
    return np.concatenate(found) if found else np.empty(0, np.int64)


def _formats(data: NDArray[np.uint8]) -> dict[str, MessageFormat]:
    """{name: format}; damaged FMT messages are ignored, the last of a name is used."""
    heads = _headers(data)
    heads = heads[data[heads + 2] == FMT_TYPE]
    formats = {}
    for start in heads[heads + FMT_LENGTH <= data.size].tolist():
        layout = _format(data[start + 3 : start + FMT_LENGTH].tobytes())
        if layout is not None:
            formats[layout.name] = layout
    return formats


def _format(body: bytes) -> MessageFormat | None:
    """The format of one FMT message, None if its parts contradict each other."""
    kind, length = body[0], body[1]
    try:
        name, layout, labels = (
            b.split(b"\0")[0].decode("ascii") for b in (body[2:6], body[6:22], body[22:86])
        )
    except UnicodeDecodeError:
        return None
    columns = tuple(labels.split(",")) if labels else ()
    if not name.isalnum() or len(columns) != len(layout) or not set(layout) <= set(FORMATS):
        return None
    found = MessageFormat(kind, name, length, layout, columns)
    return found if len(set(columns)) == len(columns) and found.dtype.itemsize == length else None


def _messages(data: NDArray[np.uint8], lengths: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Offsets (n,) of the messages, and the number of bytes they cover.

    Two bytes of a payload may look like a header, so the headers are followed from message to message. A
    message is valid if another one, or the end of the file, follows directly; otherwise the search continues
    at the next header with such a follower. The loop takes one step only where the next header is not the
    expected one.
    """
    heads = _headers(data)
    heads = heads[lengths[data[heads + 2]] > 0]
    if heads.size == 0:
        return heads, 0
    follower = heads + lengths[data[heads + 2]]
    target = np.searchsorted(heads, follower)
    chained = (follower == data.size) | (heads[np.minimum(target, heads.size - 1)] == follower)
    following = np.flatnonzero(chained)
    stops = np.flatnonzero(~chained | (target != np.arange(heads.size) + 1))
    keep, at = [], 0
    while at < heads.size:
        if not chained[at]:
            later = np.searchsorted(following, at)
            if later == following.size:
                break
            at = int(following[later])
        stop_index = np.searchsorted(stops, at)
        stop = int(stops[stop_index]) if stop_index < stops.size else heads.size - 1
        last = stop + 1 if chained[stop] else stop
        keep.append(np.arange(at, last))
        at = max(int(target[stop]), stop + 1) if chained[stop] else stop
    starts = heads[np.concatenate(keep)] if keep else heads[:0]
    return starts, int(lengths[data[starts + 2]].sum())
