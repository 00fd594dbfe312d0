"""Channels of the recordings against what the simulated vehicle really did, and against each other."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from recordings import APPLET, DATA, DEFAULTS, NOMINAL, OLDER, STOCK
from scipy import signal

import rover_sweep as rs
from rover_sweep.data.recording import AT_LOOP, Array, Recording, Signal
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers.dataflash import index
from rover_sweep.logs.readers.vehicle_clock import at_main_loops, main_loops
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep


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


@pytest.mark.parametrize("source", [NOMINAL_RUNS[0], NOMINAL_RUNS[3], str(NOMINAL / "run1.tlog")])
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


PAIR_1 = f"{DEFAULTS / 'run1.BIN'}+{DEFAULTS / 'run1.tlog'}"
PAIR_2 = f"{DEFAULTS / 'run2.tlog'}+{DEFAULTS / 'run2.BIN'}"


@pytest.mark.parametrize(
    ("source", "kind", "amplitude", "speed", "steering"),
    [
        (str(NOMINAL / "run1.BIN"), "sweep", 120, 2.48, "SWEP.Out at the main loop"),
        (str(NOMINAL / "run2.BIN"), "sweep", 240, 2.43, "SWEP.Out at the main loop"),
        (str(NOMINAL / "run4.BIN"), "doublet", 150, 2.49, "SWEP.Out at the main loop"),
        (str(NOMINAL / "run1.tlog"), "sweep", 120, 2.48, "SERVO_OUTPUT_RAW.servo1_raw"),
        (str(OLDER / "run1.BIN"), "sweep", 150, 2.47, "SWEP.Out at the main loop"),
        (str(DEFAULTS / "run1.BIN"), "sweep", 150, 2.48, "RCOU.C1"),
        (str(DEFAULTS / "run1.tlog"), "sweep", 150, 2.48, "SERVO_OUTPUT_RAW.servo1_raw"),
        (PAIR_1, "sweep", 150, 2.48, "SERVO_OUTPUT_RAW.servo1_raw"),
        (PAIR_2, "doublet", 150, 2.5, "SERVO_OUTPUT_RAW.servo1_raw"),
        (f"{NOMINAL / 'run1.BIN'}+{NOMINAL / 'run1.tlog'}", "sweep", 120, 2.48, "SWEP.Out at the main loop"),
        (str(STOCK / "run1.BIN"), "sweep", 150, 3.94, "SWEP.Out at the main loop"),
        (str(STOCK / "run1.tlog"), "sweep", 150, 3.94, "SERVO_OUTPUT_RAW.servo1_raw"),
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


# ---- Commands are time-stamped at the main loop that applied them.

LOOPS = np.arange(0.0, 0.1, 0.01)


def staircase(*t: float) -> Signal:
    return Signal(np.array(t), 1500.0 + np.arange(len(t)), "us", "SWEP.Out", hold=True)


def test_a_command_waits_for_the_next_loop_and_one_set_with_it_does_not() -> None:
    found = at_main_loops(staircase(0.001, 0.0199, 0.03), LOOPS)
    assert found.t == pytest.approx([0.01, 0.02, 0.03]) and found.source == f"SWEP.Out {AT_LOOP}"
    assert found.x.tolist() == [1500, 1501, 1502]


def test_of_two_commands_between_two_loops_only_the_last_gets_out() -> None:
    found = at_main_loops(staircase(0.011, 0.018, 0.022), LOOPS)
    assert found.t == pytest.approx([0.02, 0.03]) and found.x.tolist() == [1501, 1502]


def test_where_no_loop_was_logged_a_command_waits_half_a_period() -> None:
    holed = np.concatenate((LOOPS[:3], LOOPS[8:]))
    found = at_main_loops(staircase(0.012, 0.04, 0.075, 0.2), holed)
    assert found.t == pytest.approx([0.02, 0.045, 0.08, 0.205])


def test_loops_whose_message_was_dropped_are_put_in() -> None:
    stamps = np.concatenate((LOOPS[:3], LOOPS[5:], LOOPS + 1.0))
    found = main_loops(stamps, {"SCHED_LOOP_RATE": 100.0})
    assert found is not None and found == pytest.approx(np.concatenate((LOOPS, LOOPS + 1.0)))


def test_samples_of_an_output_and_unknown_loops_leave_it_as_it_is() -> None:
    sampled = Signal(np.array([0.001, 0.1]), np.array([1500.0, 1510.0]), "us", "RCOU.C1")
    assert at_main_loops(sampled, LOOPS) is sampled
    commands = staircase(0.001, 0.0199)
    assert at_main_loops(commands, None) is commands


@pytest.mark.parametrize(("rate", "known"), [(100.0, True), (50.0, False), (0.0, False)])
def test_the_loops_are_known_where_each_was_logged(rate: float, known: bool) -> None:
    assert (main_loops(LOOPS, {"SCHED_LOOP_RATE": rate}) is not None) == known
    assert main_loops(LOOPS, {}) is None and main_loops(LOOPS[:1], {"SCHED_LOOP_RATE": 100.0}) is None


# ---- Recordings of this project's own applet on the real firmware: its states, its wave, and what comes out.

SWEEP, DOUBLET = Sweep(amplitude=150, t_rec=55), Doublet(amplitude=150)
TRUE_C, TRUE_IZZ = (31.0 + 33.5) / 2, 0.071
RUNS: tuple[tuple[str, Manoeuvre, int], ...] = (("run1.BIN", SWEEP, 1), ("run2.BIN", DOUBLET, 2))


@pytest.mark.parametrize(("name", "manoeuvre", "number"), RUNS)
def test_wave_on_the_firmware_is_the_closed_form(name: str, manoeuvre: Manoeuvre, number: int) -> None:
    """In ArduPilot's single floats: 0.1 us in the wish, a whole microsecond on the servo."""
    rows = index(np.fromfile(APPLET / name, np.uint8)).rows("SWEP")
    rows = rows[(rows["St"] >= 3) & (rows["St"] <= 8)]
    assert set(rows["Run"]) == {number} and rows["T"][0] == pytest.approx(0, abs=0.002)
    t = rows["T"].astype(float)
    steps = np.zeros(t.size, bool)
    if isinstance(manoeuvre, Doublet):  # a step may fall on the other side of a time rounded to a float
        steps = np.abs(manoeuvre.wave(t + 1e-5) - manoeuvre.wave(t - 1e-5)) > 1
    assert np.count_nonzero(steps) < 5
    t, rows = t[~steps], rows[~steps]
    np.testing.assert_allclose(rows["Cmd"] - 1500.0, manoeuvre.wave(t), atol=0.1)
    np.testing.assert_allclose(rows["Out"] - 1500.0, manoeuvre.wave(t), atol=0.6)


def test_the_true_tyres_and_yaw_inertia_come_out_of_telemetry() -> None:
    runs = rs.read(str(APPLET / "run1.tlog"), str(APPLET / "run2.BIN"), vehicle=str(DATA / "rover.toml"))
    model = rs.identify(runs, models=["roll-yaw"], bootstrap=0).models["roll-yaw"]
    axles = [one.value for one in model.fit.estimates if one.name in ("C", "Cf", "Cr")]
    assert np.mean(axles) == pytest.approx(TRUE_C, rel=0.10)
    assert model.fit["Izz"].value == pytest.approx(TRUE_IZZ, rel=0.10)
    (verification,) = model.verification
    assert verification.tic < 0.07
