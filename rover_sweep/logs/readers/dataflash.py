"""Columns of an ArduPilot DataFlash log (.BIN), only for the requested message types.

A log is a sequence of messages: 0xA3 0x95, a type byte, a body. FMT messages (type 128) in the same log
define the layout of the bodies (source: ArduPilot libraries/AP_Logger/LogStructure.h). The file is indexed
once, and never copied as a whole; bodies are decoded as columns when their type is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused
from rover_sweep.logs.readers.dataflash_index import Stretch, give_back, messages_of, messages_of_type

FMT_TYPE, FMT_LENGTH = 128, 89

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
SIZES = {code: np.dtype(kind).itemsize for code, (kind, _) in FORMATS.items()}  # bytes


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

    formats: by message name. lengths (256,): bytes of a message by type. counts (256,): messages by type.
    bad_bytes: bytes outside complete messages (damage, or a cut at the end: `tail_bytes`). breaks: number of
    messages that are not followed by a message. message_count: of all types.
    """

    data: NDArray[np.uint8]
    formats: dict[str, MessageFormat]
    lengths: NDArray[np.int64]
    stretches: tuple[Stretch, ...]
    counts: NDArray[np.int64]
    bad_bytes: int
    tail_bytes: int
    breaks: int
    message_count: int

    def count(self, name: str) -> int:
        """Number of messages of that name, 0 for an undefined name."""
        return int(self.counts[self.formats[name].type]) if name in self.formats else 0

    def has(self, name: str, *columns: str) -> bool:
        """True when there are such messages, with all these columns as numbers."""
        return self.count(name) > 0 and set(columns) <= self.formats[name].numbers

    def has_text(self, name: str, column: str) -> bool:
        """True when there are such messages, with this column as text."""
        if not self.count(name) or column not in self.formats[name].columns:
            return False
        layout = self.formats[name]
        return layout.format[layout.columns.index(column)] in TEXTS

    def positions(self, name: str) -> NDArray[np.int64]:
        """Byte offsets (n,) of the messages of a name, ascending."""
        found = list(self._positions(name))
        return np.concatenate(found) if found else np.empty(0, np.int64)

    def rows(self, name: str, *columns: str) -> NDArray[np.void]:
        """All messages of a name (n,), structured as stored: integers without their factor.

        columns: only these are kept, which saves memory; none for all.
        """
        whole = self.formats[name].dtype
        kept = [(c, whole[c]) for c in dict.fromkeys(columns)]
        out = np.empty(self.count(name), kept or whole)
        done = 0
        for rows in self._blocks(name):
            part = out[done : done + rows.size]
            if kept:
                for c, _ in kept:
                    part[c] = rows[c]
            else:
                part[:] = rows
            done += rows.size
        return out

    def column(self, name: str, column: str, rows: NDArray[np.void] | None = None) -> Array:
        """A numeric column (n,) in the documented unit (degrees, not centidegrees)."""
        layout = self.formats[name]
        factor = FORMATS[layout.format[layout.columns.index(column)]][1]
        return self._scaled(name, column, factor, rows)

    def text(self, name: str, column: str) -> list[str]:
        """A column of text as logged, without padding; not yet printable."""
        return [
            cell.split(b"\0")[0].decode("ascii", "replace")
            for cell in self.rows(name, column)[column].tolist()
        ]

    def seconds(self, name: str, rows: NDArray[np.void] | None = None) -> Array:
        """Time since boot (n,) [s] of each message; without a time, that of the previous message with one.

        DataRefused for selected rows of messages without time, as a sensor without time cannot be used.
        """
        stamp = self.formats[name].stamp
        if stamp is not None:
            return self._scaled(name, *stamp, rows)
        if rows is None:
            return self._seconds_before(name)
        raise DataRefused(
            f"the {name} messages of the log have no time (TimeUS or TimeMS), only "
            f"{', '.join(self.formats[name].columns)}: the firmware is too old, or the log is damaged; "
            "record again with ArduRover 4.1 or newer"
        )

    def losses(self) -> list[tuple[float, float, int]]:
        """(last time [s] before, first time after, bytes) of each place that belongs to no message.

        At the begin and the end of the file the one time that is known counts twice; what the end cuts off
        is no loss.
        """
        edges: list[tuple[int, int]] = []
        end = 0
        for stretch in self.stretches:
            starts = stretch.starts(self.lengths)
            ends = starts + self.lengths[stretch.kinds]
            before = np.concatenate(([end], ends[:-1]))
            edges += [(int(before[k]), int(starts[k])) for k in np.flatnonzero(starts > before)]
            end = int(ends[-1])
        clock = self._clock()
        if not edges or not clock:
            return [(0.0, 0.0, b - a) for a, b in edges]
        at, t = self.positions(clock), self.seconds(clock)
        last = t.size - 1
        places = [(np.searchsorted(at, a), np.searchsorted(at, b), b - a) for a, b in edges]
        return [(float(t[max(j - 1, 0)]), float(t[min(k, last)]), size) for j, k, size in places]

    def _clock(self) -> str:
        """The most frequent message with a time, "" without one."""
        stamped = [n for n, layout in self.formats.items() if layout.stamp is not None and self.count(n)]
        return max(stamped, key=self.count, default="")

    def _seconds_before(self, name: str) -> Array:
        """Times (n,) [s] from the most frequent message with a time."""
        if not (clock := self._clock()):
            return np.zeros(self.count(name))
        k = np.searchsorted(self.positions(clock), self.positions(name), "right") - 1
        return self.seconds(clock)[np.clip(k, 0, None)]

    def _scaled(self, name: str, column: str, factor: float, rows: NDArray[np.void] | None) -> Array:
        """A column times a factor, straight into the array that is returned."""
        if rows is not None:
            values = rows[column].astype(float)
        else:
            values, done = np.empty(self.count(name)), 0
            for block in self._blocks(name):
                values[done : done + block.size] = block[column]
                done += block.size
        if factor != 1:
            values *= factor
        return values

    def _positions(self, name: str) -> Iterator[NDArray[np.int64]]:
        """As `positions`, one array for each stretch that holds some."""
        if not self.count(name):
            return
        for stretch in self.stretches:
            wanted = np.flatnonzero(stretch.kinds == self.formats[name].type)
            if wanted.size:
                yield stretch.starts(self.lengths)[wanted]

    def _blocks(self, name: str) -> Iterator[NDArray[np.void]]:
        """All messages of a name, in arrays of at most one stretch."""
        layout = self.formats[name]
        for at in self._positions(name):
            windows = np.lib.stride_tricks.sliding_window_view(np.asarray(self.data), layout.length)
            yield windows[at].view(layout.dtype)[:, 0]
            give_back(self.data, int(at[0]), int(at[-1]) + layout.length)


