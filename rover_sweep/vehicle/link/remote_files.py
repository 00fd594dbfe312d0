"""Files on the vehicle, by single exchanges of MAVLink FTP: checksum and listing, without reading them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message

# Sequence, session, opcode, size, the request's opcode, burst complete, padding, offset (MAVLink FTP).
_HEADER = struct.Struct("<HBBBBBxI")
_LIST, _CRC32, _ACK = 3, 14, 128
_DATA, _PAYLOAD = 12, 251
_TRIES, _TIMEOUT = 2, 1.5
_MOST = 5000  # entries of a folder: ArduPilot keeps at most 500 logs (LOG_MAX_FILES)


def crc32(data: bytes, before: int = 0) -> int:
    """ArduPilot's CRC-32 (AP_Math/crc.cpp, crc_crc32): starts at 0 and is not inverted at the end. before:
    CRC of the preceding bytes."""
    return zlib.crc32(data, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


def remote_crc32(link: Link, path: str, timeout: float = _TIMEOUT) -> int | None:
    """CRC-32 of a file on the vehicle; None without such a file or without MAVLink FTP. timeout [s]."""
    data = _ask(link, _CRC32, path, 0, timeout)
    return int.from_bytes(data[:4], "little") if data is not None and len(data) >= 4 else None


def remote_sizes(link: Link, folder: str) -> dict[str, int]:
    """Size [bytes] by name of the files in a folder of the vehicle; {} without it or without MAVLink FTP."""
    found: dict[str, int] = {}
    for entry in _entries(link, folder):
        name, _, size = entry[1:].partition("\t")
        if entry.startswith("F") and size.isascii() and size.isdecimal():
            found[name] = int(size)
    return found


def _entries(link: Link, folder: str) -> Iterator[str]:
    """Lines of a directory's listing, requested in parts by the number of entries already received.

    At most about `_MOST` lines, so that an endless listing ends.
    """
    offset = 0
    while data := _ask(link, _LIST, folder, offset, _TIMEOUT):
        lines = [line for line in data.decode("utf-8", "replace").split("\0") if line]
        yield from lines
        offset += len(lines)
        if not lines or offset >= _MOST:
            return


def _ask(link: Link, opcode: int, path: str, offset: int, timeout: float) -> bytes | None:
    """The data of an acknowledged answer; None if it is refused or none comes."""
    name = path.encode()
    # ArduPilot repeats its last answer to a repeated sequence number, so each request has its own. That of a
    # checksum is the one in the recorded conversations.
    sequence = (zlib.crc32(name) + opcode - _CRC32 + offset) & 0x7FFF
    request = _HEADER.pack(sequence, 0, opcode, len(name), 0, 0, offset) + name
    for _ in range(_TRIES):
        link.to_vehicle(
            "FILE_TRANSFER_PROTOCOL", target_network=0, payload=list(request.ljust(_PAYLOAD, b"\0"))
        )
        answer = link.wait_for("FILE_TRANSFER_PROTOCOL", timeout, lambda m: _answers(m, opcode, sequence))
        if answer is not None:
            data = bytes(answer.payload)
            return data[_DATA : _DATA + data[4]] if data[3] == _ACK else None
    return None


def _answers(message: Message, opcode: int, sequence: int) -> bool:
    came, _, _, _, asked, *_ = _HEADER.unpack_from(bytes(message.payload))
    return bool(asked == opcode and came == sequence + 1)
