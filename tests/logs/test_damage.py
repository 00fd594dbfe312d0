"""Joined logs, flipped bits, impossible samples, dead channels, odd clocks."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import drive, signal
from recordings import NOMINAL

import rover_sweep as rs
from rover_sweep.errors import DataRefused
from rover_sweep.logs.find import find_runs
from rover_sweep.logs.judgement import refuse_useless
from rover_sweep.logs.log import Log, increasing, refuse_disorder
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers.dataflash import open_parts
from rover_sweep.logs.readers.screening import screened
from rover_sweep.manoeuvre.sweep import Manoeuvre, Sweep

SWEEP: Manoeuvre = Sweep(amplitude=100, t_rec=30, w_min=0.8)
ONE, TWO = NOMINAL / "run1.BIN", NOMINAL / "run2.BIN"


@pytest.mark.parametrize("order", [(ONE, TWO)])
def test_logs_joined_into_one_file_are_all_found(tmp_path: Path, order: tuple[Path, Path]) -> None:
    path = tmp_path / "both.BIN"
    path.write_bytes(b"".join(p.read_bytes() for p in order))
    runs = read_runs(str(path))
    assert [r.name for r in runs] == ["both log 1", "both log 2"]
    for run, source in zip(runs, order, strict=True):
        (alone,) = read_runs(str(source))
        assert run.span == alone.span and run.kind == alone.kind
        np.testing.assert_array_equal(run["r"].x, alone["r"].x)


def test_a_joined_log_is_paired_with_the_telemetry_of_one_drive(tmp_path: Path) -> None:
    path = tmp_path / "both.BIN"
    path.write_bytes(TWO.read_bytes() + ONE.read_bytes())
    (run,) = read_runs(f"{path}+{NOMINAL / 'run1.tlog'}")
    assert run.name == "both log 2" and len(run.sources) == 2
    assert [p.breaks for p in open_parts(ONE)] == [0] and len(read_logs(str(ONE))) == 1


def flipped(tmp_path: Path, count: int) -> str:
    chance, data = random.Random(count), bytearray(ONE.read_bytes())
    for _ in range(count):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path = tmp_path / f"flip{count}.BIN"
    path.write_bytes(data)
    return str(path)


def test_few_flipped_bits_leave_the_run_as_it_was(tmp_path: Path) -> None:
    (run,), (sound,) = read_runs(flipped(tmp_path, 100)), read_runs(str(ONE))
    assert run.kind == "sweep" and run.span == pytest.approx(sound.span, abs=0.1)
    for channel in ("r", "p", "ay", "vy", "speed"):
        x = run.manoeuvre(channel).x
        assert np.all(np.isfinite(x)) and x.size > 0.98 * sound.manoeuvre(channel).x.size
    assert any("damaged bytes" in n.text for n in run.notes)


@pytest.mark.parametrize("count", [1000, 3000])
def test_many_flipped_bits_are_refused(tmp_path: Path, count: int) -> None:
    with pytest.raises(DataRefused, match=r"is damaged(:| in .* places among .* messages)"):
        read_runs(flipped(tmp_path, count))


def test_a_lone_damaged_stamp_costs_itself_alone() -> None:
    t = np.arange(0.0, 10.0, 0.02)
    for k, wrong in ((0, 1e8), (100, 3.0), (200, 9.9), (499, -5.0)):
        damaged = t.copy()
        damaged[k] = wrong
        kept, (index,) = increasing(damaged, np.arange(t.size, dtype=float))
        assert set(range(t.size)) - set(index.astype(int).tolist()) == {k}
        refuse_disorder("log", {"IMU": damaged})
    gap = np.repeat(np.concatenate((np.arange(0, 5, 0.02), np.arange(500, 505, 0.02))), 2)
    refuse_disorder("log", {"IMU": gap, "XKF1": np.zeros(0)})  # nor are repeated stamps disorder
    assert increasing(gap)[0].size == gap.size // 2


def test_a_clock_that_runs_back_for_long_is_refused() -> None:
    t = np.arange(0.0, 10.0, 0.02)
    with pytest.raises(DataRefused, match="199 of 500 times of IMU are out of order, by up to 4.98 s"):
        refuse_disorder("log", {"IMU": np.where(t < 5, t, t - 5.0)})
    with pytest.raises(DataRefused, match="out of order"):
        refuse_disorder("log", {"IMU": np.random.default_rng(1).permutation(t)})


def with_samples(log: Log, channel: str, count: int, value: float) -> Log:
    x = log.signals[channel].x.copy()
    x[1000 : 1000 + 10 * count : 10] = value
    return replace(log, signals={**log.signals, channel: replace(log.signals[channel], x=x)})


@pytest.mark.parametrize("value", [1e300, -np.inf, np.nan, 60.0])
def test_impossible_samples_are_left_out_and_told(value: float) -> None:
    log, _ = drive([SWEEP])
    assert all(s is log.signals[c] for c, s in screened(log).signals.items()), "a sound log stays"
    clean = screened(with_samples(log, "r", 5, value))
    assert clean.signals["r"].x.size == log.signals["r"].x.size - 5
    assert np.max(np.abs(clean.signals["r"].x)) < 1
    words = "impossible" if np.isfinite(value) else "no finite number"
    assert f"5 of {log.signals['r'].x.size} samples of r (MADE.rad/s) are {words}" in clean.notes[0].text
    if np.isfinite(value):  # of a wrong unit are more
        with pytest.raises(DataRefused, match="samples of r .* are impossible.*are they in deg/s"):
            screened(with_samples(log, "r", 200, value))


def test_an_output_that_is_off_is_no_damage() -> None:
    log, _ = drive([SWEEP])
    t, x = log.steering[0].t, log.steering[0].x
    off = replace(log, steering=(signal(t, np.where(t < 10, 0.0, x), "us", hold=True),))
    clean = screened(off)
    assert clean.notes == () and clean.steering[0].t[0] == pytest.approx(10.0)
    never = screened(replace(log, steering=(signal(t, 0 * x, "us", hold=True),)))
    with pytest.raises(DataRefused, match="no steering output .* or the output was off"):
        refuse_useless(never)
    broken = np.where(t < 20, 31000.0, x)
    with pytest.raises(DataRefused, match="samples of pwm"):
        screened(replace(log, steering=(signal(t, broken, "us", hold=True),)))


@pytest.mark.parametrize("channel", ["ay", "p"])
def test_a_dead_channel_is_left_out(channel: str) -> None:
    log, _ = drive([SWEEP])
    flat = replace(log.signals[channel], x=np.full(log.signals[channel].x.size, 0.1))
    (run,) = find_runs(replace(log, signals={**log.signals, channel: flat}))
    assert channel not in run
    assert f"{channel} does not change (0.1" in run.notes[0].text and run.notes[0].level == "warning"
    few = replace(log.signals[channel], t=np.array([30.0, 40.0]), x=np.array([0.1, 0.2]))
    spread = replace(few, t=np.array([0.0, 30.0, 87.0]), x=np.array([0.1, 0.2, 0.1]))
    (run,) = find_runs(replace(log, signals={**log.signals, channel: spread}))
    assert channel not in run and "has only 1 samples" in run.notes[0].text
    dead = replace(log.signals["r"], x=0 * log.signals["r"].x)
    with pytest.raises(DataRefused, match="made: r .* does not change .0 rad/s.: not recorded"):
        find_runs(replace(log, signals={**log.signals, "r": dead}))


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1e6, "every 1e.04 s; is the time in us"),
        (1e3, "every 10 s; is the time in ms"),
        (1e-3, "every 1e-05 s"),
    ],
)
def test_time_in_another_unit_is_refused(factor: float, said: str) -> None:
    log, _ = drive([SWEEP])
    signals = {n: replace(s, t=s.t * factor) for n, s in log.signals.items()}
    with pytest.raises(DataRefused, match=said):
        refuse_useless(replace(log, signals=signals))


@pytest.mark.parametrize(("turns_at", "speeds"), [(0.0, [-2.0]), (30.0, [2.0]), (10.0, [-2.0])])
def test_a_negative_speed_is_a_speed(tmp_path: Path, turns_at: float, speeds: list[float]) -> None:
    """Forward until then, in reverse after it. The shorter part has no shape of a run: it is manoeuvring."""
    t = np.arange(0, 40, 0.02)
    way = np.clip((turns_at - t) / 0.2, -1, 1)
    delta, r = 0.3 * np.sin(2 * t), way * 0.5 * np.sin(2 * t)
    columns = zip(t, delta, r, 2 * way, strict=True)
    rows = [f"{a:.2f},{d:.4f},{turn:.4f},{v:.3f}" for a, d, turn, v in columns]
    path = tmp_path / "back.csv"
    path.write_text("\n".join(["t,delta,r,speed", *rows]))
    assert [run.mean_speed for run in read_runs(str(path))] == pytest.approx(speeds, abs=0.2)


# ---- Damage costs what it damages.


def with_block(path: Path, out: Path, block: bytes, at: int) -> Path:
    data = bytearray(path.read_bytes())
    data[at : at + len(block)] = block
    out.write_bytes(data)
    return out


@pytest.mark.parametrize("block", ["zeros", "garbage"])
def test_a_lost_block_costs_its_own_time(tmp_path: Path, block: str) -> None:
    """2 % in the middle, as of a card that lost some blocks."""
    size = ONE.stat().st_size
    lost = bytes(size // 50) if block == "zeros" else random.Random(1).randbytes(size // 50)
    path = with_block(ONE, tmp_path / "burnt.BIN", lost, size // 2)
    (run,), (sound,) = read_runs(str(path)), read_runs(str(ONE))
    assert run.kind == "sweep"
    assert run.manoeuvre("r").x.size > 0.95 * sound.manoeuvre("r").x.size
    (note,) = [n.text for n in run.notes if "damaged bytes" in n.text]
    (part,) = open_parts(path)
    ((before, after, count),) = part.losses()
    assert f"{after - before:.2f} s at {before:.1f} s" in note
    assert size // 50 - 100 < count < size // 50 + 300
    gap = np.diff(run["r"].t)
    k = int(np.argmax(gap))
    assert gap[k] == pytest.approx(after - before, abs=0.1)
    assert run["r"].t[k] == pytest.approx(before, abs=0.1)


def test_garbage_before_the_first_message_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "late.BIN"
    path.write_bytes(random.Random(2).randbytes(60_000) + ONE.read_bytes())
    (run,), (sound,) = read_runs(str(path)), read_runs(str(ONE))
    np.testing.assert_array_equal(run["r"].x, sound["r"].x)
    assert any(n.text.startswith("60000 damaged bytes") for n in run.notes)


def test_a_log_that_is_mostly_lost_is_refused(tmp_path: Path) -> None:
    size = ONE.stat().st_size
    path = with_block(ONE, tmp_path / "gone.BIN", bytes(size * 6 // 10), size // 5)
    with pytest.raises(DataRefused, match="is damaged: .* belong to no message"):
        read_runs(str(path))


@pytest.mark.parametrize("share", [0.01, 0.2])
def test_missing_numbers_cost_themselves(share: float) -> None:
    (log,) = read_logs(str(ONE))
    r = log.signals["r"]
    missing = np.random.default_rng(1).uniform(size=r.x.size) < share
    gaps = replace(r, x=np.where(missing, np.nan, r.x))
    found = screened(replace(log, signals={**log.signals, "r": gaps}))
    np.testing.assert_array_equal(found.signals["r"].x, r.x[~missing])
    assert any(f"{missing.sum()} of {r.x.size} samples of r" in n.text for n in found.notes)


def test_the_answer_says_what_was_lost(tmp_path: Path) -> None:
    size = ONE.stat().st_size
    path = with_block(ONE, tmp_path / "burnt.BIN", bytes(size // 50), size * 2 // 3)
    found, sound = rs.identify_driving(path), rs.identify_driving(ONE)
    assert found.level == "good" and any("damaged bytes" in words for words in found.read)
    assert found.numbers["curvature"].value == pytest.approx(sound.numbers["curvature"].value, rel=0.03)
