"""Which address on a UDP port is the vehicle: the one that its heartbeat came from. Pure: no socket or clock.

Until `settle` names the vehicle, datagrams are accepted from every address that sent an autopilot's
heartbeat, and none is answered. Afterwards only one address counts, the peer; datagrams of others are counted
and dropped. A silent peer may come back from another address (a radio bridge that restarted): its heartbeat
makes that address the peer. With a signing key only heartbeats signed with it count, and their address is
answered at once: a vehicle without GPS takes the time for its signatures from our first message.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rover_sweep.vehicle.link.mavlink import GCS_SYSTEM, Codec, Framer, is_autopilot, sender

SILENT = 3.0  # s without a datagram of the peer, after which another address may become the peer
_MOST = 32  # addresses kept at a time, so that forged ones cannot fill the memory

SocketAddress = Any  # as the socket module gives them: (host, port, ...)


class Greeting:
    """peer: the address that is answered, None if none yet; ignored: number of datagrams dropped.

    given: the address that this program sends to first; if given, no other is ever accepted.
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
        """Accept only heartbeats for whose frame `authentic` is true."""
        self._authentic = authentic

    def settle(self, system: int) -> None:
        """Choose the vehicle with this system id: the source of its heartbeat is or becomes the peer."""
        self._system = system
        if not self._given:
            self.peer = next((a for a, systems in self._systems.items() if system in systems), None)
        self._heard = self._now
        self._forget()

    def takes(self, data: bytes, address: SocketAddress, now: float) -> bool:
        """Whether a datagram from `address` is accepted. now [s]: never goes back."""
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
        """A sentence, once, if another address sends to this port; else ''."""
        if self._remarked or self.peer is None or self._stranger in (None, self.peer):
            return ""  # what came before the vehicle's first heartbeat may be its own
        self._remarked = True
        return (
            f"datagrams from {_words(self._stranger)} are ignored, because the vehicle is at "
            f"{_words(self.peer)}; find out what sends to this port"
        )

    def _greeted(self, data: bytes, address: SocketAddress, now: float) -> bool:
        """Whether an acceptable heartbeat has come from this address. Until a vehicle is chosen, one that
        `believe` refuses is accepted too, so that the link can report why it was refused."""
        self._note_heartbeats(data, address)
        systems = self._systems.get(address)
        known = self._authentic is not None if self._system is None else self._system in (systems or ())
        if systems and known:
            self.peer, self._heard = address, now
            if self._system is not None:
                self._forget()
            return True
        return self._system is None and systems is not None

    def _note_heartbeats(self, data: bytes, address: SocketAddress) -> None:
        """Remember the autopilots whose heartbeats come from this address."""
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


# From which ground stations a rover accepts overrides, by its parameters. Pure.
#
# Up to 4.6 only from SYSID_MYGCS (Rover-4.6.3 GCS_Common.cpp, handle_rc_channels_override). From 4.7 on that
# parameter is called MAV_GCS_SYSID. If MAV_GCS_SYSID_HI is at least as large, all ids between the two count
# (GCS::sysid_is_gcs of 4.8-dev).


OLD_NAME = "SYSID_MYGCS"
NEW_NAMES = ("MAV_GCS_SYSID", "MAV_GCS_SYSID_HI")


def why_overrides_ignored(have: Mapping[str, float]) -> str:
    """A sentence if the rover would ignore the overrides of this program, else ''.

    have: parameters by name; missing ones count as their defaults (255, no range).
    """
    name = NEW_NAMES[0] if NEW_NAMES[0] in have else OLD_NAME
    low = have.get(name, float(GCS_SYSTEM))
    high = max(low, have.get(NEW_NAMES[1], 0.0))
    if low <= GCS_SYSTEM <= high:
        return ""
    setting = f"{name} is {low:g}" if high == low else f"{name} is {low:g} and {NEW_NAMES[1]} {high:g}"
    return (
        f"{setting}: the rover ignores overrides of other ground stations; this one is {GCS_SYSTEM}, "
        f"set {name} to {GCS_SYSTEM}"
    )
