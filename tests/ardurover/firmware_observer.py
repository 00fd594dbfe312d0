"""What the firmware really does, told by itself on its second port, to an observer that no rule counts as a
ground station (system id 254, no heartbeats)."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot
from typing import Any, NamedTuple

from firmware_relay import TRIM_US

from rover_sweep.vehicle.link.mavlink import Codec, Framer, constant, is_autopilot, kind, make, message_id

SYSTEM = 254
_RATES = {"HEARTBEAT": 5, "SERVO_OUTPUT_RAW": 20, "LOCAL_POSITION_NED": 10}  # Hz
_ARMED = 128


class Row(NamedTuple):
    """At one SERVO_OUTPUT_RAW. t [s], throttle output [us], armed, the applet's state, place [m]."""

    t: float
    throttle: int
    armed: bool
    state: int
    x: float
    y: float

    @property
    def driving(self) -> bool:
        return self.armed and self.throttle != TRIM_US


@dataclass
class Seen:
    """Since `Observer.begin`. begun: runs that SWP_RUN newly showed; texts: (t, text)."""

    rows: list[Row] = field(default_factory=list)
    begun: list[int] = field(default_factory=list)
    texts: list[tuple[float, str]] = field(default_factory=list)

    def said(self, start: str) -> list[str]:
        return [text for _, text in self.texts if text.startswith(start)]

    def last_driven(self) -> float:
        """Time [s] of the last throttle off trim; -inf for none."""
        return max((row.t for row in self.rows if row.driving), default=float("-inf"))

    def driven_after(self, t: float) -> float:
        """s with throttle off trim after `t`."""
        return sum(b.t - a.t for a, b in pairwise(self.rows) if a.t >= t and a.driving)

    def metres_after(self, t: float) -> float:
        """Way [m] after `t`, coasting among it."""
        return sum(hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(self.rows) if a.t >= t)


class Observer:
    """state, run: of the applet (run -1: not told yet); armed, mode, speed [m/s]: of the rover. Use as a
    context manager."""

    def __init__(self, connection: str) -> None:
        _, host, port = connection.split(":")
        self._socket = _connected(host, int(port) + 2)
        self._codec, self._framer = Codec(system=SYSTEM), Framer()
        self._ends, self._due = False, list[tuple[float, Callable[[], None]]]()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.state, self.run = 0, -1
        self.armed, self.mode, self.speed, self._x, self._y = False, 0, 0.0, 0.0, 0.0
        self.begin()

    def begin(self) -> None:
        """Another scenario."""
        self.seen, self._at = Seen(), None

    def at(self, state: int, seconds: float, action: Callable[[], None]) -> None:
        """Do it so long after the applet is first in that state."""
        self._at = (state, seconds, action)

    def after(self, seconds: float, action: Callable[[], None]) -> None:
        self._due.append((time.monotonic() + seconds, action))

    def __enter__(self) -> Observer:
        for name, rate in _RATES.items():
            self.command("MAV_CMD_SET_MESSAGE_INTERVAL", message_id(name), 1e6 / rate)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        self._thread.join()
        self._socket.close()

    def command(self, name: str, *params: float) -> None:
        values = {f"param{i}": params[i - 1] if i <= len(params) else 0.0 for i in range(1, 8)}
        self._send("COMMAND_LONG", command=constant(name), confirmation=0, **values)

    def set(self, name: str, value: float) -> None:
        """A parameter, a float on the vehicle or not: ArduPilot takes all as floats."""
        self._send("PARAM_SET", param_id=name.encode(), param_value=value, param_type=9)

    def wait(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Whether it came to be so within that time."""
        deadline = time.monotonic() + seconds
        while not (reached := until()) and time.monotonic() < deadline:
            time.sleep(0.05)
        return reached

    def _send(self, name: str, **fields: Any) -> None:
        self._socket.sendall(self._codec.pack(make(name, target_system=1, target_component=1, **fields)))

    def _serve(self) -> None:
        while not self._ends:
            for message in self._received():
                self._take(message)
            now = time.monotonic()
            due = [one for one in self._due if one[0] <= now]
            self._due = [one for one in self._due if one[0] > now]
            for _, action in due:
                action()

    def _received(self) -> Iterator[Any]:
        data = b""
        with contextlib.suppress(TimeoutError):
            data = self._socket.recv(65536)
        for frame, whole in self._framer.feed(data):
            message = self._codec.decode(frame) if whole else None
            if message is not None and message.get_srcSystem() == 1:
                yield message

    def _take(self, message: Any) -> None:
        now = time.monotonic()
        match kind(message):
            case "HEARTBEAT" if is_autopilot(message):
                self.armed, self.mode = bool(message.base_mode & _ARMED), int(message.custom_mode)
            case "NAMED_VALUE_FLOAT":
                self._named(message.name, int(message.value))
            case "LOCAL_POSITION_NED":
                self.speed = hypot(message.vx, message.vy)
                self._x, self._y = message.x, message.y
            case "SERVO_OUTPUT_RAW":
                row = Row(now, message.servo3_raw, self.armed, self.state, self._x, self._y)
                self.seen.rows.append(row)
            case "STATUSTEXT":
                self.seen.texts.append((now, message.text))

    def _named(self, name: str, value: int) -> None:
        if name == "SWP_RUN":
            if self.run >= 0 and value != self.run:
                self.seen.begun.append(value)
            self.run = value
        elif name == "SWP_ST":
            self.state = value
            if self._at is not None and value == self._at[0]:
                self.after(*self._at[1:])
                self._at = None


def _connected(host: str, port: int) -> socket.socket:
    """The firmware opens this port while it boots."""
    deadline = time.monotonic() + 60.0
    while True:
        try:
            made = socket.create_connection((host, port), timeout=5.0)
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        else:
            made.settimeout(0.05)
            return made
