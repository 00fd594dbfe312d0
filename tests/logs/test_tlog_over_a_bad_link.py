"""Telemetry alone over a bad link: lost, damaged, late and repeated frames do not change the verdict."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from link_faults import corrupted, jittered, lost, records
from recordings import DEFAULTS
from test_tlog_reader import Telemetry, saved

from rover_sweep.data.recording import Recording
from rover_sweep.errors import DataRefused
from rover_sweep.logs.read import read_runs
from rover_sweep.logs.readers import tlog
from rover_sweep.logs.readers.tlog import walk
from rover_sweep.logs.readers.tlog_channels import read_telemetry
from rover_sweep.quality.verdict import assess

SHARE = 0.05


@pytest.fixture(scope="module")
def sound() -> list[bytes]:
    return records((DEFAULTS / "run1.tlog").read_bytes())


@pytest.fixture(scope="module")
def sound_run(sound: list[bytes], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return only_run(tmp_path_factory.mktemp("sound"), b"".join(sound))


def only_run(folder: Path, data: bytes) -> Recording:
    (run,) = read_runs(str(saved(folder, data)))
    return run


def verdict(run: Recording) -> tuple[bool, list[tuple[str, list[float]]]]:
    """Good or not, and the usable bands [rad/s]."""
    found = assess(run)
    return found.keep, [(o.output, [round(w, 1) for w in o.band or ()]) for o in found.outputs]


def test_corrupted_frames_are_judged_as_lost_ones(
    sound: list[bytes], sound_run: Recording, tmp_path: Path
) -> None:
    bad = {
        "lost": lost(sound, SHARE, 1),
        "corrupted": corrupted(sound, SHARE, 1),
        "with the stamps": corrupted(sound, SHARE, 2, stamps=True),
    }
    for what, data in bad.items():
        run = only_run(tmp_path, data)
        assert verdict(run) == verdict(sound_run), what
        assert run["r"].t.size > 0.94 * sound_run["r"].t.size, what
        same = np.isin(run["r"].t, sound_run["r"].t)
        assert same.all(), what
        noted = any("frames of the telemetry log" in n.text and "skipped" in n.text for n in run.notes)
        assert noted == (what != "lost"), what


def test_half_a_second_of_jitter_changes_nothing(
    sound: list[bytes], sound_run: Recording, tmp_path: Path
) -> None:
    run = only_run(tmp_path, jittered(sound, 0.5, 1, twice=0.05))
    assert verdict(run) == verdict(sound_run)
    assert run.span == pytest.approx(sound_run.span, abs=0.02)
    for channel in ("r", "p", "ay", "vy", "pwm"):
        np.testing.assert_array_equal(run[channel].t, sound_run[channel].t)
        np.testing.assert_allclose(run[channel].x, sound_run[channel].x, atol=1e-9)
    assert [n.text for n in run.notes] == [n.text for n in sound_run.notes]


def test_jitter_moves_no_message_to_another_start_of_the_vehicle(tmp_path: Path) -> None:
    """A message held up for 2 s is no restart; nor does one from before it make a second."""
    telemetry = Telemetry()
    telemetry.drive(100.0, 20.0)
    first = records(telemetry.data)
    first.insert(900, first.pop(700))
    telemetry.drive(3.0, 10.0)
    again = records(telemetry.data)[len(first) :]
    before, after = read_telemetry(saved(tmp_path, b"".join([*first, *again])))
    assert before.signals["r"].t[[0, -1]] == pytest.approx([100.0, 119.95])
    assert before.signals["r"].t.size == 400
    assert after.signals["r"].t[[0, -1]] == pytest.approx([3.0, 12.95])
    assert any("restarted" in n.text for n in before.notes)


def test_the_servo_clock_wraps_while_messages_overtake_each_other(tmp_path: Path) -> None:
    telemetry = Telemetry()
    telemetry.drive(2**32 * 1e-6 - 5.0, 10.0)
    for seed in range(3):
        (log,) = read_telemetry(saved(tmp_path, jittered(records(telemetry.data), 0.01, seed, 0.2)))
        np.testing.assert_allclose(log.steering[0].t, log.signals["r"].t, atol=1e-6)
        assert log.steering[0].t.size == 200


def test_a_wrong_length_or_stamp_costs_one_frame() -> None:
    telemetry = Telemetry()
    telemetry.drive(100.0, 1.0)
    sound = records(telemetry.data)
    count = len(sound)
    for byte, value in ((0, 0xFD), (7, 0xFE), (8, 0x00), (9, 0x01), (9, 0xF0), (10, 0x01), (12, 0xFF)):
        for k in (3, 40, count - 2):
            changed = bytearray(sound[k])
            changed[byte] = value
            found = walk(b"".join([*sound[:k], bytes(changed), *sound[k + 1 :]]))
            assert found.frame_count >= count - 1, (byte, value, k)
            assert found.damaged == (byte >= 8 and bytes(changed) != sound[k]) or byte == 12
    assert walk(b"".join(sound)).damaged == 0
    for cut in (1, 9, 20):
        assert walk(b"".join([*sound[:10], sound[10][cut:], *sound[11:]])).frame_count >= count - 1


def test_a_log_with_more_damage_than_content_is_refused(tmp_path: Path) -> None:
    telemetry = Telemetry()
    telemetry.drive(100.0, 20.0)
    sound = records(telemetry.data)
    bad = b"".join([sound[0], corrupted(sound[1:], 0.6, 1)])
    with pytest.raises(DataRefused, match=r"is damaged: \d+ frames have wrong bytes, \d+ are complete"):
        read_telemetry(saved(tmp_path, bad))


@pytest.mark.parametrize("seed", range(4))
def test_the_compiled_walk_finds_the_same_frames(
    monkeypatch: pytest.MonkeyPatch, sound: list[bytes], seed: int
) -> None:
    data = corrupted(sound[:3000], 0.05, seed, stamps=True)[: -1 - seed]
    plain = walk(data)
    assert plain.damaged > 20
    monkeypatch.setattr(tlog, "LARGE", 0)
    assert walk(data) == plain
