"""Recordings of this project's own applet on the real firmware: its states, its wave, and what comes out."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from recordings import APPLET, DATA

import rover_sweep as rs
from rover_sweep.data.recording import Recording
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers.dataflash import index
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep

SWEEP, DOUBLET = Sweep(amplitude=150, t_rec=55), Doublet(amplitude=150)
TRUE_C, TRUE_IZZ = (31.0 + 33.5) / 2, 0.071
MESSAGES = {"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER", "MODE", "ARM", "EV"}
MESSAGES |= {"IMU", "ATT", "XKF1", "RCOU", "RCIN", "GPS", "DSF", "SWEP"}
STILL = 3.0  # s, SWP_STILL
TURN = 0.05  # s within which the applet sees that a state is over
RUNS: tuple[tuple[str, Manoeuvre, int], ...] = (("run1.BIN", SWEEP, 1), ("run2.BIN", DOUBLET, 2))
LENGTHS = {
    "run1.BIN": {1: STILL, 3: 3.0, 4: 2.0, 5: 2.0, 6: 55.0, 7: 2.0, 8: 3.0},
    "run2.BIN": {1: STILL, 3: 3.0, 6: 8.0, 8: 3.0},
}


@cache
def run(source: str) -> Recording:
    (found,) = read_runs(source)
    return found


@cache
def spans(name: str) -> dict[int, tuple[float, float]]:
    """First and last row [s] of each state of the applet."""
    (log,) = read_logs(str(APPLET / name))
    assert log.applet is not None
    t, state = log.applet.t, log.applet.state
    assert np.all(np.diff(state) >= 0), "states went back"
    return {int(s): (float(t[state == s][0]), float(t[state == s][-1])) for s in np.unique(state)}


@pytest.mark.parametrize(("name", "manoeuvre", "number"), RUNS)
def test_the_applet_went_through_its_states(name: str, manoeuvre: Manoeuvre, number: int) -> None:
    seen, lengths = spans(name), LENGTHS[name]
    assert set(seen) == set(lengths) | {2, 9}
    for state, seconds in lengths.items():
        begin, end = seen[state]
        assert end - begin == pytest.approx(seconds, abs=TURN), state
    assert seen[9][1] - seen[9][0] > STILL - TURN
    (log,) = read_logs(str(APPLET / name))
    said = [text.removeprefix(f"SWP: run {number} ") for _, text in log.marks if text.startswith("SWP: run")]
    assert said[2:] == [f"start {manoeuvre.kind}", "steering is yours: stop", "done"]


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


def test_clock_of_the_wave_is_that_of_the_log() -> None:
    rows = index(np.fromfile(APPLET / "run1.BIN", np.uint8)).rows("SWEP")
    rows = rows[(rows["St"] >= 3) & (rows["St"] <= 8)]
    stamps = rows["TimeUS"].astype(float) * 1e-6
    late = stamps - stamps[0] - (rows["T"] - rows["T"][0])
    assert np.median(np.abs(late)) < 0.001 and np.max(np.abs(late)) < 0.02
    assert np.max(np.diff(stamps)) < 0.1, "the override ran out in between"


@pytest.mark.parametrize(("name", "manoeuvre", "number"), RUNS)
def test_run_is_found_with_standstill_straight_stretches_and_filters(
    name: str, manoeuvre: Manoeuvre, number: int
) -> None:
    found, seen = run(str(APPLET / name)), spans(name)
    assert found.kind == manoeuvre.kind and found.notes == ()
    assert seen[3][0] - TURN <= found.span[0] <= seen[3][1] + TURN
    assert seen[8][0] - TURN <= found.span[1] <= seen[8][1] + TURN
    before, after = found.standstill
    assert before[0] <= seen[1][0] + TURN and before[1] >= seen[1][1] - TURN
    assert after[1] >= seen[9][1] - 0.5 and after[1] - after[0] > STILL - 0.5
    for stretch, state in zip(found.straight, (3, 8), strict=True):
        assert seen[state][0] - TURN <= stretch[0] < stretch[1] <= seen[state][1] + TURN
        assert stretch[1] - stretch[0] > 1.5
    assert {c: f.cutoff_hz for c, f in found.filters.items()} == {"r": 20.0, "p": 20.0, "ay": 20.0}
    assert found.mean_speed == pytest.approx(2.21, abs=0.03)
    pwm = found.manoeuvre("pwm")
    assert pwm.source == "SWEP.Out at the main loop" and pwm.hold
    assert np.ptp(pwm.x) == pytest.approx(300, abs=4)


def test_telemetry_tells_the_same_run() -> None:
    flash, telemetry = run(str(APPLET / "run1.BIN")), run(str(APPLET / "run1.tlog"))
    assert telemetry.kind == "sweep" and telemetry.notes == ()
    assert telemetry.span == pytest.approx(flash.span, abs=0.5)
    assert {c: f.cutoff_hz for c, f in telemetry.filters.items()} == {"r": 20.0, "p": 20.0, "ay": 20.0}
    for channel in ("r", "ay", "p"):
        one, other = flash.manoeuvre(channel), telemetry[channel]
        grid = np.arange(one.t[0] + 0.1, one.t[-1] - 0.1, 0.02)
        assert np.corrcoef(one.on(grid), other.on(grid))[0, 1] > 0.97


@pytest.mark.parametrize("source", ["run1.BIN", "run1.tlog"])
def test_the_true_tyres_and_yaw_inertia_come_out(source: str) -> None:
    runs = rs.read(str(APPLET / source), str(APPLET / "run2.BIN"), vehicle=str(DATA / "rover.toml"))
    model = rs.identify(runs, models=["roll-yaw"]).models["roll-yaw"]
    assert model.fit is not None
    axles = [one.value for one in model.fit.estimates if one.name in ("C", "Cf", "Cr")]
    assert np.mean(axles) == pytest.approx(TRUE_C, rel=0.10)
    assert model.fit["Izz"].value == pytest.approx(TRUE_IZZ, rel=0.10)
    (verification,) = model.verification
    assert verification.tic < 0.07


def test_recordings_are_small_and_hold_nothing_else() -> None:
    for name, _, _ in RUNS:
        path = APPLET / name
        log = index(np.fromfile(path, np.uint8))
        assert path.stat().st_size < 2.5e6
        assert {n for n in log.formats if log.count(n)} <= MESSAGES
        assert log.bad_bytes == 0
