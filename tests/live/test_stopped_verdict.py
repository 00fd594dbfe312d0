"""A run that was stopped: what to change before it is driven again, and by how much."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from asked_source import SETTINGS, Asked

from rover_sweep.live.source import DriveRequest, Judged
from rover_sweep.live.verdict import stopped_verdict
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.folder import read_folder
from rover_sweep.session.session import SessionRun
from rover_sweep.tui.model.setup import records
from sitl import launcher
from tests.vehicle.simulated_drive import READY

PLANNED = SessionRun("sweep1", Sweep(), 2.0)
TLOG = Path("sweep1.tlog")


@pytest.mark.parametrize("reason", ["speed 4.0 > 4 m/s", "speed 4.02 m/s is above SWP_V_MAX 4"])
@pytest.mark.parametrize(
    ("throttle", "neutral", "lower"), [(1600, 1500, 1550), (1300, 1500, 1400), (1400, 1100, 1250)]
)
def test_a_throttle_that_is_too_high_is_lowered_towards_neutral(reason, throttle, neutral, lower):
    verdict = stopped_verdict(PLANNED, reason, TLOG, throttle, neutral)
    assert (
        verdict.advice == "repeat"
        and f"the speed passed SWP_V_MAX 4 m/s: the throttle of {throttle} us" in verdict.sentence
    )
    assert "too high for 2 m/s" in verdict.sentence
    assert verdict.throttle is not None and verdict.throttle[0] == throttle
    assert verdict.throttle[1] == pytest.approx(lower, abs=1)
    assert abs(verdict.throttle[1] - neutral) < abs(throttle - neutral)


def test_a_planned_speed_at_the_limit_is_not_aimed_at() -> None:
    at_limit = SessionRun("sweep1", Sweep(), 4.0)
    verdict = stopped_verdict(at_limit, "speed 4.0 > 4 m/s", TLOG, 1600, 1500)
    assert verdict.throttle == (1600, 1580) and "too high for 3.2 m/s" in verdict.sentence


def test_a_neutral_that_is_not_known_gives_no_number() -> None:
    verdict = stopped_verdict(PLANNED, "speed 4.0 > 4 m/s", TLOG, 1600)
    assert verdict.throttle is None and "the throttle of 1600 us is too high" in verdict.sentence


def test_the_pilot_is_told_to_drive_slower() -> None:
    verdict = stopped_verdict(PLANNED, "speed 4.0 > 4 m/s", TLOG)
    assert verdict.throttle is None
    assert verdict.sentence.endswith("passed SWP_V_MAX 4 m/s: drive it again with less throttle, at 2 m/s")


@pytest.mark.parametrize("reason", ["roll 31.0 > 30 deg", "speed 0.4 < 0.5 m/s", "speed unknown", "aborted"])
def test_any_other_reason_is_as_it_was(reason: str) -> None:
    verdict = stopped_verdict(PLANNED, reason, TLOG, 1600, 1500)
    assert verdict.throttle is None
    assert verdict.sentence == f"it did not come to its end ({reason}): drive it again"


def test_a_rover_that_is_too_fast_gives_the_lower_throttle_and_it_is_kept(tmp_path: Path) -> None:
    """At 1710 us the embedded rover reaches 2.4 m/s; the throttle's trim is read from it."""
    folder = tmp_path / "s"
    extra = {**SETTINGS.extra, "v_max": 1.5, "v_min": 0.5}
    settings = replace(SETTINGS, extra=extra)
    planned = SessionRun("sweep1", Sweep(amplitude=120, w_min=2, w_max=20, t_rec=10, straight=1), 1.2)
    with (
        launcher.start_embedded(tmp_path / "vehicle", options=READY, speedup=8) as rover,
        Asked(folder) as asked,
    ):
        asked.connect(rover.connection)
        asked.source.ask(DriveRequest(planned, settings))
        verdict = asked.wait(Judged).verdict
    assert "the throttle of 1710 us is too high for 1.2 m/s" in verdict.sentence
    assert verdict.throttle is not None
    assert 1500 + 0.4 * 210 < verdict.throttle[1] <= 1500 + 0.8 * 210
    (record,) = records(read_folder(folder), folder)
    assert record.verdict is not None and record.verdict.throttle == verdict.throttle
