"""How many bytes the program at the other end of a loopback connection has not read yet.

Linux reports it over netlink (sock_diag(7)) in some 10 us; elsewhere, and for a peer on another machine, it
is unknown and only the sockets' own buffers hold the sender back.
"""

from __future__ import annotations

import socket
import struct

SOCK_DIAG = 4  # netlink protocol NETLINK_SOCK_DIAG
BY_FAMILY, REQUEST, ERROR = 20, 1, 2
ANY_STATE = 0xFFFFFFFF
HEADER = struct.Struct("=IHHII")
QUERY = struct.Struct("=BBBBI")
PORTS = struct.Struct(">HH")
QUEUES = struct.Struct("=II")
PORTS_AT = HEADER.size + 4
QUEUES_AT = HEADER.size + 4 + 48 + 4  # after the state bytes, the socket's id and the timer
Address = tuple[str, int]


def _request(protocol: int, local: Address, remote: Address) -> bytes:
    identity = PORTS.pack(local[1], remote[1])
    identity += b"".join(socket.inet_aton(host).ljust(16, b"\0") for host, _ in (local, remote))
    identity += bytes(4) + b"\xff" * 8  # any interface, no cookie
    body = QUERY.pack(socket.AF_INET, protocol, 0, 0, ANY_STATE) + identity
    return HEADER.pack(HEADER.size + len(body), BY_FAMILY, REQUEST, 0, 0) + body


class PeerQueue:
    """The receive queue at the far end of the connection own -> peer (IPv4 addresses)."""

    def __init__(self, protocol: int, own: Address, peer: Address) -> None:
        """protocol: socket.IPPROTO_TCP or IPPROTO_UDP."""
        self._peer = peer
        self._netlink: socket.socket | None = None
        # kernels differ in which end of a UDP pair is asked for, so both ways are tried
        self._requests = [_request(protocol, peer, own), _request(protocol, own, peer)]
        if not peer[0].startswith("127.") or not hasattr(socket, "AF_NETLINK"):
            return
        try:
            self._netlink = socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, SOCK_DIAG)
            self._netlink.settimeout(0.5)
        except OSError:
            self._netlink = None

    def unread(self) -> int | None:
        """Unread bytes there (UDP: of buffers, more than was sent); None where unknown."""
        for request in self._requests:
            count = self._ask(request)
            if count is not None:
                self._requests = [request]
                return count
        return None

    def _ask(self, request: bytes) -> int | None:
        if self._netlink is None:
            return None
        try:
            self._netlink.send(request)
            answer = self._netlink.recv(4096)
        except OSError:
            return None
        if HEADER.unpack_from(answer)[1] == ERROR or len(answer) < QUEUES_AT + QUEUES.size:
            return None
        if PORTS.unpack_from(answer, PORTS_AT)[0] != self._peer[1]:
            return None
        return int(QUEUES.unpack_from(answer, QUEUES_AT)[0])

    def close(self) -> None:
        if self._netlink is not None:
            self._netlink.close()
