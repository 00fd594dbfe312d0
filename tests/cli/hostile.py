"""A vehicle and logs that try to reach the terminal: every text that is theirs holds control characters."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.vehicle.link import transport
from rover_sweep.vehicle.link.mavlink import Codec, Framer, kind
from rover_sweep.vehicle.link.transport import Transport

TEXT = b"SWP \x1b[2J\x1b]52;c;aGk=\x07\r\x08\n[red]\x7f\x9b31m\xe2\x80\xae"
NAME = b"A\x1b]0;x\x07\n\x9b"  # of a parameter, in place of OURS
OURS = "TURN_RADIUS"


def raw(text: str) -> set[str]:
    """The control characters in an output, but for line breaks."""
    return {c for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp", "Cs")}


def hostile_link(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on each vehicle's texts, a parameter's name and the firmware's hash are hostile."""
    opened = transport.LiveLine.open
    monkeypatch.setattr(
        transport.LiveLine, "open", lambda self, url, timeout=5.0: _Hostile(opened(self, url, timeout))
    )


class _Hostile(Transport):
    """What the vehicle sends, changed on the way."""

    def __init__(self, inner: Transport) -> None:
        self._inner, self._codec, self._framer = inner, Codec(1, 1), Framer()

    def receive(self, timeout: float) -> bytes:
        return b"".join(
            self._changed(frame) if whole else frame
            for frame, whole in self._framer.feed(self._inner.receive(timeout))
        )

    def send(self, data: bytes) -> None:
        self._inner.send(data)

    def close(self) -> None:
        self._inner.close()

    def _changed(self, frame: bytes) -> bytes:
        message = self._codec.decode(frame)
        match message and kind(message):
            case "HEARTBEAT":
                theirs = (
                    m.MAVLink_statustext_message(2, TEXT),
                    m.MAVLink_named_value_float_message(1, NAME, 1.0),
                )
                return b"".join((frame, *(_packed(frame, t) for t in theirs)))
            case "PARAM_VALUE" if message.param_id == OURS:
                v = message
                renamed = (NAME, v.param_value, v.param_type, v.param_count, v.param_index)
                return _packed(frame, m.MAVLink_param_value_message(*renamed))
            case "AUTOPILOT_VERSION":
                message.flight_custom_version = list(b"\x1b[31m\x07\x9b\n")
                return _packed(frame, message)
        return frame


def _packed(frame: bytes, message: Any) -> bytes:
    """The message from the sender of a frame, with its sequence number."""
    sender = m.MAVLink(None, srcSystem=frame[5], srcComponent=frame[6])
    sender.seq = frame[4]
    return bytes(message.pack(sender))


def hostile_copy(log: Path, folder: Path) -> Path:
    """A log whose texts, file name and (in a .BIN) parameters' names are hostile."""
    data = log.read_bytes()
    for ours in (b"ArduRover V", b"SWP: run", b"EKF3 IMU", b"Frame:", b"STAT_RUNTIME"):
        data = data.replace(ours, (ours[:3] + b"\x1b\x07\x9b\r\n\x7f\x08\x1b]0;")[: len(ours)])
    copy = folder / f"$\\frac{{$_\x1b[31m[red]\u202e{log.name}"
    copy.write_bytes(data)
    return copy
