"""The reader of telemetry logs, against pymavlink, restarts, wrapped clocks and damage."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from link_faults import records
from pymavlink.dialects.v20 import ardupilotmega as m
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recordings import APPLET, DEFAULTS, foreign

from rover_sweep.data.recording import Recording
from rover_sweep.errors import DataRefused
from rover_sweep.logs.read import read_runs
from rover_sweep.logs.readers.tlog import open_tlog, parse_tlog
from rover_sweep.logs.readers.tlog_channels import read_telemetry

RUN = DEFAULTS / "run2.tlog"


def test_every_value_is_the_one_that_pymavlink_reads() -> None:
    from pymavlink import mavutil

    names = ["ATTITUDE", "RAW_IMU", "SERVO_OUTPUT_RAW", "LOCAL_POSITION_NED", "HEARTBEAT"]
    ours = open_tlog(RUN, frozenset([*names, "STATUSTEXT"]))
    log = mavutil.mavlink_connection(str(RUN))
    theirs: dict[str, list[dict[str, float]]] = {}
    while (message := log.recv_match(type=names)) is not None:
        theirs.setdefault(message.get_type(), []).append(message.to_dict())
    for name in names:
        rows = ours.messages[name].rows
        assert len(rows) == len(theirs[name]) > 30
        for field in rows.dtype.names or ():
            np.testing.assert_array_equal(
                rows[field],
                [np.float32(m[field]) if rows[field].dtype == np.float32 else m[field] for m in theirs[name]],
            )
    assert ours.bad_bytes == ours.damaged == 0


class Telemetry:
    """Writes a telemetry log of a rover that drives a slow sine."""

    def __init__(self, version: int = 2) -> None:
        self.data = b""
        self._pack = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._version = version
        self._arrival = 1_700_000_000_000_000

    def add(self, message: mavlink.MAVLink_message) -> None:
        self._arrival += 700  # arrives in bursts, whatever the vehicle's clock says
        frame = message.pack(self._pack, force_mavlink1=self._version == 1)
        self.data += struct.pack(">Q", self._arrival) + frame

    def drive(self, start: float, seconds: float, kind: int = 10, step: float = 0.05) -> None:
        self.add(mavlink.MAVLink_heartbeat_message(kind, 3, 193, 0, 4, 3))
        ahead, left, heading = 2.0, 0.3, 0.5
        north = ahead * np.cos(heading) + left * np.sin(heading)
        east = ahead * np.sin(heading) - left * np.cos(heading)
        for t in np.arange(start, start + seconds, step):
            us, ms, wave = round(t * 1e6), round(t * 1e3), float(np.sin(2.0 * (t - start)))
            steer = 1500 + round(100 * wave)
            self.add(
                mavlink.MAVLink_raw_imu_message(
                    us, 0, round(50 * wave), -1000, 20, 0, round(300 * wave), 0, 0, 0
                )
            )
            self.add(mavlink.MAVLink_attitude_message(ms, 0.1, 0.0, 0.5, 0.0, 0.0, 0.0))
            self.add(mavlink.MAVLink_local_position_ned_message(ms, 0, 0, 0, north, east, 0))
            self.add(mavlink.MAVLink_servo_output_raw_message(us % 2**32, 0, steer, 0, 1700, 0, 0, 0, 0, 0))


def saved(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "drive.tlog"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("version", [1, 2])
def test_channels_are_iso_si_and_on_the_vehicle_clock(tmp_path: Path, version: int) -> None:
    telemetry = Telemetry(version)
    telemetry.drive(100.0, 20.0)
    (log,) = read_telemetry(saved(tmp_path, telemetry.data))
    wave = np.sin(2.0 * (log.signals["r"].t - 100.0))
    assert log.signals["r"].t[[0, -1]] == pytest.approx([100.0, 119.95])
    np.testing.assert_allclose(log.signals["r"].x, -0.3 * wave, atol=6e-4)
    np.testing.assert_allclose(log.signals["ay"].x, -0.05 * 9.80665 * wave, atol=6e-3)
    assert log.signals["p"].x[0] == pytest.approx(0.02)
    assert log.signals["phi"].x[0] == pytest.approx(0.1)
    assert log.signals["psi"].x[0] == pytest.approx(-0.5)
    np.testing.assert_allclose(log.signals["speed"].x, 2.0, atol=1e-5)
    np.testing.assert_allclose(log.signals["vy"].x, 0.3, atol=1e-5)  # left motion is positive
    np.testing.assert_allclose(log.steering[0].x, 1500 + np.round(100 * wave))
    assert log.signals["throttle"].x[0] == 1700


def test_left_motion_is_positive(tmp_path: Path) -> None:
    telemetry = Telemetry()
    telemetry.add(mavlink.MAVLink_heartbeat_message(10, 3, 193, 0, 4, 3))
    for ms in (1000, 1050, 1100):  # heading north, moving north and west
        telemetry.add(mavlink.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0))
        telemetry.add(mavlink.MAVLink_local_position_ned_message(ms, 0, 0, 0, 2.0, -0.3, 0))
    (log,) = read_telemetry(saved(tmp_path, telemetry.data))
    np.testing.assert_allclose(log.signals["speed"].x, 2.0, rtol=1e-6)
    np.testing.assert_allclose(log.signals["vy"].x, 0.3, rtol=1e-6)


def test_ground_station_and_companion_do_not_mix_in() -> None:
    path = Path(foreign("rover_logs/still_v4.5.5.tlog"))
    (log,) = read_telemetry(path)
    assert log.vehicle == "rover"
    assert log.firmware.startswith("ArduRover V4.5.5")


def test_damage_is_skipped_or_refused(tmp_path: Path) -> None:
    telemetry = Telemetry()
    telemetry.drive(100.0, 60.0)
    data = bytearray(telemetry.data)
    middle = len(data) // 2
    data[middle : middle + 40] = bytes(40)
    (log,) = read_telemetry(saved(tmp_path, bytes(data)))
    assert log.signals["r"].t.size >= 1196
    assert any("skipped" in n.text or "checksum" in n.text for n in log.notes)
    for k in range(400, len(data) - 50, 400):
        data[k : k + 9] = bytes(9)
    (log,) = read_telemetry(saved(tmp_path, bytes(data)))  # as if the link had lost an eighth
    assert log.signals["r"].t.size > 0.8 * 1200
    for k in range(400, len(data) - 50, 40):
        data[k : k + 9] = bytes(9)
    with pytest.raises(DataRefused, match="damaged"):
        read_telemetry(saved(tmp_path, bytes(data)))


def test_a_log_that_ends_anywhere_is_read_up_to_there() -> None:
    """As a kill or a full disk leaves it."""
    data = (DEFAULTS / "run1.tlog").read_bytes()[:20_000]
    for end in range(19_900, 20_000):
        assert parse_tlog(data[:end], ("ATTITUDE",)).messages


def test_slow_streams_are_asked_for_faster(tmp_path: Path) -> None:
    """A ground station's usual streams; their unit of time is right."""
    telemetry = Telemetry()
    telemetry.drive(100.0, 60.0, step=1.0)
    with pytest.raises(DataRefused, match=r"received only every 1 s; request the streams .* at 20 Hz"):
        read_runs(str(saved(tmp_path, telemetry.data)))


