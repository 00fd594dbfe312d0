"""The compiled scan of a large log finds the messages that numpy finds, at any damage and block size."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from recordings import NOMINAL

from rover_sweep.logs.readers import dataflash_index
from rover_sweep.logs.readers.dataflash import DataFlash, index, open_parts

RUN = NOMINAL / "run4.BIN"


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


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("block", [300, 4096, 1 << 25])
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
def test_the_compiled_scan_finds_nothing_where_nothing_is(
    monkeypatch: pytest.MonkeyPatch, data: bytes
) -> None:
    monkeypatch.setattr(dataflash_index, "LARGE", 0)
    flash = index(np.frombuffer(data, np.uint8))
    assert not flash.formats and flash.bad_bytes == flash.tail_bytes == len(data)


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
