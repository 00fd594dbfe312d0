"""A sweep through the very applet on the embedded rover, its log, and how both get on and off the vehicle."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from embedded_client import Client, embedded
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from rover_sweep.manoeuvre.sweep import Sweep
from sitl.embedded import APPLET

SWEEP = Sweep(amplitude=120, w_min=1.0, w_max=12.0, t_rec=12.0, fade=1.0, dwell=1.0, straight=2.0)
SETTINGS = {
    "SWP_AMP": SWEEP.amplitude,
    "SWP_WMIN": SWEEP.w_min,
    "SWP_WMAX": SWEEP.w_max,
    "SWP_TREC": SWEEP.t_rec,
    "SWP_FADE": SWEEP.fade,
    "SWP_DWELL": SWEEP.dwell,
    "SWP_STRAIGHT": SWEEP.straight,
    "SWP_STILL": 2.0,
}
LOOP_RATE = 200


def drive(client: Client) -> None:
    """Arms, throws switch 6 at standstill, gives throttle when the applet asks, ends when it is done."""
    next_ms, throttle = 0, 1500
    for message in client.messages(20.0):
        if message.get_type() == "STATUSTEXT" and "drive at" in message.text:
            throttle = 1710
        if message.get_type() == "STATUSTEXT" and ("done" in message.text or "stopped" in message.text):
            return
        if message.get_type() == "NAMED_VALUE_FLOAT" and message.name == "SWP_ST" and message.value == 9:
            throttle = 1500
        if client.vehicle_ms >= next_ms:
            next_ms = client.vehicle_ms + 200
            client.override(c1=1500, c3=throttle, c6=1900)
    raise AssertionError(f"the run did not end: {client.texts}")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    directory = tmp_path_factory.mktemp("sweep")
    settings = {
        "SCR_ENABLE": 1,
        "RC6_OPTION": 300,
        "SCHED_LOOP_RATE": LOOP_RATE,
        "LOG_BITMASK": 65535 + (1 << 19),
    }
    options = [word for name, value in settings.items() for word in ("--parameter", f"{name}={value}")]
    with embedded(directory, "--applet", *options) as port:
        client = Client(port)
        client.wait_text("SWP: applet")
        client.wait("LOCAL_POSITION_NED")
        for name, value in SETTINGS.items():
            assert client.set_parameter(name, value) == pytest.approx(value)
        client.interval(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 50_000)
        client.override(c1=1500, c3=1500, c6=1000)
        client.wait("RC_CHANNELS", lambda m: m.chan6_raw == 1000)
        assert client.arm() == 0
        drive(client)
        client.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
        client.wait_text("Disarm for log download")
        assert client.arm(False) == 0
        disarmed_ms = client.wait("SYSTEM_TIME").time_boot_ms
        client.wait("SYSTEM_TIME", lambda m: m.time_boot_ms > disarmed_ms + 17_000, timeout=10.0)
        yield SimpleNamespace(client=client, directory=directory, disarmed_us=disarmed_ms * 1000)
        client.close()


@pytest.fixture(scope="module")
def log(flight: SimpleNamespace) -> dict[str, list[Any]]:
    path = next((flight.directory / "logs").glob("*.BIN"))
    reader = DFReader.DFReader_binary(str(path))
    records: dict[str, list[Any]] = {}
    while (message := reader.recv_msg()) is not None:
        records.setdefault(message.get_type(), []).append(message)
    return records


def test_the_run_was_done(flight: SimpleNamespace) -> None:
    assert flight.client.wait_text("SWP: run 1 done")
    assert flight.client.read_parameter("SWP_RUN").param_value == 1


def test_the_applets_sweep_is_the_closed_form(log: dict[str, list[Any]]) -> None:
    steered = [m for m in log["SWEP"] if 3 <= m.St <= 8]
    t, wanted = np.array([m.T for m in steered]), np.array([m.Cmd for m in steered])
    assert {m.St for m in steered} == {3, 4, 5, 6, 7, 8}
    assert np.abs(wanted - 1500 - SWEEP.wave(t)).max() < 1.0
    assert np.median(np.diff(t)) == pytest.approx(0.01, abs=0.004)


def test_the_servo_follows_the_applet(log: dict[str, list[Any]]) -> None:
    """RCOU at 10 Hz is the staircase of SWEP.Out, at most one main loop late."""
    t = np.array([m.TimeUS for m in log["SWEP"]])
    out = np.array([m.Cmd for m in log["SWEP"]])
    late = 0
    for m in log["RCOU"]:
        k = np.searchsorted(t, m.TimeUS, "right") - 1
        if 0 < k < len(t) - 1 and 3 <= log["SWEP"][k].St <= 8:
            late = max(late, min(abs(m.C1 - out[k]), abs(m.C1 - out[k - 1])))
    assert 0 < late <= 1.0


def test_rates_in_the_log(log: dict[str, list[Any]]) -> None:
    def rate(name: str) -> float:
        t = np.array([m.TimeUS for m in log[name]]) * 1e-6
        return float(1.0 / np.median(np.diff(t)))

    for name in ("IMU", "ATT", "XKF1"):
        assert rate(name) == pytest.approx(LOOP_RATE)
    for name in ("RCOU", "RCIN", "STER", "THR"):
        assert rate(name) == pytest.approx(10)
    assert rate("GPS") == pytest.approx(5)
    assert rate("GYR") == rate("ACC") == pytest.approx(400)
    assert rate("DSF") == pytest.approx(1) and all(m.Dp == 0 for m in log["DSF"])


def test_the_log_begins_with_arming_and_ends_15_s_after_disarming(
    log: dict[str, list[Any]], flight: SimpleNamespace
) -> None:
    assert [m.ArmState for m in log["ARM"]] == [1, 0]
    assert [m.Id for m in log["EV"]] == [10, 11]
    assert log["IMU"][0].TimeUS - log["ARM"][0].TimeUS < 10_000
    assert log["IMU"][-1].TimeUS - log["ARM"][1].TimeUS == pytest.approx(15e6, abs=0.2e6)
    parameters = {m.Name: m.Value for m in log["PARM"]}
    assert parameters["INS_GYRO_FILTER"] == 4 and parameters["SWP_AMP"] == SWEEP.amplitude
    assert log["VER"][0].FWS.startswith("ArduRover") and log["VER"][0].Maj == 4


def test_the_log_is_laid_out_as_the_firmwares(flight: SimpleNamespace) -> None:
    ours = next((flight.directory / "logs").glob("*.BIN"))
    theirs = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal" / "run4.BIN"
    layouts = []
    for path in (ours, theirs):
        reader = DFReader.DFReader_binary(str(path))
        while reader.recv_msg() is not None:
            pass
        layouts.append({f.name: (f.type, f.format, tuple(f.columns)) for f in reader.formats.values()})
    shared = set(layouts[0]) - {"SWEP"}
    assert len(shared) > 20 and shared <= set(layouts[1])
    assert all(layouts[0][name] == layouts[1][name] for name in shared)


def test_the_rover_drove_and_turned(log: dict[str, list[Any]]) -> None:
    start, end = (next(m.TimeUS for m in log["SWEP"] if m.St == s) for s in (6, 7))
    speed = [np.hypot(m.VN, m.VE) for m in log["XKF1"] if start < m.TimeUS < end]
    turn = [m.GyrZ for m in log["IMU"] if start < m.TimeUS < end]
    assert 1.5 < np.mean(speed) < 3.0
    assert 0.2 < np.std(turn) < 2.0
    still = [m.GyrX for m in log["IMU"] if m.TimeUS < log["ARM"][0].TimeUS + 1_000_000]
    assert np.std(still) < 0.01
    raw = [m.GyrX for m in log["GYR"] if m.TimeUS < log["ARM"][0].TimeUS + 1_000_000]
    assert np.std(raw) > 2 * np.std(still)  # GYR is unfiltered


def test_log_download_is_byte_identical(flight: SimpleNamespace) -> None:
    client, path = flight.client, next((flight.directory / "logs").glob("*.BIN"))
    client.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    entry = client.wait("LOG_ENTRY")
    assert (entry.id, entry.num_logs, entry.size) == (1, 1, path.stat().st_size)
    client.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 0xFFFFFFFF))
    received = bytearray(entry.size)
    left = entry.size
    for message in client.messages(10.0):
        if message.get_type() == "LOG_DATA":
            received[message.ofs : message.ofs + message.count] = bytes(message.data[: message.count])
            left -= message.count
            if left == 0:
                break
    client.send(mavlink.MAVLink_log_request_end_message(1, 1))
    assert bytes(received) == path.read_bytes()


class FtpConnection(SimpleNamespace):
    """As much of mavutil's connection as mavftp asks for."""

    def __init__(self, client: Client) -> None:
        super().__init__(client=client, mav=client.mav, target_system=1, target_component=1)
        self.source_system, self.source_component = client.mav.srcSystem, client.mav.srcComponent
        client.mav.file = SimpleNamespace(write=client.socket.sendall)

    def recv_match(self, blocking: bool = False, timeout: float | None = None, **_: Any) -> Any:
        return next(
            (m for m in self.client.messages(timeout or 0.02) if m.get_type() == "FILE_TRANSFER_PROTOCOL"),
            None,
        )


