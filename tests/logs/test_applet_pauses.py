"""A pause in the applet's log: RCOU shows what the servo did; without it a sentence says what is assumed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import applet_rows, drive
from flash_writer import FlashWriter

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.logs.find import find_runs
from rover_sweep.logs.judgement import with_notes
from rover_sweep.logs.log import Log, joined_steering
from rover_sweep.logs.readers.dataflash_channels import read_dataflash
from rover_sweep.manoeuvre.sweep import Sweep

SWEEP = Sweep(amplitude=100, t_rec=30, w_min=0.8)
TRIM, LAPSE, REPORT = 1500.0, 0.1, 0.02  # us; s, OVERRIDE_MS of the applet; s between its messages
LONGEST = 0.86  # s


def pauses(log: Log, start: float, length: float) -> list[tuple[float, float]]:
    """(begin, end) [s] of four pauses, each from a message of the applet far from trim to another one."""
    messages = np.arange(start, start + SWEEP.duration, REPORT)
    far = messages[np.abs(at(log.steering[0], messages) - TRIM) > 80]
    return [(at, at + length) for s in (8, 15, 22, 29) for at in [next(a for a in far if a > start + s)]]


def released(output: Signal, gaps: list[tuple[float, float]], to: float) -> Signal:
    """The output when each override lapses in its pause; to: [us] of the stick."""
    x = output.x.copy()
    for a, b in gaps:
        x[(output.t > a) & (output.t < b)] = x[np.searchsorted(output.t, a, "right") - 1]
        x[(output.t > a + LAPSE) & (output.t < b)] = to
    return replace(output, x=x)


def paused(
    length: float, phase: float = 0.0, to: float = TRIM
) -> tuple[Log, Signal, list[tuple[float, float]]]:
    """A log with SWEP (50 Hz, four pauses) and RCOU (10 Hz), the true output, and the pauses."""
    log, (start,) = drive([SWEEP])
    gaps = pauses(log, start, length)
    output = released(log.steering[0], gaps, to)
    end = start + SWEEP.duration
    logged = np.arange(start - 125 * REPORT, end + 2.5, REPORT)
    near = [(logged < a + REPORT / 2) | (logged > b - REPORT / 2) for a, b in gaps]
    logged = logged[np.all(near, axis=0)]
    fine = Signal(logged, at(output, logged), "us", "SWEP.Out", hold=True)
    sampled = np.arange(output.t[0] + phase, output.t[-1], 0.1)
    coarse = Signal(sampled, at(output, sampled), "us", "RCOU.C1")
    states = [(start - 2.5, 3), (start, 6), (end, 8), (end + 2.5, 9)]
    rows = applet_rows(logged, 1, states)
    return replace(log, steering=(joined_steering(fine, coarse), coarse), applet=rows), output, gaps


def at(signal: Signal, t: Array) -> Array:
    return signal.x[np.clip(np.searchsorted(signal.t, t + 1e-9, "right") - 1, 0, signal.t.size - 1)]


def judged(log: Log) -> Recording:
    (run,) = find_runs(log)
    return with_notes(run, log)


def texts(run: Recording, level: str) -> str:
    return " | ".join(n.text for n in run.notes if n.level == level)


@pytest.mark.parametrize("length", [0.28, 0.5, LONGEST])
@pytest.mark.parametrize("phase", [0.0, 0.035, 0.07])
@pytest.mark.parametrize("to", [TRIM, 1440.0])
def test_a_servo_that_was_released_in_a_pause_is_seen_there(length: float, phase: float, to: float) -> None:
    log, output, gaps = paused(length, phase, to)
    pwm = log.steering[0]
    for a, b in gaps:
        grid = np.arange(a, b, 0.001)
        wrong = np.abs(at(pwm, grid) - at(output, grid)) > 1
        assert np.sum(wrong) * 0.001 < 0.055, "one step, known to half the interval of RCOU"
    run = judged(log)
    assert run.kind == "sweep" and "assumed constant" not in texts(run, "warning")
    assert f"in 4 pauses, the longest of {length:.2f} s" in texts(run, "warning")
    assert "RCOU, which is used there, shows that the servo moved by up to" in texts(run, "warning")


@pytest.mark.parametrize("other", ["none", "mirrored", "constant"])
def test_without_rcou_of_this_output_a_pause_is_assumed_constant_and_says_so(other: str) -> None:
    """RCOU of another channel must not become the steering of a pause."""
    log, output, _ = paused(0.5)
    coarse = log.steering[1]
    values = {"mirrored": 2 * TRIM - coarse.x, "constant": np.full(coarse.x.size, TRIM)}
    rcou = replace(coarse, x=values[other]) if other in values else None
    fine = replace(log.steering[0], t=log.applet.t, x=at(output, log.applet.t))  # type: ignore[union-attr]
    joined = joined_steering(fine, rcou)
    assert joined is fine
    said = texts(judged(replace(log, steering=(joined,))), "warning")
    assert "was not logged for 0.50 s" in said and "it is assumed constant there" in said
    assert "the servo may have gone back to trim: log RCOU (LOG_BITMASK), which shows it" in said


@pytest.mark.parametrize("channel", [1, 3])
def test_the_pause_is_read_from_the_channel_that_steers(tmp_path: Path, channel: int) -> None:
    """SWEP and RCOU both hold the output, so SERVOn_REVERSED changes nothing between them."""
    log, output, gaps = paused(LONGEST)
    writer = FlashWriter()
    writer.parameters({f"SERVO{channel}_FUNCTION": 26, f"SERVO{channel}_REVERSED": 1})
    writer.define("SWEP", "QHBfff", "TimeUS,Run,St,T,Cmd,Out")
    writer.define("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    assert log.applet is not None
    rows = zip(log.applet.t, log.applet.state, log.applet.clock, at(output, log.applet.t), strict=True)
    for t, state, clock, out in rows:
        writer.write("SWEP", 1e6 * t, 1, state, clock, out, out)
    for t, x in zip(log.steering[1].t, log.steering[1].x, strict=True):
        writer.write("RCOU", 1e6 * t, *(x if c == channel else 1000 + c for c in (1, 2, 3, 4)))
    (tmp_path / "made.BIN").write_bytes(writer.data)
    (read,) = read_dataflash(tmp_path / "made.BIN")
    middle = np.array([(a + b) / 2 for a, b in gaps])
    assert read.steering[0].source == "SWEP.Out" and read.steering[1].source == f"RCOU.C{channel}"
    assert at(read.steering[0], middle).tolist() == [TRIM] * len(gaps)
