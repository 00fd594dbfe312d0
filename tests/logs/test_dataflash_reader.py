"""The column reader of DataFlash logs, against pymavlink and against damage."""

from __future__ import annotations

import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flash_writer import FlashWriter
from recordings import NOMINAL, REPOSITORY

from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Log, sensor_filters
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers import dataflash_index
from rover_sweep.logs.readers.dataflash import DataFlash, index, open_parts
from rover_sweep.logs.readers.dataflash_channels import read_dataflash
from tests.fuzz.seeds import drive

RUN = NOMINAL / "run4.BIN"


def by_pymavlink(path: Path) -> dict[str, list[dict[str, object]]]:
    """All messages of a log by name, as pymavlink reads them."""
    from pymavlink import DFReader

    log = DFReader.DFReader_binary(str(path))
    found: dict[str, list[dict[str, object]]] = {}
    while (message := log.recv_msg()) is not None:
        found.setdefault(message.get_type(), []).append(message.to_dict())
    return found


def assert_same(flash: DataFlash, name: str, theirs: list[dict[str, object]]) -> None:
    assert flash.count(name) == len(theirs)
    for column, code in zip(flash.formats[name].columns, flash.formats[name].format, strict=True):
        expected = [row[column] for row in theirs]
        if code in "nNZ":
            assert flash.text(name, column) == expected
        elif code != "a":
            np.testing.assert_allclose(flash.column(name, column), np.array(expected, float), rtol=1e-12)


def test_every_value_is_the_one_that_pymavlink_reads() -> None:
    flash, theirs = index(np.fromfile(RUN, np.uint8)), by_pymavlink(RUN)
    for name in theirs.keys() - {"FMT"}:  # pymavlink moves some FMT about
        assert_same(flash, name, theirs[name])
    assert {n for n in flash.formats if flash.count(n)} == set(theirs)
    assert flash.bad_bytes == flash.tail_bytes == 0


def small_log(n: int = 200) -> bytes:
    writer = FlashWriter()
    writer.define("IMU", "QBff", "TimeUS,I,GyrX,GyrZ")
    for k in range(n):
        writer.write("IMU", 1000 * k, 0, k * 0.5, -k * 0.25)
    return writer.data


def parsed(data: bytes) -> DataFlash:
    return index(np.frombuffer(data, np.uint8))


def test_factors_of_the_formats_are_applied_times_and_texts_are_those_of_the_log() -> None:
    writer = FlashWriter()
    writer.define("ATT", "Qcc", "TimeUS,Roll,Yaw")
    writer.write("ATT", 2_500_000, -12.34, 300.07)
    flash = parsed(writer.data)
    assert flash.column("ATT", "Roll").tolist() == pytest.approx([-12.34])
    assert flash.column("ATT", "Yaw").tolist() == pytest.approx([300.07])
    assert flash.seconds("ATT").tolist() == [2.5]
    writer = FlashWriter()
    writer.define("ATT", "Ic", "TimeMS,Roll")  # of a very old log
    writer.write("ATT", 2500, 1.0)
    text = "\n\n Ready to drive.\x1b[2J\x07[/bold]"
    writer.messages([text])
    assert parsed(writer.data).seconds("ATT").tolist() == [2.5]
    assert parsed(writer.data).text("MSG", "Message") == [text]


def test_damage_costs_only_the_messages_it_hits() -> None:
    data = bytearray(small_log())
    start = len(data) - 100 * 20  # 20 bytes a message
    data[start : start + 30] = b"\xa3\x95" * 15
    flash = parsed(bytes(data))
    x = flash.column("IMU", "GyrX")
    assert flash.count("IMU") == 200 - 3  # two are overwritten, and the one before has no follower
    assert set(np.diff(x).tolist()) == {0.5, 2.0}
    assert flash.bad_bytes == 60 and flash.tail_bytes == 0


def test_a_payload_that_looks_like_a_header_does_no_harm() -> None:
    writer = FlashWriter()
    writer.define("IMU", "QII", "TimeUS,A,B")
    trap = int.from_bytes(b"\xa3\x95\x01\x00", "little")
    for k in range(50):
        writer.write("IMU", k, trap, trap)
    flash = parsed(writer.data)
    assert flash.count("IMU") == 50
    assert flash.seconds("IMU").tolist() == pytest.approx([k * 1e-6 for k in range(50)])
    assert flash.bad_bytes == 0


