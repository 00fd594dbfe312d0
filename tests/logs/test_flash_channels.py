"""Which messages of a DataFlash log the channels come from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flash_writer import FlashWriter

from rover_sweep.logs.log import Log, increasing, sensor_filters
from rover_sweep.logs.readers.dataflash_channels import read_dataflash

RAW = 0.2  # rad/s in the made GYR, 0.1 in IMU


def made(tmp_path: Path, options: float = 0.0, core: int = 0) -> Log:
    """A log with filtered and raw IMU, two estimator cores, and dropped messages."""
    writer = FlashWriter()
    writer.parameters(
        {"INS_GYRO_FILTER": 4, "INS_ACCEL_FILTER": 0, "INS_RAW_LOG_OPT": options, "SERVO4_FUNCTION": 26}
    )
    writer.define("IMU", "QBfff", "TimeUS,I,GyrX,GyrZ,AccY")
    writer.define("GYR", "QBQff", "TimeUS,I,SampleUS,GyrX,GyrZ")
    writer.define("XKF1", "QBcff", "TimeUS,C,Yaw,VN,VE")
    writer.define("XKF4", "QBB", "TimeUS,C,PI")
    writer.define("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    writer.define("DSF", "QI", "TimeUS,Dp")
    for k in range(100):
        us = 10_000 * k
        writer.write("IMU", us, 0, 0.0, 0.1, 0.5)
        writer.write("IMU", us, 1, 0.0, 9.0, 9.0)
        writer.write("GYR", us + 700, 0, us, 0.0, RAW)
        writer.write("XKF1", us, 0, 0.0, 3.0, 0.0)
        writer.write("XKF1", us, 1, 90.0, 0.3, 2.0)
        writer.write("XKF4", us, 0, core)
        writer.write("RCOU", us, 1111, 1222, 1333, 1444)
        writer.write("DSF", us, 5 + k // 10)
    path = tmp_path / "made.BIN"
    path.write_bytes(writer.data)
    (log,) = read_dataflash(path)
    return log


def test_raw_samples_are_used_without_a_filter(tmp_path: Path) -> None:
    log = made(tmp_path)
    assert log.signals["r"].source == "GYR.GyrZ"
    assert log.signals["r"].x == pytest.approx(np.full(100, -RAW))
    assert log.signals["r"].t == pytest.approx(np.arange(100) * 0.01)  # of the sample, not of the writing
    assert log.filters == {}  # the accelerometer's is off
    assert log.signals["ay"].x == pytest.approx(np.full(100, -0.5))


@pytest.mark.parametrize(
    ("options", "source"), [(4, "IMU.GyrZ"), (8, "GYR.GyrZ"), (12, "GYR.GyrZ"), (1, "GYR.GyrZ")]
)
def test_raw_samples_that_were_logged_filtered_are_not_used(
    tmp_path: Path, options: int, source: str
) -> None:
    log = made(tmp_path, options)
    assert log.signals["r"].source == source
    assert ("r" in log.filters) == source.startswith("IMU")


@pytest.mark.parametrize(("core", "speed", "vy"), [(0, 3.0, 0.0), (1, 2.0, 0.3)])
def test_velocity_is_that_of_the_primary_core(tmp_path: Path, core: int, speed: float, vy: float) -> None:
    signals = made(tmp_path, core=core).signals
    assert signals["speed"].x == pytest.approx(np.full(100, speed), abs=1e-6)
    assert signals["vy"].x == pytest.approx(np.full(100, vy), abs=1e-6)


def test_steering_is_the_output_with_function_26(tmp_path: Path) -> None:
    (steering,) = made(tmp_path).steering
    assert steering.source == "RCOU.C4" and set(steering.x.tolist()) == {1444.0}


def test_dropped_messages_are_those_since_the_log_began(tmp_path: Path) -> None:
    assert any("could not write 9 log messages" in n.text for n in made(tmp_path).notes)


def test_one_damaged_time_does_not_void_what_follows() -> None:
    t = np.linspace(0.0, 1.9, 20)
    t[7], t[12] = 1e8, t[11]
    kept, (x,) = increasing(t, np.arange(20.0))
    assert x.tolist() == [k for k in range(20) if k not in (7, 12)]
    assert np.all(np.diff(kept) > 0)


def test_a_cut_off_of_zero_is_no_filter() -> None:
    assert sensor_filters({"INS_GYRO_FILTER": 0, "INS_ACCEL_FILTER": 0}, None) == ({}, ())
    filters, notes = sensor_filters({}, {"gyro_hz": 30})
    assert {c: f.cutoff_hz for c, f in filters.items()} == {"r": 30, "p": 30, "ay": 10}
    assert len(notes) == 1 and "INS_ACCEL_FILTER" in notes[0].text
