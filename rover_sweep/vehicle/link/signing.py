"""MAVLink signing: reading a key from a file, and checking a frame's signature.

https://mavlink.io/en/guide/message_signing.html: a signed frame has the incompatibility flag 0x01 and ends
with link id (1 byte), timestamp (6) and signature (6), the start of the SHA-256 of the key and all before.
Packing and checking on a link are pymavlink's (`mavlink.Codec`). The key is never shown or written.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass, field
from pathlib import Path

from rover_sweep.errors import UsageError

EPOCH = 1_420_070_400  # s since 1970: 2015-01-01, from which timestamps count
TICK = 1e-5  # s, the unit of a timestamp
_V2, _FLAG, _SIGNATURE = 0xFD, 0x01, 6
_LONGEST = 4096  # bytes of a key file


@dataclass(frozen=True)
class SigningKey:
    """secret: 32 bytes, hidden in repr; source: the file it comes from."""

    secret: bytes = field(repr=False)
    source: str = ""

    def signed(self, frame: bytes) -> bool:
        """Whether a whole frame carries a signature of this key, with any time stamp."""
        digest = hashlib.sha256(self.secret + frame[:-_SIGNATURE]).digest()
        return signs(frame) and hmac.compare_digest(digest[:_SIGNATURE], frame[-_SIGNATURE:])


def signs(frame: bytes) -> bool:
    """Whether a whole frame carries a signature, right or wrong."""
    return frame[0] == _V2 and bool(frame[2] & _FLAG)


def timestamp(wall: float) -> int:
    """Timestamp of a signature made at `wall` (UTC, s since 1970), in units of TICK since EPOCH."""
    return round(max(wall - EPOCH, 0.0) / TICK)


def read_key(path: Path) -> SigningKey:
    """The key in a file: 32 bytes, 64 hex digits, or a passphrase whose SHA-256 is the key, as in Mission
    Planner, QGroundControl and MAVProxy. UsageError for any other content, which it does not quote."""
    try:
        with path.open("rb") as file:
            content = file.read(_LONGEST + 1)
    except OSError as error:
        raise UsageError(f"the signing key {path} cannot be read: {error.strerror}") from error
    return SigningKey(_secret(content, path), str(path))


def _secret(content: bytes, path: Path) -> bytes:
    try:
        text = content.decode().rstrip("\r\n")
    except UnicodeDecodeError:
        text = ""
    if len(content) == 32 and not (text and text.isprintable()):
        return content
    if not text or not text.isprintable() or len(content) > _LONGEST:
        raise UsageError(
            f"{path} ({len(content)} bytes) holds no signing key; give 32 bytes, 64 hex digits or a line "
            "with a passphrase"
        )
    if len(text) == 64 and all(c in "0123456789abcdefABCDEF" for c in text):
        return bytes.fromhex(text)
    return hashlib.sha256(text.encode()).digest()
