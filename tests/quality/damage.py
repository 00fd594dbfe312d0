"""Damage to recordings: to channels of a run in memory, and to the fields of messages in a .BIN."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_sweep.data.recording import Array, Recording

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"
FORMATS = {code: code for code in "bBhHiIfdqQ"} | dict.fromkeys("cCeEL", "h") | {"C": "H", "e": "i", "E": "I"}
FORMATS |= {"L": "i", "M": "B", "a": "64s", "n": "4s", "N": "16s", "Z": "64s"}
FMT, HEAD = 128, b"\xa3\x95"
Change = Callable[[Array], Array]
Field = tuple[str, str]


def damaged(run: Recording, **changes: Change) -> Recording:
    """The run with changed samples; of its notes none."""
    new = {c: replace(run[c], x=change(run[c].x)) for c, change in changes.items()}
    return replace(run, channels={**run.channels, **new}, notes=())


def clipped(run: Recording, channel: str, share: float) -> Recording:
    """The run with a channel that has no larger values than this share of its largest."""
    limit = share * float(np.max(np.abs(run.manoeuvre(channel).x)))
    return damaged(run, **{channel: lambda x: np.clip(x, -limit, limit)})


def rewritten(path: Path, out: Path, changes: Mapping[Field, Callable[[float], float]]) -> Path:
    """A copy of a .BIN in which fields {(message, column): change of the stored number} are others.

    The message "*" means every one that has the column.
    """
    data = bytearray(path.read_bytes())
    for offset, name, columns in _messages(data):
        for (message, column), change in changes.items():
            if message in (name, "*") and column in columns:
                at, code = columns[column]
                value = change(struct.unpack_from(code, data, offset + at)[0])
                struct.pack_into(code, data, offset + at, value if code[-1] in "fd" else round(value))
    out.write_bytes(data)
    return out


def _messages(data: bytes | bytearray) -> Iterator[tuple[int, str, dict[str, tuple[int, str]]]]:
    """(offset, name, {column: (offset in the message, struct code)}) of every message but FMT."""
    known: dict[int, tuple[int, str, dict[str, tuple[int, str]]]] = {FMT: (89, "FMT", {})}
    at = 0
    while at + 3 <= len(data):
        kind = data[at + 2]
        if data[at : at + 2] != HEAD or kind not in known or at + known[kind][0] > len(data):
            at += 1
            continue
        if kind == FMT:
            new, length, name, layout, columns = struct.unpack_from("<BB4s16s64s", data, at + 3)
            known.setdefault(new, (length, _text(name), _columns(_text(layout), _text(columns))))
        else:
            yield at, known[kind][1], known[kind][2]
        at += known[kind][0]


def _columns(layout: str, names: str) -> dict[str, tuple[int, str]]:
    found, at = {}, 3
    for code, name in zip(layout, names.split(","), strict=False):
        found[name] = (at, "<" + FORMATS[code])
        at += struct.calcsize("<" + FORMATS[code])
    return found


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii", "replace")
