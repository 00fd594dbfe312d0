"""A serial cable from a simulated rover to a pseudo-terminal: it can lose and damage frames, be pulled and
plugged in again.

    with SerialCable("tcp:127.0.0.1:5760", drop=0.01, corrupt=0.01) as cable:
        Link.open(cable.device, ...)

The rover is connected when the first byte comes from the ground station, and again after its reboot, as the
embedded rover then closes its TCP connection.
"""

from __future__ import annotations

import contextlib
import os
import random
import select
import socket
import tempfile
import threading
import tty

from rover_sweep.vehicle.link.mavlink import Framer

_WAIT = 0.02  # s


class SerialCable:
    """device: a name of the pseudo-terminal that stays. passed, damaged, lost: frames, both directions."""

    def __init__(self, rover: str, drop: float = 0.0, corrupt: float = 0.0) -> None:
        _, host, port = rover.split(":")
        self._rover, self.drop, self.corrupt = (host, int(port)), drop, corrupt
        self._folder = tempfile.mkdtemp(dir="/dev/shm")  # a port's name begins with /dev/
        self.device = f"{self._folder}/port"
        self.passed = self.damaged = self.lost = 0
        self._random, self._end = random.Random(1), threading.Event()
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
        down, up = Framer(), Framer()
        while not self._end.is_set():
            ready = select.select([self._inside, rover], [], [], _WAIT)[0]
            if self._inside in ready:
                rover.sendall(self._weathered(up, os.read(self._inside, 4096)))
            if rover in ready:
                data = rover.recv(4096)
                if not data:
                    return
                self._write(self._weathered(down, data))

    def _weathered(self, framer: Framer, data: bytes) -> bytes:
        return b"".join(self._frame(frame) for frame, _ in framer.feed(data))

    def _frame(self, frame: bytes) -> bytes:
        chance = self._random.random()
        if chance < self.drop:
            self.lost += 1
            return b""
        if chance < self.drop + self.corrupt:
            self.damaged += 1
            at = self._random.randrange(len(frame))
            return frame[:at] + bytes([frame[at] ^ 0x55]) + frame[at + 1 :]
        self.passed += 1
        return frame

    def _write(self, data: bytes) -> None:
        while data and not self._end.is_set():
            if select.select([], [self._inside], [], _WAIT)[1]:
                with contextlib.suppress(BlockingIOError):
                    data = data[os.write(self._inside, data) :]
