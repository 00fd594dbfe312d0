"""Why a vehicle that is there is not heard by a link that signs: its heartbeats fail the check of the key."""

from __future__ import annotations

from typing import Literal

from rover_sweep.vehicle.link.mavlink import Codec, is_autopilot
from rover_sweep.vehicle.link.signing import SigningKey, signs

PATIENCE = 2.4  # s that another vehicle, one with the key, has to be heard after the first refusal

Why = Literal["", "unsigned", "other key", "old"]
_WORDS = {
    "unsigned": "does not sign its messages, so the key of --signing-key is not its own; "
    "leave --signing-key out, or set up signing on the vehicle",
    "other key": "signs with another key than that of --signing-key; give the key that was set up on it",
    "old": "signs with a time more than a minute behind this computer's; is this computer's clock right? "
    "A vehicle takes the time from GPS, or from the first signed message that reaches it",
}


class Refusals:
    """why: of the autopilot's heartbeat that was refused last; since: when the first was [s]."""

    def __init__(self, key: SigningKey | None) -> None:
        self._key, self._codec = key, Codec()
        self.why: Why = ""
        self.since: float | None = None

    def look(self, frame: bytes, now: float) -> None:
        """A frame that the link could not decode."""
        message = self._codec.decode(frame) if self._key is not None else None
        if message is None or self._key is None or not is_autopilot(message):
            return
        self.since = now if self.since is None else self.since
        self.why = "unsigned" if not signs(frame) else "old" if self._key.signed(frame) else "other key"

    def final(self, now: float) -> bool:
        """Whether waiting on is in vain: an old time is put right by what we send, a key is not."""
        waited = self.since is not None and now - self.since > PATIENCE
        return waited and self.why in ("unsigned", "other key")

    def words(self, url: str) -> str:
        """What happened and what to do; '' where nothing was refused."""
        return f"the vehicle on {url} {_WORDS[self.why]}" if self.why else ""
