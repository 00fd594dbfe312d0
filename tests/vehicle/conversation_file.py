"""A recorded conversation read back from its file, or written to one."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rover_sweep.files.documents import read_json
from rover_sweep.vehicle.link.recorded_transport import FORMAT, HEAD, ConversationKind, ConversationWriter


@dataclass(frozen=True)
class ConversationEntry:
    """t: s since the first entry."""

    kind: ConversationKind
    t: float
    data: bytes = b""


@dataclass(frozen=True)
class Conversation:
    """about: what stands in the header. whole: the file was closed; else its last second may lack."""

    entries: tuple[ConversationEntry, ...]
    about: Mapping[str, Any] = field(default_factory=dict)
    whole: bool = True


def write_conversation(path: Path, conversation: Conversation) -> None:
    """A conversation into a file, as it would have been recorded."""
    writer = ConversationWriter(path, {k: v for k, v in conversation.about.items() if k != "format"})
    for entry in conversation.entries:
        writer.write(entry.kind, round(entry.t * 1e6), entry.data)
    writer.close()


def read_conversation(path: Path) -> Conversation:
    """One whose writer was killed is read as far as it goes."""
    unpacker = zlib.decompressobj(wbits=31)
    line, _, body = unpacker.decompress(path.read_bytes()).partition(b"\n")
    about = read_json(line.decode("utf-8"))
    assert about["format"] == FORMAT, f"{path} is no conversation recording of this program"
    entries, at = list[ConversationEntry](), 0
    while at + HEAD.size <= len(body):
        kind, us, length = HEAD.unpack_from(body, at)
        at += HEAD.size
        if at + length > len(body):
            break
        entries.append(ConversationEntry(ConversationKind(kind), us * 1e-6, body[at : at + length]))
        at += length
    return Conversation(tuple(entries), about, unpacker.eof)
