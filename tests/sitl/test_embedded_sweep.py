"""A sweep through the very applet on the embedded rover, its log, and how both get on and off the vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from embedded_client import Client, embedded
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from rover_sweep.logs.readers.dataflash import index
from rover_sweep.manoeuvre.sweep import Sweep

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


def test_the_applets_sweep_is_the_closed_form(log: dict[str, list[Any]]) -> None:
    steered = [m for m in log["SWEP"] if 3 <= m.St <= 8]
    t, wanted = np.array([m.T for m in steered]), np.array([m.Cmd for m in steered])
    assert {m.St for m in steered} == {3, 4, 5, 6, 7, 8}
    assert np.abs(wanted - 1500 - SWEEP.wave(t)).max() < 1.0
    assert np.median(np.diff(t)) == pytest.approx(0.01, abs=0.004)


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


def test_the_log_is_laid_out_as_the_firmwares_and_has_its_rates(
    flight: SimpleNamespace, log: dict[str, list[Any]]
) -> None:
    ours = next((flight.directory / "logs").glob("*.BIN"))
    theirs = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal" / "run4.BIN"
    own, real = (
        {n: (f.format, f.columns, f.length) for n, f in index(np.fromfile(p, np.uint8)).formats.items()}
        for p in (ours, theirs)
    )
    shared = set(own) - {"SWEP"}
    assert len(shared) > 20 and shared <= set(real)
    assert all(own[name] == real[name] for name in shared)
    expected = {"IMU": LOOP_RATE, "XKF1": LOOP_RATE, "RCOU": 10, "RCIN": 10, "GPS": 5, "GYR": 400, "ACC": 400}
    expected |= {"ATT": LOOP_RATE, "STER": 10, "THR": 10, "DSF": 1}
    rates = {name: 1e6 / np.median(np.diff([m.TimeUS for m in log[name]])) for name in expected}
    assert rates == pytest.approx(expected) and all(m.Dp == 0 for m in log["DSF"])
