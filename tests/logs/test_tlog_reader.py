"""The reader of telemetry logs, against pymavlink, restarts, wrapped clocks and damage."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recordings import DEFAULTS, foreign

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
        for t in np.arange(start, start + seconds, step):
            us, ms, wave = round(t * 1e6), round(t * 1e3), float(np.sin(2.0 * (t - start)))
            steer = 1500 + round(100 * wave)
            self.add(
                mavlink.MAVLink_raw_imu_message(
                    us, 0, round(50 * wave), -1000, 20, 0, round(300 * wave), 0, 0, 0
                )
            )
            self.add(mavlink.MAVLink_attitude_message(ms, 0.1, 0.0, 0.5, 0.0, 0.0, 0.0))
            self.add(
                mavlink.MAVLink_local_position_ned_message(ms, 0, 0, 0, 2 * np.cos(0.5), 2 * np.sin(0.5), 0)
            )
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
    np.testing.assert_allclose(log.signals["vy"].x, 0.0, atol=1e-5)
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


def test_the_servo_clock_may_wrap_after_71_minutes(tmp_path: Path) -> None:
    telemetry = Telemetry()
    telemetry.drive(2**32 * 1e-6 - 5.0, 10.0)
    (log,) = read_telemetry(saved(tmp_path, telemetry.data))
    np.testing.assert_allclose(log.steering[0].t, log.signals["r"].t, atol=1e-6)
    assert log.steering[0].t.size == 200


def test_a_restart_splits_the_log(tmp_path: Path) -> None:
    telemetry = Telemetry()
    telemetry.drive(100.0, 20.0)
    telemetry.drive(3.0, 10.0)
    first, second = read_telemetry(saved(tmp_path, telemetry.data))
    assert first.signals["r"].t[[0, -1]] == pytest.approx([100.0, 119.95])
    assert second.signals["r"].t[[0, -1]] == pytest.approx([3.0, 12.95])
    assert any("restarted" in n.text for n in first.notes)


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


def test_a_flipped_bit_is_found_by_the_checksum() -> None:
    telemetry = Telemetry()
    telemetry.drive(100.0, 1.0)
    data = bytearray(telemetry.data)
    position = data.index(struct.pack("<Q", 100_500_000)) + 12
    data[position] ^= 0x10
    tlog = parse_tlog(bytes(data), frozenset(["RAW_IMU"]))
    assert tlog.damaged == 1
    assert len(tlog.messages["RAW_IMU"]) == 19


def test_slow_streams_are_asked_for_faster(tmp_path: Path) -> None:
    """A ground station's usual streams; their unit of time is right."""
    telemetry = Telemetry()
    telemetry.drive(100.0, 60.0, step=1.0)
    with pytest.raises(DataRefused, match=r"received only every 1 s; request the streams .* at 20 Hz"):
        read_runs(str(saved(tmp_path, telemetry.data)))
