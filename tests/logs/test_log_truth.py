"""Channels of the recordings against what the simulated vehicle really did, and against each other."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from recordings import DEFAULTS, NOMINAL, OLDER, STOCK
from scipy import signal

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.logs.read import read_logs, read_runs


@cache
def truth() -> dict[str, Array]:
    table = np.genfromtxt(NOMINAL / "truth.csv", delimiter=",", names=True)
    return {"t": table["t"], "vy": table["Vy"], **{n: table[n] for n in ("pwm", "r", "p", "phi", "Vx")}}


@cache
def run(source: str) -> Recording:
    (found,) = read_runs(source)
    return found


STEP = 0.001  # s
SLOW = 2.0  # rad/s: the estimator's heading error shows in V_y below


def pwm_offset(pwm: Signal) -> float:
    """Shift [s] of the plant's clock against the vehicle's at which the steering agrees best."""
    shifts = np.arange(0.0, 0.2, 0.001)
    grid = np.arange(pwm.t[0], pwm.t[-1], 0.005)
    measured = pwm.on(grid)
    errors = [np.mean((np.interp(grid + s, truth()["t"], truth()["pwm"]) - measured) ** 2) for s in shifts]
    return float(shifts[np.argmin(errors)])


def as_sensed(channel: str, times: Array, cutoff_hz: float | None) -> Array:
    """The truth at `times` [s] of the plant's clock, through the sensor's low-pass."""
    fine = np.arange(times[0] - 1, times[-1], STEP)
    values = np.interp(fine, truth()["t"], truth()[channel])
    if cutoff_hz:
        w = 2 * np.pi * cutoff_hz
        b, a = signal.bilinear([w * w], [1, np.sqrt(2) * w, w * w], fs=1 / STEP)
        values = signal.lfilter(b, a, values)
    return np.interp(times, fine, values)


NOMINAL_RUNS = [str(NOMINAL / f"run{n}.BIN") for n in (1, 2, 3, 4)]


def test_the_plant_clock_is_where_the_recordings_say() -> None:
    """+.054 s by the commands as they were set, which wait half a loop of 10 ms for the servo; the plant logs
    a loop later still."""
    assert pwm_offset(run(NOMINAL_RUNS[0]).manoeuvre("pwm")) == pytest.approx(0.042, abs=0.006)


@pytest.mark.parametrize("source", [*NOMINAL_RUNS, str(NOMINAL / "run1.tlog")])
@pytest.mark.parametrize("channel", ["pwm", "r", "p", "phi", "vy"])
def test_channels_follow_the_truth(source: str, channel: str) -> None:
    recording = run(source)
    offset = pwm_offset(recording.manoeuvre("pwm"))
    measured_signal = recording.manoeuvre(channel)
    grid = np.arange(measured_signal.t[0], measured_signal.t[-1], 0.01)
    cutoff = 20.0 if channel in ("r", "p") else None
    measured, real = measured_signal.on(grid), as_sensed(channel, grid + offset, cutoff)
    if channel == "vy":
        fast = signal.butter(2, SLOW, "high", fs=2 * np.pi / 0.01, output="sos")
        measured, real = signal.sosfiltfilt(fast, measured), signal.sosfiltfilt(fast, real)
    assert np.corrcoef(measured, real)[0, 1] > 0.98
    assert np.std(measured) == pytest.approx(np.std(real), rel=0.07)


def test_speed_is_the_forward_velocity() -> None:
    recording = run(NOMINAL_RUNS[0])
    inside = (truth()["t"] > recording.span[0]) & (truth()["t"] < recording.span[1])
    assert recording.mean_speed == pytest.approx(np.mean(truth()["Vx"][inside]), abs=0.05)


def test_heading_is_the_integral_of_the_yaw_rate() -> None:
    recording = run(NOMINAL_RUNS[0])
    r, psi = recording.manoeuvre("r"), recording["psi"]
    turned = np.concatenate(([0.0], np.cumsum((r.x[1:] + r.x[:-1]) / 2 * np.diff(r.t))))
    heading = np.interp(r.t, psi.t, psi.x)
    drift = np.polynomial.Polynomial.fit(r.t, heading - heading[0] - turned, 1)
    assert np.max(np.abs(heading - heading[0] - turned - drift(r.t))) < 0.1
    assert np.ptp(turned) > 0.5


@pytest.mark.parametrize("source", [NOMINAL / "run1", DEFAULTS / "run1", DEFAULTS / "run2", STOCK / "run1"])
@pytest.mark.parametrize("channel", ["r", "ay", "p", "vy", "phi"])
def test_both_logs_of_a_drive_agree(source: str, channel: str) -> None:
    flash, telemetry = run(f"{source}.BIN").manoeuvre(channel), run(f"{source}.tlog")[channel]
    if np.std(flash.x) < 0.02:
        assert np.std(telemetry.between(flash.t[0], flash.t[-1]).x) < 0.02
        return
    shifts = np.arange(-0.06, 0.061, 0.002)
    grid = np.arange(flash.t[0] + 0.1, flash.t[-1] - 0.1, 0.02)
    errors = [np.mean((telemetry.on(grid + s) - flash.on(grid)) ** 2) for s in shifts]
    assert abs(shifts[np.argmin(errors)]) <= 0.012
    assert np.corrcoef(telemetry.on(grid), flash.on(grid))[0, 1] > 0.97


PAIR_1 = f"{DEFAULTS / 'run1.BIN'}+{DEFAULTS / 'run1.tlog'}"
PAIR_2 = f"{DEFAULTS / 'run2.tlog'}+{DEFAULTS / 'run2.BIN'}"


@pytest.mark.parametrize(
    ("source", "kind", "amplitude", "speed", "steering"),
    [
        (str(NOMINAL / "run1.BIN"), "sweep", 120, 2.48, "SWEP.Out at the main loop"),
        (str(NOMINAL / "run2.BIN"), "sweep", 240, 2.43, "SWEP.Out at the main loop"),
        (str(NOMINAL / "run3.BIN"), "sweep", 150, 1.60, "SWEP.Out at the main loop"),
        (str(NOMINAL / "run4.BIN"), "doublet", 150, 2.49, "SWEP.Out at the main loop"),
        (str(NOMINAL / "run1.tlog"), "sweep", 120, 2.48, "SERVO_OUTPUT_RAW.servo1_raw"),
        (str(OLDER / "run1.BIN"), "sweep", 150, 2.47, "SWEP.Out at the main loop"),
        (str(OLDER / "run1.tlog"), "sweep", 150, 2.47, "SERVO_OUTPUT_RAW.servo1_raw"),
        (str(OLDER / "run2.BIN"), "doublet", 150, 2.47, "SWEP.Out at the main loop"),
        (str(DEFAULTS / "run1.BIN"), "sweep", 150, 2.48, "RCOU.C1"),
        (str(DEFAULTS / "run1.tlog"), "sweep", 150, 2.48, "SERVO_OUTPUT_RAW.servo1_raw"),
        (PAIR_1, "sweep", 150, 2.48, "SERVO_OUTPUT_RAW.servo1_raw"),
        (PAIR_2, "doublet", 150, 2.5, "SERVO_OUTPUT_RAW.servo1_raw"),
        (str(DEFAULTS / "run2.BIN"), "doublet", 150, 2.5, "RCOU.C1"),
        (f"{NOMINAL / 'run1.BIN'}+{NOMINAL / 'run1.tlog'}", "sweep", 120, 2.48, "SWEP.Out at the main loop"),
        (str(STOCK / "run1.BIN"), "sweep", 150, 3.94, "SWEP.Out at the main loop"),
        (str(STOCK / "run1.tlog"), "sweep", 150, 3.94, "SERVO_OUTPUT_RAW.servo1_raw"),
        (str(STOCK / "run2.BIN"), "doublet", 150, 3.9, "SWEP.Out at the main loop"),
        (str(STOCK / "run2.tlog"), "doublet", 150, 3.9, "SERVO_OUTPUT_RAW.servo1_raw"),
    ],
)
def test_every_run_is_told(source: str, kind: str, amplitude: float, speed: float, steering: str) -> None:
    recording = run(source)
    pwm = recording.manoeuvre("pwm")
    assert recording.kind == kind
    assert (np.max(pwm.x) - np.min(pwm.x)) / 2 == pytest.approx(amplitude, rel=0.03)
    assert recording.mean_speed == pytest.approx(speed, abs=0.05)
    assert pwm.source == steering
    assert pwm.hold == steering.startswith("SWEP")
    assert 7 < recording.span[1] - recording.span[0] - 2 * 3 < 56
    assert any(b - a > 8 for a, b in recording.standstill)
    assert len(recording.straight) == 2
    assert recording.straight[0][1] <= recording.straight[1][0]
    assert abs(recording.bias("r") or 1.0) < 0.01
    assert recording.sources[0][0].startswith("run") and len(recording.sources[0][1]) == 64


@pytest.mark.parametrize(
    ("source", "gyro", "accel"), [(NOMINAL, 20.0, 20.0), (OLDER, 20.0, 20.0), (DEFAULTS, 4.0, 10.0)]
)
def test_filters_are_those_of_the_parameters(source: Path, gyro: float, accel: float) -> None:
    filters = run(str(source / "run1.BIN")).filters
    assert {c: f.cutoff_hz for c, f in filters.items()} == {"r": gyro, "p": gyro, "ay": accel}
    assert filters["r"].source == "INS_GYRO_FILTER"


def test_unknown_filters_are_assumed_in_words_and_can_be_given() -> None:
    assumed = run(str(NOMINAL / "run1.tlog"))
    assert assumed.filters["r"].cutoff_hz == 4.0
    assert any("INS_GYRO_FILTER" in n.text and n.level == "warning" for n in assumed.notes)
    (given,) = read_runs(str(NOMINAL / "run1.tlog"), filters={"gyro_hz": 20, "accel_hz": 0})
    assert {c: f.cutoff_hz for c, f in given.filters.items()} == {"r": 20.0, "p": 20.0}
    assert not any("INS_" in n.text for n in given.notes)


def transform(steering: Signal, w: Array, hold: bool) -> np.ndarray:
    """Fourier integral at w [rad/s] of a staircase, or of the samples as those of a smooth wave."""
    s = steering.between(49.2, 104.2)
    x, k = s.x - 1500, -1j * w[:, None]
    if hold:
        edges = np.append(s.t, 104.2)
        return ((np.exp(k * edges[1:]) - np.exp(k * edges[:-1])) / k) @ x
    return np.exp(k * s.t) @ (x * np.gradient(s.t))


@pytest.mark.parametrize(("source", "held_delay"), [("RCOU", 0.050), ("SERVO_OUTPUT_RAW", 0.010)])
def test_sampled_outputs_are_samples_of_a_smooth_wave(source: str, held_delay: float) -> None:
    """Both streams sample the applet's staircase: taken as samples they agree with it up to 23 rad/s;
    held until the next sample they lag by half an interval."""
    (flash,), (telemetry,) = (read_logs(str(NOMINAL / f"run1.{kind}")) for kind in ("BIN", "tlog"))
    staircase, coarse = flash.steering
    sampled = coarse if source == "RCOU" else telemetry.steering[0]
    assert sampled.source.startswith(source) and not sampled.hold and staircase.hold
    for centre in (5.0, 12.0, 23.0):
        w = np.linspace(centre - 0.4, centre + 0.4, 41)
        true = transform(staircase, w, hold=True)
        for hold, delay in ((False, 0.0), (True, held_delay)):
            ratio = np.vdot(true, transform(sampled, w, hold)) / np.vdot(true, true)
            assert -np.angle(ratio) / centre == pytest.approx(delay, abs=0.003)
            if not hold:
                assert abs(20 * np.log10(abs(ratio))) < 0.3
