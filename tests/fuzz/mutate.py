"""Damage, drawn by a seed: to any bytes, to what a format means, and to text."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import cache
from random import Random

from fastcrc import crc16

SEPARATORS = (
    (b",", b";"), (b".", b","), (b"\n", b"\r"), (b",", b"\t"), (b"=", b":"), (b'"', b""),
    (b"\n", b"\n\n"), (b" ", b"\xc2\xa0"), (b"\n", b'"\n'),
)  # fmt: skip
Mutator = Callable[[bytearray, Random], bytearray]

ODD_FLOATS = (float("nan"), float("inf"), float("-inf"), 1e38, -1e38, 1e-42, -0.0, 1e10, -9e9)
HEAD = b"\xa3\x95"
NAMES = (b"IMU\0", b"FMT\0", b"PARM", b"MSG\0", b"\x1b[2J", b"XKF1")
LABELS = (b"", b"X", b"I", b"TimeMS", b"Value", b"\x1b")
ESC = "\x1b[2J\x1b]52;c;aGk=\x07\x9b31m\u202e[/bold][red]"
NUMERALS = (
    "9" * 5000, "9" * 400, "1e999", "-1e400", "nan", "inf", "-inf", "0x", "1_0", "1e-400", "²", "٣", "",
    "true", "[]", "{}", '"x"', "1,5", "-0", "1e308", "0." + "0" * 5000 + "1", "null", "1979-05-27",
    "99999999999999999999",
)  # fmt: skip


def damaged(data: bytes, random: Random, mutators: Sequence[Mutator]) -> bytes:
    """The data after one to four of the mutators."""
    body = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 2, 3, 4))):
        body = random.choice(mutators)(body, random)
    return bytes(body)


# ---- any bytes -----------------------------------------------------------------------------------


def _place(data: bytearray, random: Random, most: int) -> tuple[int, int]:
    """(start, end) of a block; often a small one."""
    if not data:
        return 0, 0
    length = max(1, min(len(data), random.choice((1, 4, 16, 64, 512, most))))
    start = random.randrange(len(data) - length + 1)
    return start, start + random.randint(1, length)


def flip(data: bytearray, random: Random) -> bytearray:
    """Some bits."""
    for _ in range(random.choice((1, 2, 8, 64)) if data else 0):
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    return data


def truncate(data: bytearray, random: Random) -> bytearray:
    """The end is not there."""
    return data[: random.randrange(len(data) + 1)]


def behead(data: bytearray, random: Random) -> bytearray:
    """The beginning is not there."""
    return data[random.randrange(len(data) + 1) :]


def drop(data: bytearray, random: Random) -> bytearray:
    """A block is missing."""
    a, b = _place(data, random, len(data) // 2)
    return data[:a] + data[b:]


def swap(data: bytearray, random: Random) -> bytearray:
    """Two neighbouring blocks in the other order."""
    a, b = _place(data, random, len(data) // 2)
    c = min(len(data), b + random.choice((1, 64, 4096)))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def double(data: bytearray, random: Random) -> bytearray:
    """A block twice, seldom a hundred times."""
    a, b = _place(data, random, 4096)
    return data[:b] + data[a:b] * random.choice((1, 1, 1, 100)) + data[b:]


def overwrite(data: bytearray, random: Random) -> bytearray:
    """A block of noise, of zeros or of ones."""
    a, b = _place(data, random, 4096)
    data[a:b] = random.choice((random.randbytes(b - a), bytes(b - a), b"\xff" * (b - a)))
    return data


def insert(data: bytearray, random: Random) -> bytearray:
    """Bytes that were not there."""
    a, _ = _place(data, random, 1)
    return data[:a] + random.randbytes(random.choice((1, 3, 17, 300))) + data[a:]


BYTES: tuple[Mutator, ...] = (flip, flip, truncate, behead, drop, swap, double, overwrite, insert)


# ---- DataFlash -----------------------------------------------------------------------------------


def _heads(data: bytearray, kind: int | None = None) -> list[int]:
    found, at = [], data.find(HEAD)
    while 0 <= at < len(data) - 2:
        if kind is None or data[at + 2] == kind:
            found.append(at)
        at = data.find(HEAD, at + 2)
    return found


def wrong_format(data: bytearray, random: Random) -> bytearray:
    """An FMT with another type, length, name, format or columns."""
    formats = [at for at in _heads(data, 128) if at + 89 <= len(data)]
    if not formats:
        return data
    at = random.choice(formats)
    match random.randrange(5):
        case 0:
            data[at + 3] = random.randrange(256)
        case 1:
            data[at + 4] = random.choice((0, 1, 3, 11, 89, 255, random.randrange(256)))
        case 2:
            data[at + 5 : at + 9] = random.choice(NAMES)
        case 3:
            place = at + 9 + random.randrange(16)
            data[place] = random.choice(b"bBhHiIfdnNZcCeELMqQag?\0")
        case _:
            data[at + 25 : at + 89] = _columns(bytes(data[at + 25 : at + 89]), random)
    return data


def _columns(cell: bytes, random: Random) -> bytes:
    names = cell.split(b"\0")[0].split(b",")
    match random.randrange(4):
        case 0:
            random.shuffle(names)
        case 1:
            names[random.randrange(len(names))] = random.choice(LABELS)
        case 2:
            names = [name.swapcase() for name in names]
        case _:
            names[random.randrange(len(names))] = random.choice(names)
    return b",".join(names)[:64].ljust(64, b"\0")


def odd_float(data: bytearray, random: Random) -> bytearray:
    """NaN, infinity or a huge number in some messages of one kind."""
    heads = _heads(data)
    if not heads:
        return data
    kind = data[random.choice(heads) + 2]
    mine, value = [at for at in heads if data[at + 2] == kind], random.choice(ODD_FLOATS)
    offset, share = random.randrange(3, 32), random.choice((0.0, 0.01, 0.5, 1.0))
    for at in mine:
        if (random.random() < share or at == mine[0]) and at + offset + 4 <= len(data):
            struct.pack_into("<f", data, at + offset, value)
    return data


def odd_stamp(data: bytearray, random: Random) -> bytearray:
    """Times that jump, stand still or are huge in some messages of one kind."""
    heads = _heads(data)
    if not heads:
        return data
    kind = data[random.choice(heads) + 2]
    value, share = random.choice((0, 1, 2**32, 2**63, 2**64 - 1)), random.choice((0.001, 0.01, 0.3, 1.0))
    for at in heads:
        if data[at + 2] == kind and at + 11 <= len(data) and random.random() < share:
            struct.pack_into("<Q", data, at + 3, value)
    return data


FLASH: tuple[Mutator, ...] = (*BYTES, *(wrong_format,) * 3, odd_float, odd_float, odd_stamp)


# ---- MAVLink -------------------------------------------------------------------------------------


@cache
def _seeds() -> dict[int, int]:
    from pymavlink.dialects.v20 import ardupilotmega

    return {number: message.crc_extra for number, message in ardupilotmega.mavlink_map.items()}


def _frames(data: bytearray) -> list[tuple[int, int]]:
    """(start, end) of MAVLink 2 frames, by their lengths."""
    found, at = [], data.find(b"\xfd")
    while at >= 0 and at + 12 <= len(data):
        end = at + 12 + data[at + 1]
        if data[at + 2] == 0 and end <= len(data) and data[at + 9] == 0:
            found.append((at, end))
            at = data.find(b"\xfd", end)
        else:
            at = data.find(b"\xfd", at + 1)
    return found


def _signed(data: bytearray, start: int, end: int) -> None:
    """The checksum made right again."""
    number = int.from_bytes(data[start + 7 : start + 10], "little")
    if number in _seeds():
        crc = crc16.mcrf4xx(bytes(data[start + 1 : end - 2]) + bytes([_seeds()[number]]))
        data[end - 2 : end] = crc.to_bytes(2, "little")


def odd_payload(data: bytearray, random: Random) -> bytearray:
    """Values that no vehicle sends, under a right checksum."""
    found = _frames(data)
    if not found:
        return data
    wanted = data[random.choice(found)[0] + 7]
    share, how = random.choice((0.0, 0.01, 0.3, 1.0)), random.randrange(3)
    mine = [f for f in found if data[f[0] + 7] == wanted]
    for start, end in mine:
        if random.random() >= share and (start, end) != mine[0]:
            continue
        a, b = start + 10, end - 2
        if b - a >= 4 and how == 0:
            struct.pack_into("<f", data, a + 4 * random.randrange((b - a) // 4), random.choice(ODD_FLOATS))
        elif how == 1:
            data[a:b] = random.randbytes(b - a)
        elif b > a:
            data[random.randrange(a, b)] ^= 1 << random.randrange(8)
        _signed(data, start, end)
    return data


def odd_sender(data: bytearray, random: Random) -> bytearray:
    """Some frames from another system or component, or of another message."""
    place = random.choice((5, 6, 7))
    value, share = random.randrange(256), random.choice((0.01, 0.5))
    for start, end in _frames(data):
        if random.random() < share:
            data[start + place] = value
            _signed(data, start, end)
    return data


def chunks(data: bytearray, random: Random) -> bytearray:
    """Status texts in parts that never end, and names that are never the same."""
    from rover_sweep.vehicle.link.mavlink import Codec, make

    codec, at = Codec(1, 1), random.choice(_frames(data) or [(0, 0)])[0]
    texts = [
        make("STATUSTEXT", severity=6, text=random.randbytes(50), id=number, chunk_seq=random.randrange(256))
        for number in random.choices(range(1, 65536), k=random.choice((1, 20, 200)))
    ]
    kind = {"param_type": 9, "param_count": 65535}
    for k in range(random.choice((0, 20))):
        odd = {"param_id": random.randbytes(16), "param_value": random.choice(ODD_FLOATS)}
        texts.append(make("PARAM_VALUE", param_index=k, **odd, **kind))
    return data[:at] + b"".join(codec.pack(text) for text in texts) + data[at:]


MAVLINK: tuple[Mutator, ...] = (*BYTES, odd_payload, odd_payload, odd_payload, odd_sender, chunks)


# ---- text ----------------------------------------------------------------------------------------


def _lines(data: bytearray) -> list[bytes]:
    return bytes(data).split(b"\n")


def numeral(data: bytearray, random: Random) -> bytearray:
    """Another number in place of one."""
    import re

    found = list(re.finditer(rb"-?\d+\.?\d*(?:e-?\d+)?", bytes(data)))
    if found:
        match = random.choice(found)
        data[match.start() : match.end()] = random.choice(NUMERALS).encode()
    return data


def lines(data: bytearray, random: Random) -> bytearray:
    """A line gone, twice, or elsewhere."""
    parts = _lines(data)
    k = random.randrange(len(parts))
    taken = parts.pop(k)
    how = random.randrange(3)
    for _ in range(how):
        parts.insert(random.randrange(len(parts) + 1), taken)
    return bytearray(b"\n".join(parts))


def cell(data: bytearray, random: Random) -> bytearray:
    """Text where a word or a number was: hostile, long, or none."""
    import re

    found = list(re.finditer(rb"[A-Za-z_][\w-]*", bytes(data)))
    if found:
        match = random.choice(found)
        other = bytes(data[slice(*random.choice(found).span())])
        text = random.choice((ESC.encode(), b"x" * 100_000, b"", b"\0", b"\xff\xfe", other, b"trial", b"1.5"))
        data[match.start() : match.end()] = text
    return data


def brackets(data: bytearray, random: Random) -> bytearray:
    """As many brackets as nobody writes."""
    a, b = _place(data, random, 4)
    opened = random.choice((b"[", b"{", b'{"a":', b"[[", b"(", b"{a=", b"a.", b"-"))
    data[a:b] = opened * random.choice((100, 100_000))
    return data


def separators(data: bytearray, random: Random) -> bytearray:
    """One character by another throughout."""
    old, new = random.choice(SEPARATORS)
    return bytearray(bytes(data).replace(old, new, random.choice((1, -1))))


def value(data: bytearray, random: Random) -> bytearray:
    """What stands behind an = or : is of another kind."""
    import re

    found = list(re.finditer(rb"[=:]\s*([^\n,}]+)", bytes(data)))
    if found:
        match = random.choice(found)
        data[match.start(1) : match.end(1)] = random.choice(NUMERALS).encode()
    return data


TEXT: tuple[Mutator, ...] = (*BYTES, numeral, numeral, lines, cell, brackets, separators, value, value)