def test_the_package_loads_nothing_slow() -> None:
    code = (
        "import sys; from rover_sweep.logs.read import read_runs; read_runs(sys.argv[1]); "
        "print([m for m in ('scipy', 'pymavlink', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(RUN)], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


# ---- The compiled scan of a large log finds the messages that numpy finds, at any damage and block size.


def damaged(data: bytes, seed: int) -> bytes:
    """With places overwritten, cut out, and filled with what looks like headers."""
    chance, changed = random.Random(seed), bytearray(data)
    for _ in range(20):
        at, size = chance.randrange(len(changed)), chance.choice((1, 5, 60, 3000))
        kind = chance.randrange(4)
        if kind == 0:
            changed[at : at + size] = chance.randbytes(size)
        elif kind == 1:
            del changed[at : at + size]
        elif kind == 2:
            changed[at : at + size] = (b"\xa3\x95" + bytes((chance.choice((128, 0, 33)),))) * (size // 3 + 1)
        else:
            changed[at:at] = bytes(size)
    return bytes(changed[: len(changed) - chance.randrange(100)])


def assert_equal(one: DataFlash, two: DataFlash) -> None:
    for name in ("bad_bytes", "tail_bytes", "breaks", "message_count"):
        assert getattr(one, name) == getattr(two, name), name
    assert one.formats == two.formats
    for name in one.formats:
        np.testing.assert_array_equal(one.positions(name), two.positions(name))
        assert one.rows(name).tobytes() == two.rows(name).tobytes()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("block", [300, 1 << 25])
def test_the_compiled_scan_finds_what_numpy_finds(
    monkeypatch: pytest.MonkeyPatch, seed: int, block: int
) -> None:
    data = np.frombuffer(damaged(RUN.read_bytes()[:150_000], seed), np.uint8)
    plain = index(data)
    assert plain.breaks > 3 and plain.bad_bytes > 0
    monkeypatch.setattr(dataflash_index, "LARGE", 0)
    monkeypatch.setattr(dataflash_index, "BLOCK", block)
    assert_equal(index(data), plain)


@pytest.mark.parametrize("data", [b"", b"\xa3", b"\xa3\x95\x80", b"hello " * 1000, bytes(5000)])
def test_nothing_is_found_where_nothing_is(monkeypatch: pytest.MonkeyPatch, data: bytes) -> None:
    for large in (dataflash_index.LARGE, 0):
        monkeypatch.setattr(dataflash_index, "LARGE", large)
        flash = index(np.frombuffer(data, np.uint8))
        assert not flash.formats and flash.bad_bytes == len(data)


def test_damage_over_the_edge_of_a_block_is_one_break(monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytearray(RUN.read_bytes()[:150_000])
    data[95_000:105_000] = bytes(10_000)
    monkeypatch.setattr(dataflash_index, "LARGE", 0)
    monkeypatch.setattr(dataflash_index, "BLOCK", 100_000)
    assert index(np.frombuffer(bytes(data), np.uint8)).breaks == 1


def test_a_mapped_file_that_gives_its_memory_back_reads_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = tmp_path / "both.BIN"
    both.write_bytes(RUN.read_bytes() + (NOMINAL / "run1.BIN").read_bytes())
    plain = open_parts(both)
    monkeypatch.setattr(dataflash_index, "LARGE", 0)
    monkeypatch.setattr(dataflash_index, "BLOCK", 100_000)
    for mine, theirs in zip(open_parts(both), plain, strict=True):
        assert_equal(mine, theirs)


def test_only_the_columns_asked_for_are_kept() -> None:
    flash = index(np.fromfile(RUN, np.uint8))
    whole, few = flash.rows("IMU"), flash.rows("IMU", "GyrZ", "TimeUS", "GyrZ")
    assert few.dtype.names == ("GyrZ", "TimeUS") and few.dtype.itemsize == 12
    for column in ("GyrZ", "TimeUS"):
        np.testing.assert_array_equal(few[column], whole[column])
        np.testing.assert_array_equal(flash.column("IMU", column), whole[column].astype(float))


# ---- Which messages of a DataFlash log the channels come from.

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


def test_steering_is_the_output_with_function_26_and_dropped_messages_are_told(tmp_path: Path) -> None:
    log = made(tmp_path)
    assert log.steering[0].source == "RCOU.C4" and set(log.steering[0].x.tolist()) == {1444.0}
    assert any("could not write 9 log messages" in n.text for n in log.notes), "since the log began"


def test_a_cut_off_of_zero_is_no_filter() -> None:
    assert sensor_filters({"INS_GYRO_FILTER": 0, "INS_ACCEL_FILTER": 0}, None) == ({}, ())
    filters, notes = sensor_filters({}, {"gyro_hz": 30})
    assert {c: f.cutoff_hz for c, f in filters.items()} == {"r": 30, "p": 30, "ay": 10}
    assert len(notes) == 1 and "INS_ACCEL_FILTER" in notes[0].text


# ---- DataFlash logs of before 2015, and of tables of formats that are damaged.

BANNER = "ArduRover V2.46"


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


def test_a_text_column_is_no_number_and_a_number_no_text() -> None:
    w = FlashWriter()
    w.define("MSG", "ZQ", "TimeUS,Message")
    w.write("MSG", b"x", 7)
    found = parsed(w.data)
    assert not found.has("MSG", "TimeUS") and found.has("MSG", "Message")
    assert found.has_text("MSG", "TimeUS") and not found.has_text("MSG", "Message")
    assert not found.has_text("MSG", "Nothing") and not found.has_text("XKF1", "Message")
