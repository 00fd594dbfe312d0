"""A telemetry log in which two vehicles were recorded: one is read, and that is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from link_faults import records
from pymavlink.dialects.v20 import ardupilotmega as m
from recordings import APPLET, DEFAULTS

from rover_sweep.data.recording import Recording
from rover_sweep.errors import DataRefused
from rover_sweep.logs.read import read_runs

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
