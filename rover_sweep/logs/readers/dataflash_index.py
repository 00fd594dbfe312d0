"""Where the messages of a DataFlash log are: one byte a message, so that a log of 4 GB is indexed in 0.1 GB.

The log is worked through in blocks, and the pages of a mapped file are given back after each, so that the
memory in use does not grow with the file.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]

HEAD = (0xA3, 0x95)
BLOCK = 1 << 23  # bytes per step
LARGE = 1 << 25  # bytes; from here compiled code is faster, with its import (0.3 s)


@dataclass(frozen=True)
class Stretch:
    """The messages that start in one block.

    start: offset of the first message. kinds: type (n,) of each. jumps: indices (m,) of messages that do not
    start where the one before ends; landings: their offsets (m,).
    """

    start: int
    kinds: Bytes
    jumps: Offsets
    landings: Offsets

    def starts(self, lengths: Offsets) -> Offsets:
        """Offsets (n,) of all messages; lengths (256,) by type."""
        steps = np.empty(self.kinds.size, np.int64)
        steps[0] = self.start
        np.take(lengths, self.kinds[:-1], out=steps[1:])
        inner = self.jumps > 0
        if inner.any():
            at = self.jumps[inner]
            skipped = self.landings[inner] - np.cumsum(steps)[at]
            steps[at] += np.diff(skipped, prepend=0)
        return np.cumsum(steps, out=steps)

    def end(self, lengths: Offsets) -> int:
        """Offset after the last message."""
        return int(self.starts(lengths)[-1] + lengths[self.kinds[-1]])


def messages_of_type(data: Bytes, kind: int, length: int) -> list[tuple[int, bytes]]:
    """(offset, message) of all byte pairs that look like a header and are followed by `kind`.

    length: of the message, bytes; those that the end of `data` cuts off are left out.
    """
    wanted = re.compile(re.escape(bytes((*HEAD, kind))))
    found: list[tuple[int, bytes]] = []
    known: dict[bytes, bytes] = {}
    for start in range(0, data.size, BLOCK):
        stop = min(start + BLOCK + 2, data.size)
        for match in wanted.finditer(data, start, stop):  # type: ignore[call-overload]
            at = match.start()
            if at + length <= data.size:
                message = data[at : at + length].tobytes()
                found.append((at, known.setdefault(message, message)))
        give_back(data, start, stop)
    return found


def messages_of(data: Bytes, lengths: Offsets) -> tuple[Stretch, ...]:
    """The messages of a log. lengths (256,): of the whole message of each type, 0 for an undefined one.

    Two bytes of a payload may look like a header, so the headers are followed from message to message. A
    message is valid if another header, or the end of the file, follows directly; otherwise the search
    continues at the next header with such a follower.
    """
    return tuple((_compiled if data.size >= LARGE else _by_columns)(data, lengths))


def give_back(data: Bytes, start: int, stop: int) -> None:
    """Releases the memory of data[start:stop] where it is a mapped file, which can be read again."""
    mapping = getattr(data, "_mmap", None) if data.size >= LARGE else None
    if not isinstance(mapping, mmap.mmap) or not hasattr(mmap, "MADV_DONTNEED"):
        return
    first = data.ctypes.data - np.frombuffer(mapping, np.uint8).ctypes.data
    low = (first + start) // mmap.PAGESIZE * mmap.PAGESIZE
    mapping.madvise(mmap.MADV_DONTNEED, low, first + stop - low)


def _compiled(data: Bytes, lengths: Offsets) -> Iterator[Stretch]:
    from rover_sweep.logs.readers.compiled_scan import follow, say_when_compiling

    say_when_compiling(follow, "large .BIN logs")
    block = np.asarray(data)
    shortest = int(lengths[lengths > 0].min(initial=1 << 8))
    most = BLOCK // shortest + 1
    kinds, jumps, landings = np.empty(most, np.uint8), np.empty(most, np.int64), np.empty(most, np.int64)
    at, end = 0, -1
    for begin in range(0, data.size, BLOCK):
        before, stop = end, min(begin + BLOCK, data.size)
        n, j, at, end = follow(block, lengths, at, stop, before, kinds, jumps, landings)
        if n:
            start = int(landings[0]) if j and jumps[0] == 0 else before
            first = int(before < 0)  # before the first message there is nothing that it could jump from
            yield Stretch(start, kinds[:n].copy(), jumps[first:j].copy(), landings[first:j].copy())
        give_back(data, begin, stop)


def _by_columns(data: Bytes, lengths: Offsets) -> Iterator[Stretch]:
    """With numpy alone. The loop takes one step only where the next header is not the expected one."""
    first = np.flatnonzero(data[:-2] == HEAD[0]) if data.size > 2 else np.empty(0, np.int64)
    heads = first[data[first + 1] == HEAD[1]]
    heads = heads[lengths[data[heads + 2]] > 0]
    if heads.size == 0:
        return
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
    if not keep:
        return
    starts = heads[np.concatenate(keep)]
    kinds = data[starts + 2]
    jumps = 1 + np.flatnonzero(starts[1:] != starts[:-1] + lengths[kinds[:-1]])
    yield Stretch(int(starts[0]), kinds, jumps, starts[jumps])
