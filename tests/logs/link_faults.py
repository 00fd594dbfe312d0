"""What a bad link does to a telemetry log: frames lost, bytes changed, arrival late, twice or out of order.

All work on the records (stamp and frame) of a .tlog and are the same for the same seed.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Iterable

from rover_sweep.logs.readers.tlog import STAMP, walk


def records(data: bytes) -> list[bytes]:
    """The records of a whole .tlog, in the order of the file."""
    starts = sorted(start - STAMP for found in walk(data).starts.values() for start in found)
    return [data[a:b] for a, b in zip(starts, [*starts[1:], len(data)], strict=True)]


def lost(log: Iterable[bytes], share: float, seed: int) -> bytes:
    """Without a share of the records."""
    chance = random.Random(seed)
    return b"".join(record for record in log if chance.random() >= share)


def corrupted(log: Iterable[bytes], share: float, seed: int, stamps: bool = False) -> bytes:
    """With one byte changed in a share of the frames, or, with `stamps`, anywhere in the record."""
    chance = random.Random(seed)
    return b"".join(_changed(r, chance, stamps) if chance.random() < share else r for r in log)


def _changed(record: bytes, chance: random.Random, stamps: bool) -> bytes:
    changed = bytearray(record)
    changed[chance.randrange(0 if stamps else STAMP, len(record))] ^= chance.randrange(1, 256)
    return bytes(changed)


def jittered(log: Iterable[bytes], seconds: float, seed: int, twice: float = 0.0) -> bytes:
    """Each record up to `seconds` later, a share of them twice, in the order in which they then arrive."""
    chance, arrived = random.Random(seed), []
    for record in log:
        for _ in range(1 + (chance.random() < twice)):
            late = int(seconds * 1e6 * chance.random())
            arrived.append((int.from_bytes(record[:STAMP], "big") + late, record[STAMP:]))
    arrived.sort(key=lambda pair: pair[0])
    return b"".join(struct.pack(">Q", stamp) + frame for stamp, frame in arrived)
