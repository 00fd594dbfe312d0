"""The scan of a large DataFlash log, compiled by numba: the way from message to message.

Only logs from `dataflash_index.LARGE` bytes load this file: below, the import of numba takes longer than
the scan. The compiled code is kept on disk, so that only the first run on a machine pays.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

compiled: Any = njit(cache=True, nogil=True)


@compiled
def _is_head(data, lengths, at):  # type: ignore[no-untyped-def]
    return at < data.size - 2 and data[at] == 0xA3 and data[at + 1] == 0x95 and lengths[data[at + 2]] > 0


@compiled
def follow(data, lengths, at, until, end, kinds, jumps, landings):  # type: ignore[no-untyped-def]
    """The messages that start in [at, until), as `dataflash_index.messages_of` defines them.

    end: where the message before ends. Writes their types to kinds (m,), and for each message that does not
    start where the one before ends its index to jumps and its offset to landings. Returns (number of
    messages, number of jumps, where to search on, end of the last message).
    """
    n = j = 0
    size = data.size
    last = min(until, size - 2)
    while at < last:
        x = at
        while x < size - 2:
            if _is_head(data, lengths, x):
                follower = x + lengths[data[x + 2]]
                if follower == size or _is_head(data, lengths, follower):
                    break
            x += 1
        if x >= size - 2:
            return n, j, size, end
        if x >= until:
            return n, j, x, end
        if x != end:
            jumps[j] = n
            landings[j] = x
            j += 1
        while True:  # as long as each message is followed by one
            kind = data[x + 2]
            kinds[n] = kind
            n += 1
            at = end = x + lengths[kind]
            if at >= last or data[at] != 0xA3 or data[at + 1] != 0x95:
                break
            kind = data[at + 2]
            follower = at + lengths[kind]
            if lengths[kind] == 0 or follower >= size - 2:
                break
            if data[follower] != 0xA3 or data[follower + 1] != 0x95 or lengths[data[follower + 2]] == 0:
                break
            x = at
    return n, j, at, end


def say_when_compiling(kernel: Any, of_what: str) -> None:
    """One line on stderr before the only run that compiles `kernel`."""
    try:
        index = Path(kernel._cache._cache_file._index_path)
    except AttributeError:  # another version of numba: no line
        return
    if not index.is_file():
        print(
            f"compiling the reader of {of_what}, once on this machine (seconds; kept in {index.parent})",
            file=sys.stderr,
        )


# The way from frame to frame of a large telemetry log, with the checksums, compiled by numba.
#
# Only logs from `tlog.LARGE` bytes load this file: below, the import of numba takes longer than plain
# Python.


ROOM = 1 << 16  # frames that are returned at once


@compiled
def follow_frames(data, at, last, seeds, starts, numbers):  # type: ignore[no-untyped-def]
    """As `tlog._sound_frames`; seeds (n,): -1 for an unknown message.

    Writes the offset and message id of each frame to starts and numbers (m,); (end of the last, how many).
    """
    size = data.size
    n = 0
    while at <= last and n < starts.size:
        start = at + 8
        if data[start] == 0xFD:
            number = (
                np.int64(data[start + 7]) | np.int64(data[start + 8]) << 8 | np.int64(data[start + 9]) << 16
            )
            tail = start + 10 + np.int64(data[start + 1])
            end = tail + 15 if data[start + 2] & 1 else tail + 2
        elif data[start] == 0xFE:
            number = np.int64(data[start + 5])
            tail = start + 6 + np.int64(data[start + 1])
            end = tail + 2
        else:
            break
        if number >= seeds.size or seeds[number] < 0 or end > size:
            break
        crc = np.uint32(0xFFFF)
        for k in range(start + 1, tail + 1):  # the last byte is the seed
            byte = np.uint32(data[k]) if k < tail else np.uint32(seeds[number])
            mixed = (byte ^ crc) & np.uint32(0xFF)
            mixed = (mixed ^ (mixed << np.uint32(4))) & np.uint32(0xFF)
            crc = (
                (crc >> np.uint32(8))
                ^ (mixed << np.uint32(8))
                ^ (mixed << np.uint32(3))
                ^ (mixed >> np.uint32(4))
            )
        if (crc & np.uint32(0xFFFF)) != np.uint32(data[tail]) | np.uint32(data[tail + 1]) << np.uint32(8):
            break
        starts[n] = start
        numbers[n] = number
        n += 1
        at = end
    return at, n


def follower(
    data: bytes, seeds: Mapping[int, bytes], room: int = ROOM
) -> Callable[[int, int], tuple[int, list[int], list[int]]]:
    """A function of (offset, last offset) that gives (end of the last sound frame, starts, message ids)."""
    say_when_compiling(follow_frames, "large telemetry logs")
    raw = np.frombuffer(data, np.uint8)
    table = np.full(max(seeds) + 1, -1, np.int64)
    for number, seed in seeds.items():
        table[number] = seed[0]
    starts, numbers = np.empty(room, np.int64), np.empty(room, np.int64)

    def follow(at: int, last: int) -> tuple[int, list[int], list[int]]:
        at, n = follow_frames(raw, at, last, table, starts, numbers)
        return at, starts[:n].tolist(), numbers[:n].tolist()

    return follow