def open_parts(path: str | Path) -> tuple[DataFlash, ...]:
    """The logs in one .BIN file, usually one, each with its own formats and clock.

    ArduPilot starts each log, and nothing else, with the format of FMT.
    """
    data = np.memmap(path, dtype=np.uint8, mode="r") if Path(path).stat().st_size else np.empty(0, np.uint8)
    found = messages_of_type(data, FMT_TYPE, FMT_LENGTH)
    firsts = [at for at, message in found if message[3] == FMT_TYPE and message[4] == FMT_LENGTH]
    edges = [0, *firsts[1:], data.size]
    cuts = np.searchsorted([at for at, _ in found], edges).tolist()
    messages = [message for _, message in found]
    return tuple(
        index(data[a:b], messages[i:j])
        for (a, b), (i, j) in zip(pairwise(edges), pairwise(cuts), strict=True)
    )


def index(data: NDArray[np.uint8], descriptions: list[bytes] | None = None) -> DataFlash:
    """The formats and messages of a log in `data` (n,) bytes; no formats if it holds none.

    descriptions: its FMT messages, if they are known.
    """
    if descriptions is None:
        descriptions = [message for _, message in messages_of_type(data, FMT_TYPE, FMT_LENGTH)]
    known = {message: _format(message[3:]) for message in dict.fromkeys(descriptions)}
    # damaged descriptions are ignored; the last of a name and of a type is used
    by_name = {layout.name: layout for message in descriptions if (layout := known[message])}
    by_type = {layout.type: layout for layout in by_name.values()}
    formats = {layout.name: layout for layout in by_type.values()}
    lengths = np.zeros(256, np.int64)
    for layout in formats.values():
        lengths[layout.type] = layout.length
    stretches = messages_of(data, lengths)
    counts = np.zeros(256, np.int64)
    for stretch in stretches:
        counts += np.bincount(stretch.kinds, minlength=256)
    end = stretches[-1].end(lengths) if stretches else 0
    return DataFlash(
        data,
        formats,
        lengths,
        stretches,
        counts,
        bad_bytes=int(data.size - counts @ lengths),
        tail_bytes=int(data.size - end),
        breaks=sum(int(s.jumps.size) for s in stretches),
        message_count=int(counts.sum()),
    )


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
    whole = 3 + sum(SIZES[code] for code in layout)
    sound = len(set(columns)) == len(columns) and whole == length
    return MessageFormat(kind, name, length, layout, columns) if sound else None
