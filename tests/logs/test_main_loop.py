"""Commands are time-stamped at the main loop that applied them."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import APPLET, NOMINAL

from rover_sweep.data.recording import AT_LOOP, Array, Signal
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers.vehicle_clock import at_main_loops, main_loops

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


def exact(pwm: Signal, truth: dict[str, Array], start: float) -> bool:
    """Whether a staircase is that of the plant for 3 s, at a fixed offset of the plant's clock."""
    for offset in np.arange(0.0, 0.1, 0.001):
        t = truth["t"] - offset
        inside = (t > start) & (t < start + 3.0)
        at = np.searchsorted(pwm.t, t[inside], "right") - 1
        if np.array_equal(pwm.x[at], truth["pwm"][inside]):
            return True
    return False


def test_the_plant_got_the_pwm_when_the_recording_says() -> None:
    """truth.csv holds what the physics behind the real firmware got, every 20 ms of its own clock, which
    jumps by a loop now and then against the vehicle's."""
    table = np.genfromtxt(NOMINAL / "truth.csv", delimiter=",", names=True)
    truth = {name: table[name] for name in ("t", "pwm")}
    (log,), (run,) = read_logs(str(NOMINAL / "run1.BIN")), read_runs(str(NOMINAL / "run1.BIN"))
    fast = np.arange(run.span[1] - 27.0, run.span[1] - 6.0, 3.0)
    assert np.mean([exact(run["pwm"], truth, at) for at in fast]) > 0.7
    assert np.mean([exact(log.steering[0], truth, at) for at in fast]) < 0.3


def test_the_applets_recordings_stand_on_the_loops() -> None:
    (run,) = read_runs(str(APPLET / "run1.BIN"))
    pwm = run.manoeuvre("pwm")
    assert np.isin(pwm.t[1:], run["r"].t).mean() > 0.99  # the IMU's stamps
