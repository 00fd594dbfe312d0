"""A small ground station for the tests of the embedded rover: a socket, pymavlink's codec, and patience."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ROOT = Path(__file__).parents[2]


class Client:
    """Sends as one system id (255 is the pilot's); status texts are kept in `texts`."""

    def __init__(self, port: int, system: int = 255) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=5.0)
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.robust_parsing = True
        self.texts: list[str] = []
        self.vehicle_ms = 0
        self._partial = ""
        self._queue: list[Any] = []

    def send(self, message: Any) -> None:
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        self.socket.sendall(data)

    def messages(self, timeout: float = 5.0) -> Iterator[Any]:
        """Messages as they come, for at most `timeout` s of real time."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            while self._queue:
                message = self._queue.pop(0)
                self._note(message)
                yield message
            self.socket.settimeout(max(end - time.monotonic(), 0.01))
            try:
                data = self.socket.recv(65536)
            except TimeoutError:
                return
            if not data:
                raise ConnectionResetError
            self._queue += self.mav.parse_buffer(data) or []

    def _note(self, message: Any) -> None:
        self.vehicle_ms = max(self.vehicle_ms, getattr(message, "time_boot_ms", 0))
        if message.get_type() == "STATUSTEXT":
            self._partial += message.text
            if message.id == 0 or len(message.text) < 50:
                self.texts.append(self._partial)
                self._partial = ""

    def wait(
        self, kind: str, where: Callable[[Any], bool] = lambda message: True, timeout: float = 5.0
    ) -> Any:
        """The next message of a kind; fails the test after `timeout` s."""
        for message in self.messages(timeout):
            if message.get_type() == kind and where(message):
                return message
        raise AssertionError(f"no {kind} within {timeout} s; texts: {self.texts[-5:]}")

    def absent(self, kind: str, vehicle_ms: int, where: Callable[[Any], bool] = lambda message: True) -> bool:
        """Whether none comes for so long of vehicle time."""
        start = self.wait("SYSTEM_TIME").time_boot_ms
        for message in self.messages(10.0):
            if message.get_type() == kind and where(message):
                return False
            if getattr(message, "time_boot_ms", 0) >= start + vehicle_ms:
                return True
        raise AssertionError("the vehicle's time stands still")

    def wait_text(self, part: str, timeout: float = 5.0) -> str:
        """The first status text that contains `part`, also among those that came before."""
        for text in self.texts:
            if part in text:
                return text
        for _ in self.messages(timeout):
            if self.texts and part in self.texts[-1]:
                return self.texts[-1]
        raise AssertionError(f"no text with '{part}': {self.texts}")

    def command(self, number: int, *numbers: float) -> int:
        """COMMAND_LONG; the MAV_RESULT of its acknowledgement."""
        filled = [*numbers, *([0.0] * (7 - len(numbers)))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *filled))
        return int(self.wait("COMMAND_ACK", lambda m: m.command == number).result)

    def interval(self, message_id: int, microseconds: int) -> int:
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, microseconds)

    def arm(self, armed: bool = True) -> int:
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, float(armed))

    def set_parameter(self, name: str, value: float) -> float:
        """Sets one; the value that the vehicle echoes."""
        self.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
        return float(self.wait("PARAM_VALUE", lambda m: m.param_id == name).param_value)

    def read_parameter(self, name: str) -> Any:
        self.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
        return self.wait("PARAM_VALUE", lambda m: m.param_id == name)

    def override(self, **channels: int) -> None:
        """RC_CHANNELS_OVERRIDE, channels by c1..c8; the others are left."""
        values = [channels.get(f"c{n}", 65535) for n in range(1, 9)]
        self.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *values))

    def close(self) -> None:
        self.socket.close()


@contextmanager
def embedded(directory: Path, *options: str) -> Iterator[int]:
    """An embedded rover in its own process; yields the TCP port. It must end by SIGTERM with code 0."""
    command = [sys.executable, "-m", "sitl.embedded", "--directory", str(directory), *options]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert program.stdout is not None
        yield json.loads(program.stdout.readline())["tcp"]
    finally:
        program.send_signal(signal.SIGTERM)
        assert program.wait(5.0) == 0
