"""The column reader of DataFlash logs, against pymavlink and against damage."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flash_writer import FlashWriter
from recordings import NOMINAL, REPOSITORY, foreign

from rover_sweep.logs.readers.dataflash import DataFlash, index

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


def test_old_logs_are_read_too() -> None:
    path = Path(foreign("rover_logs/moved_by_hand_v2.51.BIN"))
    flash, theirs = index(np.fromfile(path, np.uint8)), by_pymavlink(path)
    for name in ("IMU", "RCOU", "ATT", "PARM", "MSG"):
        assert_same(flash, name, theirs[name])


def small_log(n: int = 200) -> bytes:
    writer = FlashWriter()
    writer.define("IMU", "QBff", "TimeUS,I,GyrX,GyrZ")
    for k in range(n):
        writer.write("IMU", 1000 * k, 0, k * 0.5, -k * 0.25)
    return writer.data


def parsed(data: bytes) -> DataFlash:
    return index(np.frombuffer(data, np.uint8))


def test_factors_of_the_formats_are_applied() -> None:
    writer = FlashWriter()
    writer.define("ATT", "Qcc", "TimeUS,Roll,Yaw")
    writer.write("ATT", 2_500_000, -12.34, 300.07)
    flash = parsed(writer.data)
    assert flash.column("ATT", "Roll").tolist() == pytest.approx([-12.34])
    assert flash.column("ATT", "Yaw").tolist() == pytest.approx([300.07])
    assert flash.seconds("ATT").tolist() == [2.5]


def test_times_of_very_old_logs_are_milliseconds() -> None:
    writer = FlashWriter()
    writer.define("ATT", "Ic", "TimeMS,Roll")
    writer.write("ATT", 2500, 1.0)
    assert parsed(writer.data).seconds("ATT").tolist() == [2.5]


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


@pytest.mark.parametrize("cut", [1, 7, 19])
def test_a_log_may_end_in_the_middle_of_a_message(cut: int) -> None:
    flash = parsed(small_log()[:-cut])
    assert flash.count("IMU") in (198, 199)
    assert 0 < flash.tail_bytes <= 40


@pytest.mark.parametrize("data", [b"", b"\xa3", b"hello " * 1000, bytes(5000)])
def test_what_is_no_log_has_no_messages(data: bytes) -> None:
    flash = parsed(data)
    assert not flash.formats and flash.bad_bytes == len(data)


def test_all_messages_of_a_long_log_are_found() -> None:
    body = index(np.fromfile(RUN, np.uint8))
    flash = index(np.concatenate([np.asarray(body.data)] * 40))
    assert flash.count("IMU") == 40 * body.count("IMU")
    assert flash.column("IMU", "GyrZ").size == flash.count("IMU")


def test_the_package_loads_nothing_slow() -> None:
    code = (
        "import sys; from rover_sweep.logs.read import read_runs; read_runs(sys.argv[1]); "
        "print([m for m in ('scipy', 'pymavlink', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(RUN)], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_texts_are_those_of_the_log_whatever_they_hold() -> None:
    writer = FlashWriter()
    text = "\n\n Ready to drive.\x1b[2J\x07[/bold]"
    writer.messages([text])
    assert parsed(writer.data).text("MSG", "Message") == [text]
