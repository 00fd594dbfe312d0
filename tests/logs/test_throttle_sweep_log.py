"""A throttle sweep in a log of the real firmware: found, not taken for steering, near the truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from rover_sweep.errors import DataRefused
from rover_sweep.identification.identify_speed import identify_speed
from rover_sweep.logs.applet import throttle_runs
from rover_sweep.logs.read import read_logs, read_runs

SWEEP = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "throttle" / "sweep.BIN"
STEERED = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal" / "run1.BIN"


def test_found_with_its_times_and_limits() -> None:
    (log,) = read_logs(str(SWEEP))
    (run,) = throttle_runs(log)
    assert run.span[1] - run.span[0] == pytest.approx(72.0, abs=0.2)
    assert (run.neutral_us, run.travel_us, run.swept, run.stopped) == (1500, 400, pytest.approx((0.2, 8)), "")
    sent = run.pwm.between(*run.span).x
    assert (sent[0], sent.max(), sent.min()) == (1692, 1752, 1632)


def test_is_no_steering_run() -> None:
    with pytest.raises(DataRefused):
        read_runs(str(SWEEP))


def test_steering_run_is_no_throttle_sweep() -> None:
    (log,) = read_logs(str(STEERED))
    assert throttle_runs(log) == ()


def test_truth_is_within_the_intervals() -> None:
    (log,) = read_logs(str(SWEEP))
    result = identify_speed(throttle_runs(log))
    assert result.level == "good" and result.fit is not None
    truth = {"gain": 5.04, "lag": 0.7, "delay": 0.008, "offset": 0.0272}
    for name, true in truth.items():
        low, high = result.fit.intervals[name]
        assert low <= true <= high, name
    assert result.coasting is not None and result.coasting.dead_zone_interval is not None
    low, high = result.coasting.dead_zone_interval
    assert low <= 0.0 <= high
