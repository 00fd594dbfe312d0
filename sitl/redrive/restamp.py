"""A DataFlash log on another clock: all time stamps shifted, unneeded records left out."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from sitl.flash_log.dataflash_writer import CODES, FMT_TYPE, HEAD

_TIME = struct.Struct("<Q")
_FMT = struct.Struct("<BB4s16s64s")
_ALWAYS = frozenset({"FMT", "FMTU", "UNIT", "MULT", "PARM", "VER", "MSG", "MODE"})
_MEASURED = frozenset({"IMU", "GYR", "ACC", "ATT", "XKF1", "GPS", "RCOU", "RCIN", "SWEP", "DSF", "ARM", "EV"})


@dataclass(frozen=True)
class _Kind:
    name: str
    length: int
    codes: str
    columns: tuple[str, ...]


def records(data: bytes) -> Iterator[tuple[_Kind, bytes]]:
    """(kind, record) of a log that is whole up to its last record."""
    kinds = {FMT_TYPE: _Kind("FMT", 3 + _FMT.size, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))}
    i = 0
    while i + 3 <= len(data) and data[i : i + 2] == HEAD and data[i + 2] in kinds:
        kind = kinds[data[i + 2]]
        record = data[i : i + kind.length]
        if len(record) < kind.length:
            return
        if kind.name == "FMT":
            number, length, *texts = _FMT.unpack(record[3:])
            name, codes, columns = (text.rstrip(b"\0").decode("ascii", "replace") for text in texts)
            kinds[number] = _Kind(name, length, codes, tuple(columns.split(",")))
        yield kind, record
        i += kind.length


def first(data: bytes, name: str, column: str) -> tuple[float, float] | None:
    """(time stamp [s], value of a float column) of the first record of a message, None without any."""
    for kind, record in records(data):
        if kind.name == name:
            k = kind.columns.index(column)
            offset = 3 + struct.calcsize("<" + "".join(CODES[c][0] for c in kind.codes[:k]))
            return _TIME.unpack_from(record, 3)[0] * 1e-6, struct.unpack_from("<f", record, offset)[0]
    return None


def restamped(data: bytes, shift: float, start: float, end: float) -> bytes:
    """The log with `shift` [s] added to every TimeUS; measurements only from `start` to `end` [s, new].

    Messages that identification has no use for are left out: the firmware writes seven times as much.
    """
    out = bytearray()
    for kind, record in records(data):
        if kind.columns[0] != "TimeUS":
            out += record
            continue
        t = _TIME.unpack_from(record, 3)[0] + round(shift * 1e6)
        inside = kind.name in _MEASURED and start * 1e6 <= t <= end * 1e6
        if inside or kind.name in _ALWAYS:
            out += record[:3] + _TIME.pack(max(0, t)) + record[11:]
    return bytes(out)
