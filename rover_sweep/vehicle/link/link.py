"""A MAVLink link to one vehicle: connecting, choosing the vehicle, and finding it again after a reboot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Self

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.access import Access
from rover_sweep.vehicle.link.mavlink import sender
from rover_sweep.vehicle.link.recorder import TlogWriter
from rover_sweep.vehicle.link.requests import Requests
from rover_sweep.vehicle.link.signing import signs
from rover_sweep.vehicle.link.transport import Line, LiveLine
from rover_sweep.vehicle.link.watch import SILENCE


class Link(Requests):
    """One vehicle on one connection: see `Connection` for its state, `Requests` for requests."""

    @classmethod
    def open(
        cls,
        url: str,
        tlog_path: Path,
        timeout: float = 15.0,
        line: Line | None = None,
        meanwhile: Callable[[], None] | None = None,
        access: Access | None = None,
    ) -> Self:
        """Connect, record into `tlog_path` and wait up to `timeout` s for a vehicle's heartbeat.

        line: a live line if not given. meanwhile: called repeatedly, here and during every wait on the link;
        its exceptions pass through. access: system id, signing key and callbacks (see `Access`).
        """
        line = line or LiveLine()
        transport = line.open(url)
        try:
            recorder = TlogWriter(tlog_path)
        except BaseException:
            transport.close()
            raise
        link = cls(url, transport, recorder, line, access or Access())
        if meanwhile is not None:
            link.every(0.0, meanwhile)
        try:
            link._find_vehicle(timeout)
        except BaseException:
            link.close()
            raise
        return link

    def _find_vehicle(self, timeout: float) -> None:
        self._require_signatures()
        called, deadline = self._roll_call, self.line.monotonic() + timeout
        while not called.over(now := self.line.monotonic()) and now < deadline:
            if not called.heard and self._inbox.refusals.final(now):
                break
            self._watch.forgive()  # a vehicle that boots may take its time; `timeout` is the limit here
            self.receive(0.05)
        if not called.heard:
            raise LinkError(self._why_nobody(timeout))
        system = self._access.chosen(self.url, called.heard)
        self.heartbeat = called.heartbeats[system]
        self._inbox.target = sender(self.heartbeat)
        self._inbox.others = set(called.heartbeats) - {system}
        self._transport.settle(system)
        self._watch.forgive()
        self._require_key()

    def _require_key(self) -> None:
        """LinkError if the vehicle signs, we do not, and it answers no unsigned request. On its first port
        (USB) ArduPilot accepts unsigned messages too (GCS_Signing.cpp, accept_unsigned_callback)."""
        assert self.heartbeat is not None
        if self._access.key is not None or not signs(bytes(self.heartbeat.get_msgbuf())):
            return
        if self.request_message("AUTOPILOT_VERSION", timeout=1.5) is None:
            raise LinkError(
                f"the vehicle on {self.url} signs its messages and answers no unsigned ones; "
                "give the key set up on it with --signing-key FILE"
            )

    def _why_nobody(self, timeout: float) -> str:
        if refused := self._inbox.refusals.words(self.url):
            return refused
        if others := self._roll_call.others():
            return (
                f"system {self._access.system} was not heard on {self.url} within {timeout:.0f} s, but "
                f"{others}; give the id of your rover with --system"
            )
        return (
            f"no heartbeat of an autopilot on {self.url} within {timeout:.0f} s; "
            "is the vehicle on, is it the right port or baud rate, does that port speak MAVLink?"
        )

    def reconnect(self, timeout: float = 60.0) -> None:
        """Wait until the vehicle is back after a reboot and sends heartbeats. LinkError after `timeout` s.

        It has rebooted when its clock has started again, or when it answers on a connection that had to be
        reopened because the vehicle closed it or was silent.
        """
        boots, deadline, quiet, rebooted = self.clock.boots, self.line.monotonic() + timeout, 0.0, False
        while self.line.monotonic() < deadline:
            try:
                self._request("SYSTEM_TIME")  # shows its clock
                quiet = 0.0 if self.receive(0.3) is not None else quiet + 0.3
                self._watch.forgive()
            except LinkError:
                quiet = SILENCE
            if not rebooted and self.clock.boots > boots:
                rebooted, self.heartbeat = True, None
            if rebooted and self.heartbeat is not None:
                return
            if quiet >= SILENCE and self._reopen():
                quiet, rebooted, self.heartbeat = 0.0, True, None
        raise LinkError(
            f"the vehicle did not come back within {timeout:.0f} s of its reboot; "
            "switch it off and on, and connect again"
        )
