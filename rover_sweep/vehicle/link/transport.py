"""Bytes to and from a vehicle over TCP, UDP or a serial line. MAVLink is read only to
find the vehicle: heartbeats show which UDP address to answer (`greeting`), frames a serial line's speed."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any, Protocol

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.files.documents import printable
from rover_sweep.system import since_boot
from rover_sweep.vehicle.link.greeting import Greeting
from rover_sweep.vehicle.link.mavlink import Codec, Framer

_CHUNK = 65536
# Unread data slow down a vehicle that is simulated faster than real time. With a small buffer its clock
# cannot run seconds ahead of the override that we send.
_TCP_RECEIVE_BUFFER = 16384
_UDP_RECEIVE_BUFFER = 4 << 20
SPEEDS = (57600, 115200)  # of SiK radios, of ArduPilot's other ports; Bluetooth has one of them
_SPEED_TRIED = 2.5  # s at one speed; a vehicle sends a heartbeat each second
_SLICE = 0.01  # s: changing pyserial's timeout sets up the port anew, so a wait is made of these


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
        return since_boot()

    def wall(self) -> float:
        return time.time()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


@dataclass(frozen=True)
class Address:
    """A parsed connection URL."""

    scheme: str  # tcp, udpin, udpout, serial
    host: str
    port: int  # for serial: the baud rate, 0 if not given


def parse_url(url: str) -> Address:
    """tcp:HOST:PORT, udp:HOST:PORT or udpin: (listen), udpout:HOST:PORT (send first), a serial port with or
    without its speed: COM5, COM5:57600, /dev/ttyUSB0,57600."""
    if (found := _SERIAL.fullmatch(url)) is not None:
        port, baud = found["port"], found["baud"]
        return Address("serial", port.upper() if found["com"] else port, _number(baud, url) if baud else 0)
    scheme, _, rest = url.partition(":")
    host, _, port = rest.rpartition(":")
    if scheme not in ("tcp", "udp", "udpin", "udpout") or not port:
        raise UsageError(
            f"connection {url!r} is not understood; use tcp:HOST:PORT, udp:HOST:PORT (listen), "
            "udpout:HOST:PORT, or a serial port as COM5, COM5:57600 or /dev/ttyUSB0,57600"
        )
    return Address("udpin" if scheme == "udp" else scheme, host.strip("/") or "127.0.0.1", _number(port, url))


# A name under /dev/serial/by-path holds colons: there only a comma begins the speed.
_SERIAL = re.compile(
    r"(?P<port>(?P<com>COM\d+)|/dev/(?:tty|cu)[^:,]*|/dev/[^,]+)(?:[:,](?P<baud>.*))?", re.IGNORECASE
)


def looks_like_url(text: str) -> bool:
    """Whether a text is meant as a connection, not as a file."""
    return text.startswith(("tcp:", "udp")) or _SERIAL.fullmatch(text) is not None


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


# Nobody listens there yet (Windows: reset); the heartbeat watch tells when for too long.
_NOBODY = (ConnectionRefusedError, ConnectionResetError)


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
        except _NOBODY:
            return b""
        return data if self._greeting.takes(data, address, time.monotonic()) else b""

    def send(self, data: bytes) -> None:
        if self._greeting.peer is None:
            return
        try:
            self._socket.sendto(data, self._greeting.peer)
        except _NOBODY:
            return

    def settle(self, system: int) -> None:
        self._greeting.settle(system)

    def believe(self, authentic: Callable[[bytes], bool]) -> None:
        self._greeting.believe(authentic)

    def remark(self) -> str:
        return self._greeting.remark()

    def close(self) -> None:
        self._socket.close()


def speeds_tried(url: str) -> str:
    """Words on the speeds that `Serial` tries on this connection; "" if one is given, or it has none."""
    without = (found := _SERIAL.fullmatch(url)) is not None and not found["baud"]
    return f" at {' or '.join(map(str, SPEEDS))} baud" if without else ""


_HEARD_AT: dict[str, int] = {}  # {device: speed}: a search for a lost vehicle gives each attempt 3 s only


class Serial(Transport):
    """A serial line, 8N1, by pyserial, for this program alone. Without a speed (baud 0) the usual ones are
    tried in turn until a whole frame is heard."""

    def __init__(self, device: str, baud: int) -> None:
        import serial

        self._framer, self._codec = Framer(), Codec()
        self._untried = None if baud else cycle(sorted(SPEEDS, key=lambda s: s != _HEARD_AT.get(device)))
        self._change = time.monotonic() + _SPEED_TRIED
        speed = baud or next(self._untried or iter(SPEEDS))
        self._takes_no_data = serial.SerialTimeoutException
        try:
            self._port = serial.Serial(device, speed, timeout=_SLICE, write_timeout=1.0, exclusive=True)
        except Exception as error:  # SerialException is an OSError; ValueError; termios.error
            raise _not_opened(device, speed, error) from error

    def receive(self, timeout: float) -> bytes:
        until = time.monotonic() + timeout
        data = b""
        with _plugged_in():
            while not data and (self._port.in_waiting or time.monotonic() < until):
                data = self._port.read(1)  # waits for at most _SLICE
            if data:
                data += self._port.read(min(self._port.in_waiting, _CHUNK))
            if self._untried is not None:
                self._try_speeds(self._untried, data)
        return data

    def _try_speeds(self, untried: Iterator[int], data: bytes) -> None:
        if any(is_frame and self._codec.decode(frame) for frame, is_frame in self._framer.feed(data)):
            self._untried = None
            _HEARD_AT[str(self._port.port)] = self._port.baudrate
        elif time.monotonic() >= self._change:
            self._change = time.monotonic() + _SPEED_TRIED
            self._framer = Framer()
            self._port.baudrate = next(untried)

    def send(self, data: bytes) -> None:
        with _plugged_in():
            try:
                self._port.write(data)
            except self._takes_no_data:
                raise ConnectionResetError("the serial device takes no data") from None

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()


@contextmanager
def _plugged_in() -> Iterator[None]:
    """ConnectionResetError for what pyserial raises when the device is unplugged or closed."""
    try:
        yield
    except ConnectionResetError:
        raise
    except Exception as error:  # OSError, TypeError (closed), termios.error
        raise ConnectionResetError("the serial device went away") from error


def _not_opened(device: str, speed: int, error: Exception) -> LinkError | UsageError:
    """What to do about a serial port that did not open. On Windows only pyserial's text has the reason."""
    number, text = getattr(error, "errno", None), str(error)
    if isinstance(error, ValueError):
        return UsageError(f"{device} does not support baud rate {speed}; 57600 and 115200 are usual")
    if number == errno.ENOENT or "FileNotFoundError" in text:
        return LinkError(f"there is no serial port {device}; {_ports_words()}")
    if number in (errno.EACCES, errno.EPERM):
        return LinkError(f"you may not use {device}: join the group dialout (Linux), and log in again")
    if number in (errno.EBUSY, errno.EAGAIN) or "PermissionError" in text:
        return LinkError(
            f"another program uses {device}; close it (Mission Planner, MAVProxy, another session)"
        )
    if number is None and "Could not configure" in text:
        return LinkError(f"{device} is not a serial port; {_ports_words()}")
    return LinkError(f"cannot open {device}: {os.strerror(number) if number else text}; {_ports_words()}")


def _ports_words() -> str:
    ports = serial_ports()
    if not ports:
        return "no serial port is plugged in: is the vehicle on, and its cable one that carries data?"
    return "plugged in: " + ", ".join(f"{port}{what and f': {what}'}" for port, what in ports.items())


_BY_NAME = "/dev/serial/by-id"  # Linux: names that stay the same when a port is plugged in again


def serial_ports() -> dict[str, str]:
    """{port: what is plugged in, "" if unknown}, USB first, on Linux by its stable name."""
    from serial.tools.list_ports import comports

    named = {os.path.realpath(path): str(path) for path in sorted(Path(_BY_NAME).glob("*"), reverse=True)}
    found = [port for port in comports() if port.vid is not None or not port.device.startswith("/dev/ttyS")]
    found.sort(key=lambda port: (port.vid is None, len(port.device), port.device))
    return {named.get(port.device, port.device): _what(port.description or "", port) for port in found}


def _what(description: str, port: Any) -> str:
    """What the system calls the device: Windows adds the port, and pyserial gives n/a or the port's name."""
    words = description.removesuffix(f"({port.device})").strip()
    return "" if words in ("n/a", port.name, port.device) else printable(words)
