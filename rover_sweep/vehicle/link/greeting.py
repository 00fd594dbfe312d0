"""Whose datagrams count on a UDP port, and who is answered: the address from which the vehicle's heartbeat
came. Pure: it opens no socket and knows no clock.

Until `settle` says which vehicle is spoken with, every address that sent an autopilot's heartbeat is heard
and none is answered. From then on one address counts, the peer. Datagrams of others are counted, not parsed.
A peer that fell silent may come back from another address (a radio bridge that restarted): it is accepted
there once its heartbeat is heard. With a signing key only a heartbeat signed with it counts, and is answered
at once: a vehicle without GPS takes the time of its own signatures from our first message.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rover_sweep.vehicle.link.mavlink import Codec, Framer, is_autopilot, sender

SILENT = 3.0  # s without a datagram of the peer until it is looked for at another address
_MOST = 32  # addresses that are kept apart, so that a flood of forged ones fills no memory

SocketAddress = Any  # as the socket module gives them: (host, port, ...)


class Greeting:
    """peer: the address that is answered, None while there is none; ignored: datagrams of other addresses.

    given: the address that this program speaks to first; then no other is ever accepted.
    """

    def __init__(self, given: SocketAddress | None = None) -> None:
        self.peer, self.ignored = given, 0
        self._given = given is not None
        self._system: int | None = None
        self._authentic: Callable[[bytes], bool] | None = None
        self._codec, self._framers = Codec(), dict[SocketAddress, Framer]()
        self._systems: dict[SocketAddress, set[int]] = {}
        self._stranger: SocketAddress | None = None
        self._remarked, self._heard, self._now = False, 0.0, 0.0

    def believe(self, authentic: Callable[[bytes], bool]) -> None:
        """Only a heartbeat for whose frame this holds greets."""
        self._authentic = authentic

    def settle(self, system: int) -> None:
        """The vehicle that is spoken with has this system id: the peer is where its heartbeat came from, or
        will come from."""
        self._system = system
        if not self._given:
            self.peer = next((a for a, systems in self._systems.items() if system in systems), None)
        self._heard = self._now
        self._forget()

    def takes(self, data: bytes, address: SocketAddress, now: float) -> bool:
        """Whether a datagram counts that came from `address`. now [s]: never goes back."""
        self._now = now
        if address == self.peer:
            self._heard = now
            return True
        looking = self._system is None or self.peer is None or now - self._heard > SILENT
        if not self._given and looking and self._greeted(data, address, now):
            return True
        self.ignored += 1
        self._stranger = self._stranger or address
        return False

    def remark(self) -> str:
        """That a stranger sends here, as a sentence, once; '' else."""
        if self._remarked or self._stranger is None or self.peer is None:
            return ""
        self._remarked = True
        return (
            f"datagrams from {_words(self._stranger)} are ignored: the vehicle is at {_words(self.peer)}; "
            "find out who sends to this port"
        )

    def _greeted(self, data: bytes, address: SocketAddress, now: float) -> bool:
        """Whether the heartbeat of a vehicle that may be spoken with has come from there by now. While nobody
        is settled on, one that `believe` refuses is heard too, so that the reason can be told."""
        self._look(data, address)
        systems = self._systems.get(address)
        known = self._authentic is not None if self._system is None else self._system in (systems or ())
        if systems and known:
            self.peer, self._heard = address, now
            if self._system is not None:
                self._forget()
            return True
        return self._system is None and systems is not None

    def _look(self, data: bytes, address: SocketAddress) -> None:
        """Note the autopilots whose heartbeats come from there."""
        framer = self._framers.get(address)
        if framer is None:
            if len(self._framers) >= _MOST:
                self._forget()
            framer = self._framers[address] = Framer()
        for frame, whole in framer.feed(data):
            message = self._codec.decode(frame) if whole else None
            if message is None or not is_autopilot(message):
                continue
            systems = self._systems.setdefault(address, set())
            if self._authentic is None or self._authentic(frame):
                systems.add(sender(message)[0])

    def _forget(self) -> None:
        self._framers.clear()
        self._systems.clear()


def _words(address: SocketAddress) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
