"""What is received is on disk before it is looked at, whatever it is, and stays readable."""

from __future__ import annotations

import errno
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.errors import UsageError
from rover_sweep.session.folder import Session
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Codec, Framer, make
from rover_sweep.vehicle.link.recorded_transport import TlogWriter


def _heartbeat(codec: Codec) -> bytes:
    return codec.pack(
        make(
            "HEARTBEAT", type=10, autopilot=3, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3
        )
    )


def _read(path: Path) -> list[str]:
    log = mavutil.mavlink_connection(str(path))
    names = []
    while (message := log.recv_msg()) is not None:
        names.append(message.get_type())
    return names


def test_frames_are_found_in_noise_whatever_the_chunks() -> None:
    codec = Codec()
    frames = [_heartbeat(codec) for _ in range(3)]
    stream = b"boot \xfd!" + frames[0] + b"junk" + frames[1] + frames[2]
    for size in (1, 7, len(stream)):
        framer, found, noise = Framer(), [], b""
        for at in range(0, len(stream), size):
            for data, is_frame in framer.feed(stream[at : at + size]):
                found += [data] if is_frame else []
                noise += b"" if is_frame else data
        assert found == frames, f"chunks of {size}"
        assert noise == b"boot \xfd!junk", f"chunks of {size}"


def test_a_damaged_frame_and_an_unknown_message_are_recorded(tmp_path: Path) -> None:
    codec = Codec()
    damaged = bytearray(_heartbeat(codec))
    damaged[12] ^= 0x40
    unknown = bytearray(_heartbeat(codec))
    unknown[7:10] = (0xFFFF10).to_bytes(3, "little")
    stream = bytes(damaged) + bytes(unknown) + _heartbeat(codec)
    writer = TlogWriter(tmp_path / "a.tlog")
    pieces = list(Framer().feed(stream))
    writer.write(pieces)
    writer.close()
    assert [is_frame for _, is_frame in pieces] == [True, True, True]
    assert [codec.decode(data) is None for data, _ in pieces] == [True, True, False]
    raw = (tmp_path / "a.tlog").read_bytes()
    assert raw[8 : 8 + len(damaged)] == bytes(damaged)
    assert len(raw) == len(stream) + 3 * 8
    assert _read(tmp_path / "a.tlog")[-1] == "HEARTBEAT"


def test_stamps_are_microseconds_since_1970_and_never_go_back(tmp_path: Path) -> None:
    writer, codec = TlogWriter(tmp_path / "a.tlog"), Codec()
    for _ in range(50):
        writer.write([(_heartbeat(codec), True)])
    writer.close()
    raw, size = (tmp_path / "a.tlog").read_bytes(), 8 + len(_heartbeat(codec))
    stamps = [struct.unpack(">Q", raw[at : at + 8])[0] for at in range(0, len(raw), size)]
    assert len(stamps) == 50
    assert stamps == sorted(stamps)
    assert abs(stamps[-1] / 1e6 - time.time()) < 5


def test_a_message_is_on_disk_before_anybody_looks_at_it(vehicle: FakeVehicle, tmp_path: Path) -> None:
    path, missing = tmp_path / "a.tlog", []
    with Link.open(vehicle.url, path) as link:

        def look(message: m.MAVLink_message) -> None:
            if bytes(message.get_msgbuf()) not in path.read_bytes():
                missing.append(message)

        with link.listening(look):
            for _ in range(200):
                assert link.receive(1.0) is not None
    assert not missing


def test_noise_goes_beside_the_tlog(tmp_path: Path) -> None:
    with FakeVehicle(prefix=b"ArduPilot boots\r\n") as vehicle:
        Link.open(vehicle.url, tmp_path / "a.tlog").close()
    assert b"ArduPilot boots\r\n" in (tmp_path / "a.tlog.noise").read_bytes()
    assert "HEARTBEAT" in _read(tmp_path / "a.tlog")


def test_kill_9_leaves_a_readable_tlog(vehicle: FakeVehicle, tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    program = (
        "import sys, pathlib; from rover_sweep.vehicle.link.link import Link\n"
        "link = Link.open(sys.argv[1], pathlib.Path(sys.argv[2]))\n"
        "while True: link.receive(1.0)"
    )
    station = subprocess.Popen([sys.executable, "-c", program, vehicle.url, str(path)])
    try:
        end = time.monotonic() + 20
        while (not path.exists() or path.stat().st_size < 20_000) and time.monotonic() < end:
            time.sleep(0.02)
    finally:
        station.send_signal(signal.SIGKILL)
        station.wait()
    names = _read(path)
    assert len(names) > 200
    assert "BAD_DATA" not in names


class _PartFile:
    """A file that takes at most `most` bytes at a time, and `room` in all."""

    def __init__(self, most: int, room: int) -> None:
        self.data, self.most, self.room = b"", most, room

    def write(self, data: bytes) -> int:
        taken = bytes(data[: min(self.most, self.room - len(self.data))])
        if not taken:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.data += taken
        return len(taken)


def test_a_short_write_is_carried_on(tmp_path: Path) -> None:
    writer, frame, file = TlogWriter(tmp_path / "a.tlog"), _heartbeat(Codec()), _PartFile(5, 10**6)
    writer._file = file  # type: ignore[assignment]
    writer.write([(frame, True), (frame, True)])
    assert file.data[8 : -len(frame)].startswith(frame) and file.data.endswith(frame)
    assert len(file.data) == 2 * (8 + len(frame))


def test_a_full_disk_is_told_once(tmp_path: Path) -> None:
    writer, frame, file = TlogWriter(tmp_path / "a.tlog"), _heartbeat(Codec()), _PartFile(1000, 50)
    writer._file = file  # type: ignore[assignment]
    with pytest.raises(
        UsageError, match="a.tlog cannot be written .No space left on device.*free some space"
    ):
        writer.write([(frame, True), (frame, True)])
    writer.write([(frame, True)])
    assert len(file.data) == 50


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    for folder in (tmp_path / "file", tmp_path / "file" / "below", Path("/proc/none")):
        with pytest.raises(UsageError, match="cannot be written"):
            Session.open(folder)
    with pytest.raises(UsageError, match="file/a.tlog cannot be written"):
        TlogWriter(tmp_path / "file" / "a.tlog")
    session = Session.open(tmp_path / "s")
    (tmp_path / "s" / "session.json").unlink()
    (tmp_path / "s" / "session.json").mkdir()
    with pytest.raises(UsageError, match="session.json cannot be written"):
        session.plan(())
