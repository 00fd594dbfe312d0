"""A line into the air: rovers that send on their own, on a clock that goes on while the link waits.

air = Air({1: (0.0, 5.0), 7: (0.3, 9.0)})      # system id: when it is heard, from and to [s]
link = Link.open("air:", tlog, line=air)
air.sent                                        # what the link sent
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.vehicle.link.transport import Transport

EVER = float("inf")
_STEP = 0.02  # s


class Air(Transport):
    """Line and transport in one. Each rover sends a heartbeat a second and five attitudes; its yaw rate is
    its system id. speed: seconds of the rovers' clocks in one of the link's."""

    def __init__(self, rovers: dict[int, tuple[float, float]], speed: float = 1.0) -> None:
        self.rovers, self.speed = rovers, speed
        self.now, self.sent, self.settled = 0.0, list[bytes](), 0
        self._mavs = {system: m.MAVLink(None, srcSystem=system, srcComponent=1) for system in rovers}
        self._turns = dict.fromkeys(rovers, 0)

    def open(self, url: str, timeout: float = 5.0) -> Transport:
        return self

    def monotonic(self) -> float:
        return self.now

    def since_boot(self) -> float:
        return self.now

    def wall(self) -> float:
        return 1.7e9 + self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def receive(self, timeout: float) -> bytes:
        until = self.now + max(timeout, _STEP)
        while self.now < until:
            self.now += _STEP
            if data := b"".join(self._told(system) for system in self.rovers):
                return data
        return b""

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def close(self) -> None:
        """Nothing to close."""

    def settle(self, system: int) -> None:
        self.settled = system

    def _told(self, system: int) -> bytes:
        start, end = self.rovers[system]
        data = b""
        while start + self._turns[system] * 0.2 / self.speed <= min(self.now, end):
            turn = self._turns[system]
            self._turns[system] += 1
            messages = [m.MAVLink_attitude_message(turn * 200, 0, 0, 0, 0, 0, float(system))]
            if turn % 5 == 0:
                messages.insert(0, m.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3))
            for message in messages:
                data += bytes(message.pack(self._mavs[system]))
                self._mavs[system].seq = (self._mavs[system].seq + 1) % 256
        return data
