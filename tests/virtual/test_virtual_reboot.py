"""A rover that loses its power in a run is said to have rebooted; a run that the applet stops is not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from virtual_faults import disarmed, power_lost
from virtual_faults import weather as link_weather
from virtual_pipe import FAIR, Weather
from virtual_run import played, session_played
from virtual_world import At, Phase

from rover_sweep.vehicle.link.connection import VehicleClock
from rover_sweep.vehicle.run.follow import RebootWatch


@pytest.mark.parametrize("phase", ["waiting", "straight", "sweep"])
def test_a_reboot_is_called_a_reboot(tmp_path: Path, phase: Phase) -> None:
    outcome = played(tmp_path, [(At(phase, 0.5), power_lost(2.0))], after=1.0, limit=60.0)
    assert outcome.fired and outcome.finished is not None and not outcome.finished.completed
    assert outcome.finished.reason.startswith("the rover rebooted in run 1; check its power supply")
    assert "stopped by the applet" not in outcome.said


def test_a_run_that_the_applet_stops_is_no_reboot(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("sweep", 0.5), disarmed())], after=1.0, limit=60.0)
    assert outcome.finished is not None and "disarmed" in outcome.finished.reason
    assert "rebooted" not in outcome.said


def test_only_a_run_that_was_not_whole_before_is_ended_by_a_reboot() -> None:
    clock = VehicleClock(now=100.0, known=True)
    watch = RebootWatch.since_now(clock)
    assert watch.outcome(3, (False, "why")) == (False, "why")
    clock.boots += 1
    assert watch.outcome(3, (False, "why"))[1].startswith("the rover rebooted in run 3")
    assert watch.outcome(3, (True, "whole")) == (True, "whole")


@pytest.mark.parametrize("weather", [FAIR, Weather(drop=0.1)])
def test_a_poor_link_is_named_after_the_run(tmp_path: Path, weather: Weather) -> None:
    bad = weather is not FAIR
    happenings = [(At("straight"), link_weather("10 % lost", weather))] if bad else []
    outcome = session_played(tmp_path, happenings, after=1.0, back=1.0)
    assert outcome.finished is not None
    assert (re.search(r"after sweep1: the link loses \d+% of the frames", outcome.said) is not None) == bad
