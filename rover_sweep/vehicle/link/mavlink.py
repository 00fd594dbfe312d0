"""The only module of `rover_sweep.vehicle` that imports pymavlink: packing, framing, decoding, FTP.

All other modules handle opaque messages (`kind(message)`, attributes by MAVLink field name) made by
`make(name, **fields)`.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as dialect

from rover_sweep.errors import UsageError
from rover_sweep.files.documents import printable

# MAVLink signing: reading a key from a file, and checking a frame's signature.
#
# https://mavlink.io/en/guide/message_signing.html: a signed frame has the incompatibility flag 0x01 and ends
# with link id (1 byte), timestamp (6) and signature (6), the start of the SHA-256 of the key and all before.
# Packing and checking on a link are pymavlink's (`mavlink.Codec`). The key is never shown or written.


EPOCH = 1_420_070_400  # s since 1970: 2015-01-01, from which timestamps count
TICK = 1e-5  # s, the unit of a timestamp
V1, V2 = 0xFE, 0xFD
_SIGNED, _SIGNATURE, _SIGNATURE_FIELD = 0x01, 13, 6  # flag; bytes after a signed frame; of these the hash
_LONGEST = 4096  # bytes of a key file


@dataclass(frozen=True)
class SigningKey:
    """secret: 32 bytes, hidden in repr; source: the file it comes from."""

    secret: bytes = field(repr=False)
    source: str = ""

    def signed(self, frame: bytes) -> bool:
        """Whether a whole frame carries a signature of this key, with any time stamp."""
        digest = hashlib.sha256(self.secret + frame[:-_SIGNATURE_FIELD]).digest()
        return signs(frame) and hmac.compare_digest(digest[:_SIGNATURE_FIELD], frame[-_SIGNATURE_FIELD:])


def signs(frame: bytes) -> bool:
    """Whether a whole frame carries a signature, right or wrong."""
    return frame[0] == V2 and bool(frame[2] & _SIGNED)


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


Message = Any  # a pymavlink message: attributes are the MAVLink fields

GCS_SYSTEM = 255  # SYSID_MYGCS: overrides from any other system are ignored (AP: handle_rc_channels_override)
GCS_COMPONENT = 190  # MAV_COMP_ID_MISSIONPLANNER, the usual id of a ground station
SAFETY_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED of a heartbeat's base_mode
_LINK_ID = 0  # of our signatures: one link at a time
_FTP_IDLE = 3.0  # s in which we send nothing that end a download; 29 kB come in 2 s in one burst (4.6.3 SITL)
_NAMES = {  # the fields that hold a name: of a parameter, of a value
    dialect.MAVLINK_MSG_ID_PARAM_VALUE: "param_id",
    dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: "name",
    dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT: "name",
}
_VALUES = {
    dialect.MAVLINK_MSG_ID_PARAM_VALUE: "param_value",
    dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: "value",
}
_CRC_EXTRA = {number: cls.crc_extra for number, cls in dialect.mavlink_map.items()}


def constant(name: str) -> int:
    """A MAVLink constant by name, e.g. MAV_CMD_DO_AUX_FUNCTION."""
    return int(getattr(dialect, name))


def result_name(result: int) -> str:
    """MAV_RESULT as a word, e.g. 'denied'."""
    entry = dialect.enums["MAV_RESULT"].get(result)
    return entry.name.removeprefix("MAV_RESULT_").lower().replace("_", " ") if entry else f"result {result}"


def vehicle_type_name(number: int) -> str:
    """MAV_TYPE as words, e.g. 'surface boat'."""
    entry = dialect.enums["MAV_TYPE"].get(number)
    return entry.name.removeprefix("MAV_TYPE_").lower().replace("_", " ") if entry else f"type {number}"


def message_id(name: str) -> int:
    """Number of a MAVLink message by its name."""
    return int(getattr(dialect, f"MAVLINK_MSG_ID_{name}"))


def make(name: str, **fields: Any) -> Message:
    """A message to send, e.g. make("HEARTBEAT", type=6, ...)."""
    return getattr(dialect, f"MAVLink_{name.lower()}_message")(**fields)


def kind(message: Message) -> str:
    """The message's name, e.g. 'ATTITUDE'."""
    return str(message.msgname)


