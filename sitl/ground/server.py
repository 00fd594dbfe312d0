"""Byte streams between the embedded rover and ground stations; they slow the rover down to its readers' pace.

TCP: any number of clients on one listening port; UDP: sends to one address and takes in its replies. The
simulation is stopped (`hold`) while a peer is more than LEAD_US of vehicle time behind in reading: on one
machine that is known exactly (`sitl.ground.unread`), elsewhere the small send buffer does it roughly.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque

from sitl.ground.unread import PeerQueue

SEND_BUFFER = 4096
CHUNK = 65536
DATAGRAM = 1200
LEAD_US = 300_000
CHECK_US = 20_000
MAY_HOLD_S = 20.0  # a UDP peer that reads nothing for so long is taken as gone


class _Backlog:
    """Vehicle time at which each byte was sent; converts a number of unread bytes into a time."""

    def __init__(self) -> None:
        self._sent = 0
        self._marks: deque[tuple[int, int]] = deque()

    def sent(self, count: int, now_us: int) -> None:
        self._sent += count
        self._marks.append((self._sent, now_us))

    def behind_us(self, unread: int, now_us: int) -> int:
        """Time since the oldest unread byte was sent; 0 where everything has been read."""
        read = self._sent - unread
        while self._marks and self._marks[0][0] <= read:
            self._marks.popleft()
        return now_us - self._marks[0][1] if self._marks else 0


class TcpPeer:
    """A client that has connected."""

    def __init__(self, connection: socket.socket, address: tuple[str, int]) -> None:
        self.connection, self.address = connection, address
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._queue = PeerQueue(socket.IPPROTO_TCP, connection.getsockname(), address)
        self._pending = bytearray()
        self._backlog = _Backlog()

    def fileno(self) -> int:
        return self.connection.fileno()

    def receive(self) -> bytes | None:
        """Received bytes, b'' for none, None after the client has closed."""
        try:
            return self.connection.recv(CHUNK) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def queue(self, data: bytes, now_us: int) -> None:
        """Sends `data` with the next `flush`."""
        self._pending += data
        self._backlog.sent(len(data), now_us)

    def flush(self, now_us: int) -> None:
        while self._pending:
            try:
                sent = self.connection.send(self._pending)
            except BlockingIOError:
                return
            except OSError:  # closed by the peer: `receive` reports it
                self._pending.clear()
                return
            del self._pending[:sent]

    def behind_us(self, now_us: int) -> int:
        """Vehicle time that the client has not read yet, us."""
        return self._backlog.behind_us(len(self._pending) + (self._queue.unread() or 0), now_us)

    def close(self) -> None:
        self._queue.close()
        self.connection.close()


class UdpPeer:
    """A ground station at a given address; whoever answers from there is heard."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.address = (socket.gethostbyname(address[0]), address[1])
        self.connection = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        host = "127.0.0.1" if self.address[0].startswith("127.") else ""
        self.connection.bind((host, 0))
        self.connection.setblocking(False)
        self._queue = PeerQueue(socket.IPPROTO_UDP, self.connection.getsockname(), self.address)
        self._pending: list[bytes] = []
        self._size = 0
        self._backlog = _Backlog()
        self._read_at = time.monotonic()

    def fileno(self) -> int:
        return self.connection.fileno()

    def receive(self) -> bytes | None:
        try:
            data, sender = self.connection.recvfrom(CHUNK)
        except OSError:  # nothing there, or nobody listens yet (ICMP)
            return b""
        return data if sender == self.address else b""

    def queue(self, data: bytes, now_us: int) -> None:
        if self._size + len(data) > DATAGRAM:
            self.flush(now_us)
        self._pending.append(data)
        self._size += len(data)

    def flush(self, now_us: int) -> None:
        if self._pending:
            with contextlib.suppress(OSError):  # lost, as a datagram may be
                self.connection.sendto(b"".join(self._pending), self.address)
            self._backlog.sent(1, now_us)
        self._pending, self._size = [], 0

    def behind_us(self, now_us: int) -> int:
        if not self._queue.unread():  # the kernel counts buffers, not bytes: only "all read" is exact
            self._read_at = time.monotonic()
            return self._backlog.behind_us(0, now_us)
        if time.monotonic() - self._read_at > MAY_HOLD_S:
            return 0
        return self._backlog.behind_us(1, now_us)

    def close(self) -> None:
        self._queue.close()
        self.connection.close()


Peer = TcpPeer | UdpPeer


class MavlinkServer:
    """The peers of one vehicle. `listen` is (host, port) for TCP, port 0 for a free one; None for no TCP."""

    def __init__(self, listen: tuple[str, int] | None, udp: tuple[str, int] | None) -> None:
        self.peers: list[Peer] = []
        self._listener: socket.socket | None = None
        if listen is not None:
            self._listener = socket.create_server(listen, backlog=4)
            self._listener.setblocking(False)
        if udp is not None:
            self.peers.append(UdpPeer(udp))
        self._checked_us = 0

    @property
    def port(self) -> int | None:
        """The TCP port listened on."""
        return None if self._listener is None else int(self._listener.getsockname()[1])

    def accept(self) -> TcpPeer | None:
        """A client that has just connected, None if nobody has."""
        if self._listener is None:
            return None
        try:
            connection, address = self._listener.accept()
        except OSError:
            return None
        peer = TcpPeer(connection, address[:2])
        self.peers.append(peer)
        return peer

    def remove(self, peer: Peer) -> None:
        peer.close()
        self.peers.remove(peer)

    def drop_clients(self) -> None:
        """Closes every TCP connection, as a reboot of hardware on USB does."""
        for peer in [p for p in self.peers if isinstance(p, TcpPeer)]:
            self.remove(peer)

    def wait(self, seconds: float) -> None:
        """Sleeps until data arrive, at most for this time."""
        listening = [] if self._listener is None else [self._listener]
        select.select([*self.peers, *listening], [], [], seconds)

    def flush(self, now_us: int) -> bool:
        """Sends the queue. True while a peer is too far behind: vehicle time must wait."""
        for peer in self.peers:
            peer.flush(now_us)
        if self._checked_us <= now_us < self._checked_us + CHECK_US:
            return False
        if any(peer.behind_us(now_us) > LEAD_US for peer in self.peers):
            return True
        self._checked_us = now_us
        return False

    def close(self) -> None:
        for peer in self.peers:
            peer.close()
        if self._listener is not None:
            self._listener.close()
