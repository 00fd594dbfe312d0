"""A serial cable from a simulated rover to a pseudo-terminal: it can be pulled and plugged in again.

    with SerialCable("tcp:127.0.0.1:5760") as cable:
        Link.open(cable.device, ...)

The rover is connected when the first byte comes from the ground station, and again after its reboot, as the
embedded rover then closes its TCP connection.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import tempfile
import threading
import tty

_WAIT = 0.02  # s


class SerialCable:
    """device: a name of the pseudo-terminal that stays."""

    def __init__(self, rover: str) -> None:
        _, host, port = rover.split(":")
        self._rover = (host, int(port))
        self._folder = tempfile.mkdtemp(dir="/dev/shm")  # a port's name begins with /dev/
        self.device = f"{self._folder}/port"
        self._end = threading.Event()
        self.plug()

    def __enter__(self) -> SerialCable:
        return self

    def __exit__(self, *_: object) -> None:
        self.pull()
        os.rmdir(self._folder)

    def plug(self) -> None:
        """The device is there."""
        self._end.clear()
        self._inside, self._held = os.openpty()
        tty.setraw(self._held)  # also while no program has it open
        os.set_blocking(self._inside, False)
        os.symlink(os.ttyname(self._held), self.device)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def pull(self) -> None:
        """The device is gone, as after pulling a USB cable."""
        if not self._end.is_set():
            self._end.set()
            self._thread.join(5)
            os.unlink(self.device)
            os.close(self._inside)
            os.close(self._held)

    def _serve(self) -> None:
        while not self._end.is_set():
            if select.select([self._inside], [], [], _WAIT)[0]:
                with contextlib.suppress(OSError), socket.create_connection(self._rover, 1.0) as rover:
                    rover.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._relay(rover)

    def _relay(self, rover: socket.socket) -> None:
        while not self._end.is_set():
            ready = select.select([self._inside, rover], [], [], _WAIT)[0]
            if self._inside in ready:
                rover.sendall(os.read(self._inside, 4096))
            if rover in ready:
                data = rover.recv(4096)
                if not data:
                    return
                self._write(data)

    def _write(self, data: bytes) -> None:
        while data and not self._end.is_set():
            if select.select([], [self._inside], [], _WAIT)[1]:
                with contextlib.suppress(BlockingIOError):
                    data = data[os.write(self._inside, data) :]
