"""The way from frame to frame of a large telemetry log, with the checksums, compiled by numba.

Only logs from `tlog.LARGE` bytes load this file: below, the import of numba takes longer than plain Python.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from rover_sweep.logs.readers.compiled_scan import compiled, say_when_compiling

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