def sender(message: Message) -> tuple[int, int]:
    """(system, component) the message came from."""
    return message.get_srcSystem(), message.get_srcComponent()


def is_autopilot(message: Message) -> bool:
    """Whether it is a heartbeat of an autopilot, not of a ground station, gimbal or companion computer."""
    if kind(message) != "HEARTBEAT" or message.get_srcComponent() != dialect.MAV_COMP_ID_AUTOPILOT1:
        return False
    others = dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID
    return bool(message.type != others[0] and message.autopilot != others[1])


def frame_number(frame: bytes) -> int:
    """Sequence number of a frame, damaged or not."""
    return frame[4] if frame[0] == V2 else frame[2]


def frame_source(frame: bytes) -> tuple[int, int]:
    """(system, component) of a frame, damaged or not."""
    return (frame[5], frame[6]) if frame[0] == V2 else (frame[3], frame[4])


def is_known(frame: bytes) -> bool:
    """Whether its message is in the dialect; an unknown message looks like a damaged one."""
    number = int.from_bytes(frame[7:10], "little") if frame[0] == V2 else frame[5]
    return number in _CRC_EXTRA


class Codec:
    """Packs and decodes MAVLink 2 for one sender; keeps its sequence number.

    key: signs all packed messages; only messages signed with it are decoded, except a radio's own status.
    wall: UTC [s since 1970] at which the signatures' timestamps begin.
    """

    def __init__(
        self,
        system: int = GCS_SYSTEM,
        component: int = GCS_COMPONENT,
        key: SigningKey | None = None,
        wall: float = 0.0,
    ) -> None:
        self._mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        if key is not None:
            signing = self._mav.signing
            signing.secret_key, signing.sign_outgoing, signing.link_id = key.secret, True, _LINK_ID
            signing.timestamp, signing.allow_unsigned_callback = timestamp(wall), _may_be_unsigned

    def pack(self, message: Message) -> bytes:
        """Bytes of the message with the next sequence number."""
        data = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return data

    def decode(self, frame: bytes) -> Message | None:
        """The message in a frame; None if it is unknown, damaged, or a value of NaN or infinity."""
        heard = dict(self._mav.signing.stream_timestamps) if self._mav.signing.secret_key else None
        try:
            message = self._mav.decode(bytearray(frame))
        except (dialect.MAVError, UnicodeDecodeError, ValueError):
            if heard is not None:  # pymavlink keeps a forged timestamp, and refuses all older ones
                self._mav.signing.stream_timestamps = heard
            return None
        if message.get_type().startswith("UNKNOWN") or not _has_finite_value(message):
            return None
        return _with_printable_name(message)


def _has_finite_value(message: Message) -> bool:
    """False for a parameter or a named value of NaN or infinity."""
    field = _VALUES.get(message.get_msgId())
    return field is None or math.isfinite(getattr(message, field))


def _with_printable_name(message: Message) -> Message:
    """Replace control characters in the name field (16 or 10 arbitrary bytes)."""
    field = _NAMES.get(message.get_msgId())
    if field and not (name := getattr(message, field)).isprintable():
        setattr(message, field, printable(name))
    return message


def _may_be_unsigned(_: Any, number: int) -> bool:
    """A telemetry radio reports its own state unsigned; ArduPilot accepts it too."""
    return number in (dialect.MAVLINK_MSG_ID_RADIO_STATUS, dialect.MAVLINK_MSG_ID_RADIO)


