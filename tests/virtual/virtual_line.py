"""The laptop's door to the virtual world: a `transport.Line` without sockets or sleep.

    link = Link.open("virtual:", tlog, line=VirtualLine(world))

Receiving moves the world on, loop by loop, until something has come or the timeout is over. A program that
asks again and again without waiting is given no time, up to a bound: then the world goes on by one loop.
"""

from __future__ import annotations

import signal

from virtual_world import MONOTONIC_0, SINCE_BOOT_0, WALL_0, World

from rover_sweep.vehicle.link.transport import Transport

_IMPATIENT = 2000  # receives in a row that wait for nothing and get nothing


class VirtualLine:
    """See above."""

    def __init__(self, world: World) -> None:
        self.world = world

    def open(self, url: str, timeout: float = 5.0) -> VirtualTransport:
        self.world.connect()
        return VirtualTransport(self)

    def monotonic(self) -> float:
        return MONOTONIC_0 + (self.world.now_us - self.world.laptop.slept_us) * 1e-6

    def wall(self) -> float:
        return WALL_0 + self.world.now + self.world.laptop.wall_jump

    def since_boot(self) -> float:
        return SINCE_BOOT_0 + self.world.now

    def sleep(self, seconds: float) -> None:
        until = self.monotonic() + seconds
        while self.monotonic() < until:
            self.wait()

    def wait(self) -> None:
        """One loop of the world; while the computer sleeps, all of them. Raises as `alive`."""
        world, laptop = self.world, self.world.laptop
        world.step()
        if world.now_us < laptop.wakes_us:
            fell_asleep_us = world.now_us
            while world.now_us < laptop.wakes_us:
                world.step()
            laptop.slept_us += world.now_us - fell_asleep_us
        self.alive()

    def alive(self) -> None:
        """Raises what has happened to the program: its death for good, an interrupt or a signal once."""
        laptop = self.world.laptop
        if laptop.death is not None:
            raise laptop.death
        if laptop.interrupt is not None:
            interrupt, laptop.interrupt = laptop.interrupt, None
            raise interrupt
        if laptop.signal:
            number, laptop.signal = laptop.signal, 0
            signal.raise_signal(number)


class VirtualTransport(Transport):
    """One connection. It is closed by the other side (`World.cut`) or by `close`."""

    def __init__(self, line: VirtualLine) -> None:
        self._line, self._world, self._closed, self._in_vain = line, line.world, False, 0
        self._connection = line.world.connections

    def receive(self, timeout: float) -> bytes:
        self._line.alive()
        self._in_vain = self._in_vain + 1 if timeout <= 0 else 0
        until = self._line.monotonic() + (timeout if self._in_vain < _IMPATIENT else 0.02)
        while not (data := self._world.take()):
            self._check()
            if self._line.monotonic() >= until:
                return b""
            self._line.wait()
        self._in_vain = 0
        return data

    def send(self, data: bytes) -> None:
        self._line.alive()
        self._check()
        self._world.send(data)

    def close(self) -> None:
        self._closed = True

    def _check(self) -> None:
        if self._closed:
            raise ValueError("the connection was closed")
        if not self._world.connected or self._connection != self._world.connections:
            raise ConnectionResetError("closed by the vehicle")