# ---- A telemetry log in which two vehicles were recorded: one is read, and that is said.

OTHER = 7


def as_system(record: bytes, mav: m.MAVLink) -> bytes:
    """The record with its frame sent by the system of `mav`; b'' for a message that is not known."""
    message = m.MAVLink(None).decode(bytearray(record[8:]))
    if message.get_type().startswith("UNKNOWN"):
        return b""
    mav.seq = message.get_seq()
    return record[:8] + bytes(message.pack(mav))


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive of system 1, and before it that of another rover, as system 7."""
    mav = m.MAVLink(None, srcSystem=OTHER, srcComponent=1)
    other = b"".join(as_system(r, mav) for r in records((APPLET / "run1.tlog").read_bytes()))
    path = tmp_path_factory.mktemp("both") / "both.tlog"
    path.write_bytes(other + (DEFAULTS / "run1.tlog").read_bytes())
    return path


def same(run: Recording, source: Path) -> bool:
    (alone,) = read_runs(str(source))
    return run.channels.keys() == alone.channels.keys() and all(
        np.array_equal(signal.x, alone.channels[name].x) for name, signal in run.channels.items()
    )


def told(run: Recording) -> list[str]:
    return [note.text for note in run.notes if "several vehicles" in note.text]


def test_each_is_read_by_its_id(both: Path) -> None:
    (mine,) = read_runs(str(both), system=1)
    (other,) = read_runs(str(both), system=OTHER)
    assert same(mine, DEFAULTS / "run1.tlog") and same(other, APPLET / "run1.tlog")
    assert told(mine) == [] and told(other) == []


def test_without_a_word_the_other_is_named(both: Path) -> None:
    (run,) = read_runs(str(both))
    (words,) = told(run)
    assert "system 1" in words and "system 7" in words and "--system N" in words
    (alone,) = read_runs(str(DEFAULTS / "run1.tlog"))
    assert told(alone) == []


def test_one_that_is_not_in_it_is_refused_with_those_that_are(both: Path) -> None:
    with pytest.raises(DataRefused, match="no heartbeat of system 9, only of system 1, system 7; give"):
        read_runs(str(both), system=9)