def test_script_upload_by_mavlink_ftp(flight: SimpleNamespace, tmp_path: Path) -> None:
    """put, list, get with pymavlink's own mavftp, then a restart of the scripts."""
    os.environ["MAVLINK20"] = "1"
    from pymavlink import mavftp

    ftp = mavftp.MAVFTP(FtpConnection(flight.client), 1, 1)
    source, back = tmp_path / "hello.lua", tmp_path / "back.lua"
    source.write_text("gcs:send_text(6, 'hello from a script')\n" + "-- filler\n" * 300)
    ftp.cmd_put([str(source), "/scripts/hello.lua"])
    assert ftp.process_ftp_reply("CreateFile", timeout=10).error_code == 0
    uploaded = flight.directory / "scripts" / "hello.lua"
    assert uploaded.read_bytes() == source.read_bytes()
    ftp.cmd_get(["/scripts/hello.lua", str(back)])
    assert ftp.process_ftp_reply("OpenFileRO", timeout=10).error_code == 0
    assert zlib.crc32(back.read_bytes()) == zlib.crc32(source.read_bytes())
    assert ftp.cmd_list(["/scripts"]).error_code == 0
    assert {(e.name, e.is_dir) for e in ftp.list_result} == {("hello.lua", False), (APPLET.name, False)}
    assert flight.client.command(mavlink.MAV_CMD_SCRIPTING, 3) == 0
    flight.client.wait_text("hello from a script")
