"""The sticks and switches of a simulated pilot: RC input of ArduPilot's SITL by UDP.

One datagram of 8 PWM values (little-endian, us) to port 5501 + 10 per instance; the firmware keeps the last
one, as a receiver that is never lost (AP_RCProtocol_UDP.cpp in 4.6.3, SITL_State.cpp in 4.5.7).
"""

from __future__ import annotations

import socket
import struct

LOOPBACK = "127.0.0.1"
BASE_PORT = 5501
AT_REST = (1500, 1500, 1500, 1500, 1800, 1000, 1000, 1800)  # what SITL takes until it hears a transmitter
_LAYOUT = struct.Struct("<8H")


class Transmitter:
    """A simulated transmitter: nothing is sent before the first `hold`."""

    def __init__(self, port: int) -> None:
        self._address = (LOOPBACK, port)
        self._pwm = list(AT_REST)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def hold(self, channel: int, us: int) -> None:
        """Hold channel 1..8 at a PWM [us]; may be called again and again, as a radio repeats itself."""
        self._pwm[channel - 1] = us
        self._socket.sendto(_LAYOUT.pack(*self._pwm), self._address)

    def close(self) -> None:
        """Put the transmitter down: sticks and switches at rest."""
        self._socket.sendto(_LAYOUT.pack(*AT_REST), self._address)
        self._socket.close()