class Framer:
    """Cuts a stream of bytes into MAVLink frames and noise, without reading their content.

    A frame with a wrong or unknown checksum still counts as a frame if another one starts right after it (it
    was damaged, or its message is unknown). Otherwise its first byte is noise and the search continues one
    byte later, so that a false start loses no frame.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[bytes, bool]]:
        """(bytes, is_frame) of all complete pieces."""
        buffer = self._buffer
        buffer += data
        at = 0
        while at < len(buffer):
            length = _noise(buffer, at)
            is_frame = length == 0
            if is_frame:
                length = _length(buffer, at)
                end = at + length
                if length == 0 or end > len(buffer):
                    break
                if not _checksum_right(buffer, at, end):
                    if end == len(buffer):
                        break
                    if buffer[end] not in (V1, V2):
                        length, is_frame = 1, False
            yield bytes(buffer[at : at + length]), is_frame
            at += length
        del buffer[:at]


def _noise(buffer: bytearray, at: int) -> int:
    """How many bytes from `at` on cannot start a frame."""
    end = at
    while end < len(buffer) and buffer[end] not in (V1, V2):
        end += 1
    return end - at


def _length(buffer: bytearray, at: int) -> int:
    """Length of the frame that starts at `at`; 0 while its header is incomplete."""
    have = len(buffer) - at
    if buffer[at] == V1:
        return buffer[at + 1] + 8 if have >= 2 else 0
    if have < 3:
        return 0
    return buffer[at + 1] + 12 + (_SIGNATURE if buffer[at + 2] & _SIGNED else 0)


def _checksum_right(buffer: bytearray, at: int, end: int) -> bool:
    """Whether the checksum of the frame [at, end) is right; False for unknown messages."""
    v2 = buffer[at] == V2
    number = int.from_bytes(buffer[at + 7 : at + 10], "little") if v2 else buffer[at + 5]
    crc_at = end - 2 - (_SIGNATURE if v2 and buffer[at + 2] & _SIGNED else 0)
    extra = _CRC_EXTRA.get(number)
    if extra is None:
        return False
    right = crc16.mcrf4xx(bytes(buffer[at + 1 : crc_at]) + bytes([extra]))
    return bool(right == int.from_bytes(buffer[crc_at : crc_at + 2], "little"))


class Clock(Protocol):
    """The clock for waits [s]."""

    def monotonic(self) -> float: ...
    def sleep(self, seconds: float) -> None: ...


class FtpLink(Protocol):
    """The part of a link that an FTP transfer needs."""

    @property
    def target(self) -> tuple[int, int]: ...
    @property
    def line(self) -> Clock: ...
    def send(self, message: Message) -> None: ...
    def wait_for(self, kinds: str | tuple[str, ...], timeout: float) -> Message | None: ...


class _FtpMaster:
    """Looks to pymavlink.mavftp like a mavutil connection; sends and receives through our link."""

    source_system, source_component = GCS_SYSTEM, GCS_COMPONENT

    def __init__(self, link: FtpLink) -> None:
        self._link = link
        self.mav = self

    def file_transfer_protocol_send(self, network: int, system: int, component: int, payload: Any) -> None:
        self._link.send(
            make(
                "FILE_TRANSFER_PROTOCOL",
                target_network=network,
                target_system=system,
                target_component=component,
                payload=payload,
            )
        )

    def recv_match(self, type: list[str], timeout: float = 0.1, **_: Any) -> Message | None:
        return self._link.wait_for(tuple(type), timeout)


def ftp_put(link: FtpLink, local: str, remote: str, progress: Callable[[float], None] | None = None) -> str:
    """Upload a file by MAVLink FTP (pymavlink.mavftp). Returns '' or an error as a phrase."""
    with _ftp(link) as ftp:
        ftp.cmd_put([local, remote], progress_callback=progress)
        result = ftp.process_ftp_reply("put", timeout=60)
    return "" if result.return_code == 0 else f"MAVLink FTP error {result.error_code}"


def ftp_get(link: FtpLink, remote: str, local: str) -> str:
    """Download a file by MAVLink FTP. Returns '' or an error as a phrase."""
    with _ftp(link) as ftp:
        ftp.ftp_settings.idle_detection_time = _FTP_IDLE
        ftp.cmd_get([remote, local])
        result = ftp.process_ftp_reply("get", timeout=60)
    return "" if result.return_code == 0 else f"MAVLink FTP error {result.error_code}"


@contextmanager
def _ftp(link: FtpLink) -> Iterator[Any]:
    """mavftp on our link. Its log output is off, because our caller reports the result, and it uses the
    link's clock instead of its module's `time`."""
    from pymavlink import mavftp

    logging.disable(logging.ERROR)  # it reports through the root logger
    real, mavftp.time = mavftp.time, _FtpTime(link.line)
    try:
        yield mavftp.MAVFTP(_FtpMaster(link), *link.target)
    finally:
        mavftp.time = real
        logging.disable(logging.NOTSET)


class _FtpTime:
    """The two functions of `time` that mavftp calls."""

    def __init__(self, clock: Clock) -> None:
        self.time, self.sleep = clock.monotonic, clock.sleep
