"""Writes small DataFlash logs: the opposite of rover_sweep.logs.readers.dataflash, for tests only."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping

CODES = {code: code for code in "QIHBfh"} | {"c": "h", "N": "16s", "Z": "64s", "n": "4s"}
FACTORS = {"c": 100}


class FlashWriter:
    """Collects messages; `data` is the log."""

    def __init__(self) -> None:
        self.data = b""
        self._kinds: dict[str, tuple[int, str]] = {}
        self.define("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 128)

    def define(self, name: str, layout: str, columns: str, kind: int | None = None) -> None:
        kind = kind if kind is not None else len(self._kinds) + 1
        self._kinds[name] = (kind, layout)
        length = 3 + struct.calcsize("<" + "".join(CODES[c] for c in layout))
        self.write("FMT", kind, length, name.encode(), layout.encode(), columns.encode())

    def write(self, name: str, *values: float | bytes) -> None:
        kind, layout = self._kinds[name]
        codes = "<" + "".join(CODES[c] for c in layout)
        cells = [v if isinstance(v, bytes) else _stored(c, v) for c, v in zip(layout, values, strict=True)]
        self.data += bytes((0xA3, 0x95, kind)) + struct.pack(codes, *cells)

    def parameters(self, values: Mapping[str, float]) -> None:
        self.define("PARM", "QNf", "TimeUS,Name,Value")
        for name, value in values.items():
            self.write("PARM", 0, name.encode(), value)

    def messages(self, texts: Iterable[str]) -> None:
        self.define("MSG", "QZ", "TimeUS,Message")
        for text in texts:
            self.write("MSG", 0, text.encode())


def _stored(code: str, value: float) -> float | int:
    if code == "f":
        return value
    return round(value * FACTORS.get(code, 1))
