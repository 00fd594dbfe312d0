"""Bytes to and from a vehicle over TCP, UDP or a serial line. Only UDP reads MAVLink: heartbeats show which
address to answer (`greeting`)."""

from __future__ import annotations

import os
import re
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.link.greeting import Greeting

_CHUNK = 65536
# Unread data slow down a vehicle that is simulated faster than real time. With a small buffer its clock
# cannot run seconds ahead of the override that we send.
_TCP_RECEIVE_BUFFER = 16384
_UDP_RECEIVE_BUFFER = 4 << 20
_BOOTTIME: int | None = getattr(time, "CLOCK_BOOTTIME", None)


class Transport(Protocol):
    """A two-way stream of bytes."""

    def receive(self, timeout: float) -> bytes:
        """The bytes received within `timeout` s, b'' if none; ConnectionError when it was closed."""
        ...

    def send(self, data: bytes) -> None: ...
    def close(self) -> None: ...

    def settle(self, system: int) -> None:
        """Accept the vehicle with this system id only. Only UDP needs this."""
        return

    def believe(self, authentic: Callable[[bytes], bool]) -> None:
        """Accept only heartbeats for whose frames `authentic` is true. Only UDP needs this."""
        return

    def remark(self) -> str:
        """A sentence for the user on the connection, once; else ''."""
        return ""


class Line(Protocol):
    """How a link reaches its vehicle, and its clock. All unpredictable input of a link comes through a line,
    so that a conversation can be recorded and replayed there."""

    def open(self, url: str, timeout: float = 5.0) -> Transport:
        """A connection to `url`. LinkError if it cannot be opened within `timeout` s."""
        ...

    def monotonic(self) -> float:
        """Seconds from any origin, never going back; may stop while the computer sleeps."""
        ...

    def since_boot(self) -> float:
        """Seconds from any origin, never going back; continues while the computer sleeps."""
        ...

    def wall(self) -> float:
        """UTC [s since 1970], if the computer's clock is right."""
        ...

    def sleep(self, seconds: float) -> None: ...


class LiveLine:
    """Real connections and real time."""

    def open(self, url: str, timeout: float = 5.0) -> Transport:
        return open_transport(url, timeout)

    def monotonic(self) -> float:
        return time.monotonic()

    def since_boot(self) -> float:
        # Linux: CLOCK_MONOTONIC stops in suspend. macOS has no CLOCK_BOOTTIME; there `wall` shows it.
        return time.clock_gettime(_BOOTTIME) if _BOOTTIME is not None else time.monotonic()

    def wall(self) -> float:
        return time.time()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


@dataclass(frozen=True)
class Address:
    """A parsed connection URL."""

    scheme: str  # tcp, udpin, udpout, serial
    host: str
    port: int  # the baud rate for serial


def parse_url(url: str) -> Address:
    """tcp:HOST:PORT, udp:HOST:PORT or udpin: (listen), udpout:HOST:PORT (send first), /dev/ttyX[,BAUD]."""
    scheme, _, rest = url.partition(":")
    _refuse_colon(url)
    if url.startswith("/dev/"):
        device, _, baud = url.partition(",")
        return Address("serial", device, _number(baud or "115200", url))
    host, _, port = rest.rpartition(":")
    if scheme not in ("tcp", "udp", "udpin", "udpout") or not port:
        raise UsageError(
            f"connection {url!r} is not understood; use tcp:HOST:PORT, udp:HOST:PORT (listen), "
            "udpout:HOST:PORT, or a serial device as /dev/ttyACM0,115200"
        )
    return Address("udpin" if scheme == "udp" else scheme, host.strip("/") or "127.0.0.1", _number(port, url))


_COLON = re.compile(r"(?P<port>/dev/tty[\w.-]+|(?P<windows>COM\d+)):?,?(?P<baud>\d*)", re.IGNORECASE)


def _refuse_colon(url: str) -> None:
    """UsageError for a serial port in another program's form: /dev/ttyUSB0:57600, COM3:57600."""
    found = _COLON.fullmatch(url)
    if found is not None and found["windows"]:
        raise UsageError(
            f"connection {url!r} is a serial port of Windows, which this program cannot open; let a ground "
            "station forward the vehicle by UDP and give udp:0.0.0.0:14550, or use Linux or macOS with "
            f"/dev/ttyUSB0,{found['baud'] or 57600}"
        )
    if found is not None and ":" in url:
        raise UsageError(
            f"connection {url!r} is not understood; write a comma before the baud rate: "
            f"{found['port']},{found['baud'] or 57600}"
        )


