"""MAVLink FTP on the vehicle's directory, as GCS_FTP.cpp answers it: one session, one open file.

/scripts/x.lua is scripts/x.lua of the vehicle's directory, as under ArduPilot's SITL; nothing outside of the
directory can be reached.
"""

from __future__ import annotations

import errno
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

NONE, TERMINATE, RESET, LIST, OPEN_READ, READ, CREATE, WRITE, REMOVE = range(9)
MAKE_DIRECTORY, REMOVE_DIRECTORY, OPEN_WRITE = 9, 10, 11
RENAME, CRC32, BURST_READ = 13, 14, 15
ACK, NAK = 128, 129
FAIL, FAIL_ERRNO, INVALID_SIZE, END_OF_FILE, FILE_NOT_FOUND = 1, 2, 3, 6, 10
HEADER = struct.Struct("<HBBBBBBI")
DATA = 239
PAYLOAD = HEADER.size + DATA
BURST_PACKETS = 500


@dataclass(frozen=True)
class Packet:
    """One FTP payload."""

    sequence: int
    session: int
    opcode: int
    size: int
    requested: int = 0
    complete: int = 0
    offset: int = 0
    data: bytes = b""

    @classmethod
    def parsed(cls, payload: bytes) -> Packet:
        sequence, session, opcode, size, requested, complete, _, offset = HEADER.unpack_from(payload)
        return cls(
            sequence, session, opcode, size, requested, complete, offset, payload[HEADER.size :][:size]
        )

    def packed(self) -> bytes:
        """The payload, filled up to its 251 bytes."""
        head = (
            self.sequence & 0xFFFF,
            self.session,
            self.opcode,
            self.size,
            self.requested,
            self.complete,
            0,
        )
        return (HEADER.pack(*head, self.offset) + self.data).ljust(PAYLOAD, b"\0")


class Refused(Exception):
    """An FTP error code, with an errno where the file system said no."""

    def __init__(self, code: int, number: int = 0) -> None:
        super().__init__(code)
        self.data = bytes([code, number]) if number else bytes([code])


