"""STATUSTEXT messages put together: MAVLink 2 cuts texts over 50 characters into chunks."""

from __future__ import annotations

from dataclasses import dataclass, field

from rover_sweep.vehicle.mavlink import Message

_CHUNK = 50


@dataclass(frozen=True)
class StatusText:
    """A line of the vehicle. t: vehicle clock [s] when it came; severity: MAV_SEVERITY (0 worst .. 7)."""

    t: float
    severity: int
    text: str


@dataclass
class TextAssembler:
    """Joins chunks; yields a text when its last chunk has come."""

    _parts: dict[int, str] = field(default_factory=dict)

    def add(self, message: Message, t: float) -> StatusText | None:
        """The whole text that this message completes, else None."""
        text, number = message.text.rstrip("\0"), getattr(message, "id", 0)
        if number:
            text = self._parts.pop(number, "") + text
            if len(message.text.rstrip("\0")) == _CHUNK:
                self._parts[number] = text
                return None
        return StatusText(t, message.severity, text)