def _number(text: str, url: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) < 10):  # int() takes digits of any script
        raise UsageError(f"connection {url!r}: {text!r} is not a port or baud rate")
    return int(text)


def open_transport(url: str, timeout: float = 5.0) -> Transport:
    """Open a connection. LinkError if it cannot be opened."""
    address = parse_url(url)
    try:
        if address.scheme == "serial":
            return Serial(address.host, address.port)
        if address.scheme == "tcp":
            return Tcp(address.host, address.port, timeout)
        return Udp(address.host, address.port, listen=address.scheme == "udpin")
    except OSError as error:
        raise LinkError(f"cannot open {url}: {error.strerror or error}; {_advice(address)}") from error


def _advice(address: Address) -> str:
    if address.scheme == "serial":
        return (
            "is the vehicle plugged in, is another program using the port, may you read it (group dialout)?"
        )
    if address.scheme == "udpin":
        return "is another ground station listening on that port?"
    return "is the vehicle running and is that its address?"


class Tcp(Transport):
    """A TCP client."""

    def __init__(self, host: str, port: int, timeout: float) -> None:
        info = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        self._socket = socket.socket(*info[:3])
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _TCP_RECEIVE_BUFFER)
        self._socket.settimeout(timeout)
        try:
            self._socket.connect(info[4])
        except OSError:
            self._socket.close()
            raise
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def receive(self, timeout: float) -> bytes:
        if not select.select([self._socket], [], [], max(timeout, 0.0))[0]:
            return b""
        data = self._socket.recv(_CHUNK)
        if not data:
            raise ConnectionResetError("closed by the vehicle")
        return data

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


class Udp(Transport):
    """UDP, listening or sending first; `Greeting` decides which address is the vehicle."""

    def __init__(self, host: str, port: int, listen: bool) -> None:
        info = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(*info[:3])
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _UDP_RECEIVE_BUFFER)
        self._greeting = Greeting(None if listen else info[4])
        if listen:
            try:
                self._socket.bind(info[4])
            except OSError:
                self._socket.close()
                raise

    def receive(self, timeout: float) -> bytes:
        if not select.select([self._socket], [], [], max(timeout, 0.0))[0]:
            return b""
        try:
            data, address = self._socket.recvfrom(_CHUNK)
        except (
            ConnectionRefusedError
        ):  # nobody listens there yet; the heartbeat watch tells when for too long
            return b""
        return data if self._greeting.takes(data, address, time.monotonic()) else b""

    def send(self, data: bytes) -> None:
        if self._greeting.peer is None:
            return
        try:
            self._socket.sendto(data, self._greeting.peer)
        except ConnectionRefusedError:
            return

    def settle(self, system: int) -> None:
        self._greeting.settle(system)

    def believe(self, authentic: Callable[[bytes], bool]) -> None:
        self._greeting.believe(authentic)

    def remark(self) -> str:
        return self._greeting.remark()

    def close(self) -> None:
        self._socket.close()


class Serial(Transport):
    """A serial line, raw 8N1, by termios."""

    def __init__(self, device: str, baud: int) -> None:
        import termios

        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            raise UsageError(
                f"serial ports do not support baud rate {baud}; 57600, 115200 and 921600 are usual"
            )
        self._fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            cc = termios.tcgetattr(self._fd)[6]
            cc[termios.VMIN], cc[termios.VTIME] = 0, 0
            control = termios.CS8 | termios.CREAD | termios.CLOCAL
            termios.tcsetattr(self._fd, termios.TCSANOW, [0, 0, control, 0, speed, speed, cc])
        except (OSError, termios.error) as error:
            os.close(self._fd)
            raise LinkError(
                f"{device} is not a serial port; give the vehicle's, such as /dev/ttyACM0 or /dev/ttyUSB0"
            ) from error

    def receive(self, timeout: float) -> bytes:
        if not select.select([self._fd], [], [], max(timeout, 0.0))[0]:
            return b""
        try:
            data = os.read(self._fd, _CHUNK)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionResetError("the serial device went away")
        return data

    def send(self, data: bytes) -> None:
        while data:
            if not select.select([], [self._fd], [], 1.0)[1]:
                raise ConnectionResetError("the serial device takes no data")
            data = data[os.write(self._fd, data) :]

    def close(self) -> None:
        os.close(self._fd)