class FileTransfer:
    """The FTP server of a vehicle whose files lie in `root`."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self._file: IO[bytes] | None = None
        self._writing = False
        self._last: tuple[Packet, list[bytes]] | None = None
        self._operations: dict[int, Callable[[Packet], tuple[bytes, int]]] = {
            NONE: lambda request: (b"", 0),
            TERMINATE: self._close,
            RESET: self._close,
            LIST: self._list,
            OPEN_READ: self._open_read,
            READ: self._read,
            CREATE: self._create,
            OPEN_WRITE: self._create,
            WRITE: self._write,
            REMOVE: self._remove,
            REMOVE_DIRECTORY: self._remove,
            MAKE_DIRECTORY: self._make_directory,
            CRC32: self._crc32,
            RENAME: self._rename,
        }

    def handle(self, payload: bytes) -> list[bytes]:
        """Payloads to answer with. A request that comes twice gets the first answer again."""
        request = Packet.parsed(payload)
        if request.opcode in (ACK, NAK):
            return []
        if self._last is not None and self._last[0] == request:
            return self._last[1]
        answers = [p.packed() for p in self._answers(request)]
        self._last = (request, answers)
        return answers

    def _answers(self, request: Packet) -> Iterator[Packet]:
        sequence, session, opcode = request.sequence + 1, request.session, request.opcode
        try:
            if opcode == BURST_READ:
                yield from self._burst(request)
                return
            if opcode not in self._operations:
                raise Refused(FAIL)
            data, offset = self._operations[opcode](request)
        except Refused as refused:
            yield Packet(sequence, session, NAK, len(refused.data), opcode, 0, request.offset, refused.data)
        except OSError as error:
            data = Refused(FAIL_ERRNO, error.errno or errno.EIO).data
            yield Packet(sequence, session, NAK, len(data), opcode, 0, request.offset, data)
        else:
            yield Packet(sequence, session, ACK, len(data), opcode, 0, offset, data)

    def _path(self, name: bytes) -> Path:
        if not name:
            raise Refused(INVALID_SIZE)
        path = (self.root / name.rstrip(b"\0").decode("utf-8", "replace").lstrip("/")).resolve()
        if path != self.root and self.root not in path.parents:
            raise Refused(FAIL_ERRNO, errno.EACCES)
        return path

    def _close(self, request: Packet) -> tuple[bytes, int]:
        if self._file is not None:
            self._file.close()
        self._file = None
        return b"", 0

    def _open(self, path: Path, mode: str) -> IO[bytes]:
        if self._file is not None:
            raise Refused(FAIL)
        self._writing = mode != "rb"
        self._file = file = path.open(mode)  # the end of the session closes it
        return file

    def _open_read(self, request: Packet) -> tuple[bytes, int]:
        path = self._path(request.data)
        size = path.stat().st_size
        self._open(path, "rb")
        return struct.pack("<I", size), 0

    def _create(self, request: Packet) -> tuple[bytes, int]:
        self._open(self._path(request.data), "wb" if request.opcode == CREATE else "r+b")
        return b"", 0

    def _opened(self, writing: bool) -> IO[bytes]:
        if self._file is None:
            raise Refused(FILE_NOT_FOUND)
        if self._writing != writing:
            raise Refused(FAIL)
        return self._file

    def _read(self, request: Packet) -> tuple[bytes, int]:
        file = self._opened(False)
        file.seek(request.offset)
        data = file.read(min(request.size, DATA))
        if not data:
            raise Refused(END_OF_FILE)
        return data, request.offset

    def _burst(self, request: Packet) -> Iterator[Packet]:
        file = self._opened(False)
        offset, sequence = request.offset, request.sequence
        file.seek(offset)
        length = min(request.size or DATA, DATA)
        for n in range(BURST_PACKETS):
            data = file.read(length)
            sequence += 1
            if not data:
                end = bytes([END_OF_FILE])
                yield Packet(sequence, request.session, NAK, 1, BURST_READ, 0, offset, end)
                return
            complete = int(n == BURST_PACKETS - 1)
            yield Packet(sequence, request.session, ACK, len(data), BURST_READ, complete, offset, data)
            offset += len(data)

    def _write(self, request: Packet) -> tuple[bytes, int]:
        file = self._opened(True)
        file.seek(request.offset)
        file.write(request.data)
        file.flush()
        return b"", request.offset

    def _list(self, request: Packet) -> tuple[bytes, int]:
        entries = sorted(self._path(request.data).iterdir())[request.offset :]
        if not entries:
            raise Refused(END_OF_FILE)
        data = b""
        for entry in entries:
            line = f"D{entry.name}" if entry.is_dir() else f"F{entry.name}\t{entry.stat().st_size}"
            if len(data) + len(line.encode()) + 1 > DATA:
                break
            data += line.encode() + b"\0"
        return data, request.offset

    def _remove(self, request: Packet) -> tuple[bytes, int]:
        path = self._path(request.data)
        if path.is_dir():
            path.rmdir()
        else:
            path.unlink()
        return b"", 0

    def _make_directory(self, request: Packet) -> tuple[bytes, int]:
        self._path(request.data).mkdir()
        return b"", 0

    def _rename(self, request: Packet) -> tuple[bytes, int]:
        old, separator, new = request.data.rstrip(b"\0").partition(b"\0")
        if not separator:
            raise Refused(INVALID_SIZE)
        self._path(old).rename(self._path(new))
        return b"", 0

    def _crc32(self, request: Packet) -> tuple[bytes, int]:
        """ArduPilot's CRC-32 starts at 0 and is not inverted at its end."""
        content = self._path(request.data).read_bytes()
        return struct.pack("<I", zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF), 0
