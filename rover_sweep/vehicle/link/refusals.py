"""Why a link with a signing key does not accept a vehicle: its heartbeats fail the check of the key."""

from __future__ import annotations

from typing import Literal

from rover_sweep.vehicle.link.mavlink import Codec, is_autopilot
from rover_sweep.vehicle.link.signing import SigningKey, signs

PATIENCE = 2.4  # s after the first refusal in which another vehicle, one with the key, may appear

Why = Literal["", "unsigned", "other key", "old"]
_WORDS = {
    "unsigned": "does not sign its messages, but --signing-key was given; "
    "leave --signing-key out, or set up signing on the vehicle",
    "other key": "signs with another key than that of --signing-key; give the key that was set up on it",
    "old": "signs with a time more than a minute behind this computer's; is this computer's clock right? "
    "A vehicle takes the time from GPS, or from the first signed message that it receives",
}


class Refusals:
    """why: reason for the last refused heartbeat of an autopilot; since: time of the first refusal [s]."""

    def __init__(self, key: SigningKey | None) -> None:
        self._key, self._codec = key, Codec()
        self.why: Why = ""
        self.since: float | None = None

    def look(self, frame: bytes, now: float) -> None:
        """Examine a frame that the link could not decode, at time `now` [s]."""
        message = self._codec.decode(frame) if self._key is not None else None
        if message is None or self._key is None or not is_autopilot(message):
            return
        self.since = now if self.since is None else self.since
        self.why = "unsigned" if not signs(frame) else "old" if self._key.signed(frame) else "other key"

    def final(self, now: float) -> bool:
        """Whether more waiting is useless: our messages correct an old time, but not a wrong key."""
        waited = self.since is not None and now - self.since > PATIENCE
        return waited and self.why in ("unsigned", "other key")

    def words(self, url: str) -> str:
        """The reason and what to do; '' if nothing was refused."""
        return f"the vehicle on {url} {_WORDS[self.why]}" if self.why else ""
