"""DataFlash logs of before 2015, and of tables of formats that are damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flash_writer import FlashWriter

from rover_sweep.errors import DataRefused
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers.dataflash import DataFlash, index
from tests.fuzz.seeds import drive, flash

BANNER = "ArduRover V2.46"


def parsed(data: bytes) -> DataFlash:
    return index(np.frombuffer(data, np.uint8))


def of_2014(path: Path) -> Path:
    """As ArduRover 2.46 wrote: MSG and PARM without time, GPS with that of the week (DataFlash.h of 2014)."""
    d, w = drive(np.inf), FlashWriter()
    w.define("PARM", "Nf", "Name,Value")
    for name, value in {"RCMAP_ROLL": 1.0, "RC1_MIN": 1100.0, "RC1_MAX": 1900.0}.items():
        w.write("PARM", name.encode(), value)
    w.define("MSG", "Z", "Message")
    w.define("GPS", "IHhI", "TimeMS,Week,Spd,T")
    w.define("IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    w.define("RCOU", "IHH", "TimeMS,Chan1,Chan2")
    w.write("MSG", BANNER.encode())
    for k, (t, pwm, r, p, ay) in enumerate(zip(d.t, d.pwm, d.r, d.p, d.ay, strict=True)):
        w.write("IMU", 1000 * t, p, 0.0, r, 0.0, ay, -9.8)
        w.write("RCOU", 1000 * t, pwm, 1500)
        if k % 10 == 0:
            w.write("GPS", 400_000_000 + 1000 * t, 1800, 2.4, 1000 * t)
        if k == 500:
            w.write("MSG", b"in the middle")
    path.write_bytes(w.data)
    return path


def test_a_log_of_2014_is_read(tmp_path: Path) -> None:
    (log,) = read_logs(str(of_2014(tmp_path / "old.BIN")))
    assert log.firmware == BANNER and log.limits == (1100.0, 1900.0)
    assert {text: t for t, text in log.marks}["in the middle"] == pytest.approx(drive(np.inf).t[500])
    assert log.signals["speed"].t[0] == pytest.approx(drive(np.inf).t[0]), (
        "GPS.T is since boot, TimeMS is not"
    )
    assert log.steering[0].source == "RCOU.Chan1"


def test_messages_without_any_time_have_none() -> None:
    w = FlashWriter()
    w.define("MSG", "Z", "Message")
    w.write("MSG", b"hello")
    assert parsed(w.data).seconds("MSG").tolist() == [0.0]


def test_sensors_without_time_are_refused_with_the_reason(tmp_path: Path) -> None:
    w = FlashWriter()
    w.messages([BANNER])
    w.define("IMU", "ffffff", "GyrX,GyrY,GyrZ,AccX,AccY,AccZ")  # as of 2013
    for _ in range(100):
        w.write("IMU", *[0.1] * 6)
    path = tmp_path / "older.BIN"
    path.write_bytes(w.data)
    with pytest.raises(DataRefused, match="IMU messages of the log have no time .* only GyrX, GyrY"):
        read_runs(str(path))


@pytest.mark.parametrize(
    "columns",
    [
        (b"TimeUS,Message", b"Message,TimeUS"),
        (b"TimeUS,Name,Value", b"Value,Name,TimeUS"),
        (b"TimeUS,Name,Value", b"Name,TimeUS,Value"),
        (b"TimeUS,I,GyrX,GyrZ,AccY", b"GyrX,AccY,I,TimeUS,GyrZ"),
        (b"TimeUS,Run,St,Cmd,Out,T", b"T,Out,Cmd,St,Run,TimeUS"),
        (b"TimeUS,C1,C3", b"C1,TimeUS,C3"),
    ],
)
def test_shuffled_columns_end_in_an_answer_or_a_sentence(
    columns: tuple[bytes, bytes], tmp_path: Path
) -> None:
    path = tmp_path / "a.BIN"
    data = flash()
    assert columns[0] in data
    path.write_bytes(data.replace(columns[0], columns[1]))
    try:
        assert read_runs(str(path))
    except DataRefused as refusal:
        assert len(str(refusal)) > 20


def test_two_formats_of_one_type_are_one() -> None:
    """A damaged FMT gave its type to another message, longer than what is there: IndexError at the end."""
    w = FlashWriter()
    w.define("MSG", "QZ", "TimeUS,Message")
    w.define("IMU", "QBff", "TimeUS,I,GyrX,GyrZ")
    for k in range(50):
        w.write("IMU", k, 0, 0.0, 0.0)
    kind = w.data[w.data.index(b"IMU") - 2]
    at = w.data.index(b"MSG") - 2
    found = parsed(w.data[:at] + bytes([kind]) + w.data[at + 1 :])
    assert [found.count(name) for name in ("IMU", "MSG")] == [50, 0]
    assert found.rows("IMU").size == 50


def test_a_text_column_is_no_number_and_a_number_no_text() -> None:
    w = FlashWriter()
    w.define("MSG", "ZQ", "TimeUS,Message")
    w.write("MSG", b"x", 7)
    found = parsed(w.data)
    assert not found.has("MSG", "TimeUS") and found.has("MSG", "Message")
    assert found.has_text("MSG", "TimeUS") and not found.has_text("MSG", "Message")
    assert not found.has_text("MSG", "Nothing") and not found.has_text("XKF1", "Message")
