"""The CRC-32 of a file on the vehicle by one exchange of MAVLink FTP: is it ours, without reading it?"""

from __future__ import annotations

import struct
import zlib

from rover_sweep.vehicle.link import Link
from rover_sweep.vehicle.mavlink import Message

_HEADER = struct.Struct(
    "<HBBBBBxI"
)  # sequence, session, opcode, size, request's opcode, burst complete, offset
_CRC32, _ACK = 14, 128  # OpCalcFileCRC32, opcode of an answer (MAVLink FTP)
_PAYLOAD = 251
_TRIES, _TIMEOUT = 2, 1.5


def crc32(data: bytes) -> int:
    """ArduPilot's (AP_Math/crc.cpp, crc_crc32): begins at 0 and is not inverted at its end."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def remote_crc32(link: Link, path: str) -> int | None:
    """Of a file on the vehicle; None where there is no such file, or no MAVLink FTP."""
    name = path.encode()
    sequence = zlib.crc32(name) & 0x7FFF  # ArduPilot answers one that it has just had with what it just said
    request = _HEADER.pack(sequence, 0, _CRC32, len(name), 0, 0, 0) + name
    for _ in range(_TRIES):
        link.to_vehicle(
            "FILE_TRANSFER_PROTOCOL", target_network=0, payload=list(request.ljust(_PAYLOAD, b"\0"))
        )
        answer = link.wait_for("FILE_TRANSFER_PROTOCOL", _TIMEOUT, lambda m: _answers(m, sequence))
        if answer is not None:
            data = bytes(answer.payload)
            acknowledged = data[3] == _ACK and data[4] >= 4
            return int.from_bytes(data[12:16], "little") if acknowledged else None
    return None


def _answers(message: Message, sequence: int) -> bool:
    came, _, _, _, asked, *_ = _HEADER.unpack_from(bytes(message.payload))
    return bool(asked == _CRC32 and came == sequence + 1)
