"""How many bytes the program at the other end of a loopback connection has not read yet.

Linux tells it in /proc/net; elsewhere, and for a peer on another machine, it is unknown and only the
sockets' own buffers hold the sender back.
"""

from __future__ import annotations

import socket
from pathlib import Path

TABLES = {socket.SOCK_STREAM: Path("/proc/net/tcp"), socket.SOCK_DGRAM: Path("/proc/net/udp")}


def _hexadecimal(address: tuple[str, int]) -> str:
    """An IPv4 address and port as /proc/net prints them on a little-endian machine."""
    return f"{socket.inet_aton(address[0])[::-1].hex().upper()}:{address[1]:04X}"


def _is_end(kind: socket.SocketKind, local: str, remote: str, here: str, there: str) -> bool:
    """Whether a line of the table is the peer's end; a UDP socket may listen on all addresses."""
    if kind == socket.SOCK_STREAM:
        return local == there and remote == here
    return local in (there, "00000000" + there[8:])


def unread_by_peer(kind: socket.SocketKind, own: tuple[str, int], peer: tuple[str, int]) -> int | None:
    """Bytes on the way to `peer` or waiting there unread; None where that cannot be known.

    kind: SOCK_STREAM or SOCK_DGRAM; own, peer: IPv4 addresses (host, port) of the two ends.
    """
    if not peer[0].startswith("127."):
        return None
    try:
        lines = TABLES[kind].read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    here, there = _hexadecimal(own), _hexadecimal(peer)
    total, found = 0, False
    for line in lines[1:]:
        fields = line.split(None, 5)
        local, remote, queues = fields[1], fields[2], fields[4]
        if kind == socket.SOCK_STREAM and local == here and remote == there:
            total += int(queues[:8], 16)
        elif _is_end(kind, local, remote, here, there):
            total, found = total + int(queues[9:], 16), True
    return total if found else None
