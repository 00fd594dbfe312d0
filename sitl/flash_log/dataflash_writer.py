"""Writes ArduPilot's DataFlash logs (.BIN): self-describing binary records.

A record is 0xA3 0x95, the type byte and the packed fields; FMT records (type 128) say how the others
are packed, FMTU records give units and multipliers. The layout of every message was read from logs of
ArduRover 4.6.3 (tests/data), so that a reader made for the firmware reads these too.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import BinaryIO

HEAD = b"\xa3\x95"
FMT_TYPE = 128

# Format character -> (struct code, scale applied before packing). c C e E hold hundredths, L 1e-7 deg.
CODES: Mapping[str, tuple[str, float | None]] = {
    "b": ("b", None),
    "B": ("B", None),
    "h": ("h", None),
    "H": ("H", None),
    "i": ("i", None),
    "I": ("I", None),
    "q": ("q", None),
    "Q": ("Q", None),
    "f": ("f", None),
    "d": ("d", None),
    "n": ("4s", None),
    "N": ("16s", None),
    "Z": ("64s", None),
    "M": ("B", None),
    "c": ("h", 100.0),
    "C": ("H", 100.0),
    "e": ("i", 100.0),
    "E": ("I", 100.0),
    "L": ("i", 1e7),
}
INTEGERS = frozenset("bBhHiIqQM")


@dataclass(frozen=True)
class LogFormat:
    """One message type: `codes` are ArduPilot's format characters, one a column; units and multipliers
    are its one-letter identifiers, one a column (empty where it writes no FMTU record)."""

    type: int
    name: str
    codes: str
    columns: str
    units: str = ""
    multipliers: str = ""
    packer: struct.Struct = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        unknown = set(self.codes) - set(CODES)
        if unknown or len(self.codes) != len(self.columns.split(",")):
            raise ValueError(f"{self.name}: format '{self.codes}' does not fit columns '{self.columns}'")
        if len(self.name) > 4 or len(self.codes) > 16 or len(self.columns) > 64:
            raise ValueError(f"{self.name}: more than 4 letters, 16 fields or 64 characters of columns")
        object.__setattr__(self, "packer", struct.Struct("<" + "".join(CODES[c][0] for c in self.codes)))

    @property
    def length(self) -> int:
        """Bytes of one record with its three-byte head."""
        return 3 + self.packer.size

    @property
    def plain(self) -> bool:
        """True where every field is packed as it is given (no text, no scaled integers)."""
        return all(CODES[c][1] is None and c not in "nNZ" for c in self.codes)


def encoded(code: str, value: float | str | bytes) -> float | int | bytes:
    """A value as the packer wants it; integers saturate at nothing: a value out of range raises."""
    if code in "nNZ":
        return value if isinstance(value, bytes) else str(value).encode("ascii", "replace")
    scale = CODES[code][1]
    if scale is not None:
        return round(float(value) * scale)
    return int(value) if code in INTEGERS else float(value)


class DataFlashWriter:
    """Records into an open binary file. Every format is announced (FMT) before its first record."""

    def __init__(self, file: BinaryIO, formats: Mapping[str, LogFormat]) -> None:
        self.file = file
        self.formats = dict(formats)
        self.bytes_written = 0
        self.records_written = 0
        self._heads = {f.name: HEAD + bytes([f.type]) for f in formats.values()}
        self._plain = {f.name for f in formats.values() if f.plain}
        for fmt in formats.values():
            self._announce(fmt)

    def define(self, fmt: LogFormat) -> None:
        """Adds a message type to a log that is open already, as logger:write of a script does."""
        self.formats[fmt.name] = fmt
        self._heads[fmt.name] = HEAD + bytes([fmt.type])
        self._announce(fmt)

    def _announce(self, fmt: LogFormat) -> None:
        self.write("FMT", fmt.type, fmt.length, fmt.name, fmt.codes, fmt.columns)

    def write(self, name: str, *values: float | str | bytes) -> None:
        """One record of the type `name` with its columns' values in order, in their natural units."""
        fmt = self.formats[name]
        fields = (
            values if name in self._plain else [encoded(c, v) for c, v in zip(fmt.codes, values, strict=True)]
        )
        record = self._heads[name] + fmt.packer.pack(*fields)
        self.file.write(record)
        self.bytes_written += len(record)
        self.records_written += 1
