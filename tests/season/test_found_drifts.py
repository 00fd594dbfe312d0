"""Drifts in prepared days: found with quantity, date and size; none where there is none."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from rover_sweep.season.season import season
from rover_sweep.season.season_result import Drift, Season
from tests.season.prepared_days import ROVER, Course, day_name, vehicle_logs

DAYS = 9
ROVERS = {"rover": ROVER}


def fleet(courses: dict[str, Course], vehicles: int = 6, seed: int = 1, days: int = DAYS) -> Season:
    """A season of `vehicles` rovers, those in `courses` with a change."""
    logs = []
    for v in range(vehicles):
        name = f"rover-{v}"
        logs += vehicle_logs(name, days, 100 * seed + v, courses.get(name, lambda k: {}))
    return season(logs, ROVERS)


def only(found: Season) -> Drift:
    """The one drift of a season."""
    assert len(found.drifts) == 1, [d.sentence for d in found.drifts]
    return found.drifts[0]


def test_worn_tyres_are_gradual() -> None:
    drift = only(fleet({"rover-2": lambda k: {"ln_C": -0.30 * k / (DAYS - 1)}}))
    assert (drift.vehicle, drift.quantity, drift.kind) == ("rover-2", "C", "gradual")
    assert drift.day == day_name(0)
    assert drift.low is not None and drift.high is not None
    assert drift.low < 0.741 < drift.high  # exp(-0.30)


def test_a_bent_linkage_is_a_step_with_its_date() -> None:
    drift = only(fleet({"rover-4": lambda k: {"trim": 0.017 if k >= 5 else 0.0}}))
    assert (drift.quantity, drift.kind, drift.day) == ("steering_trim", "step", day_name(5))
    assert drift.low is not None and drift.high is not None and drift.low < 0.017 < drift.high
    assert f"between {day_name(4)} and {day_name(5)}" in drift.sentence


def test_a_servo_that_slows_from_a_day_on() -> None:
    drift = only(fleet({"rover-1": lambda k: {"lag": 0.008 * max(0, k - 4)}}))
    assert (drift.quantity, drift.kind) == ("servo_lag", "gradual")
    assert drift.earliest <= day_name(4) <= drift.latest


def test_a_drift_of_the_only_vehicle() -> None:
    drift = only(fleet({"rover-0": lambda k: {"trim": 0.02 if k >= 4 else 0.0}}, vehicles=1))
    assert (drift.quantity, drift.day) == ("steering_trim", day_name(4))


@pytest.mark.parametrize("seed", range(2, 5))
def test_nothing_is_invented(seed: int) -> None:
    assert not fleet({}, seed=seed).drifts


def test_more_scatter_is_no_drift() -> None:
    """One rover whose trim jumps from day to day: its own scatter widens its intervals."""
    jumps = random.Random(3)
    course = {"rover-3": lambda k: {"trim": jumps.gauss(0.0, 0.008)}}
    found = fleet(course)
    assert not found.drifts
    trim = {v.name: next(q for q in v.quantities if q.name == "steering_trim") for v in found.vehicles}
    assert trim["rover-3"].scatter > 3 * trim["rover-0"].scatter
    width = {n: q.days[4].high - q.days[4].low for n, q in trim.items()}
    assert width["rover-3"] > 2 * width["rover-0"]


def test_one_odd_day_is_no_change() -> None:
    found = fleet({"rover-2": lambda k: {"trim": 0.02 if k == 8 else 0.0}})
    assert not found.drifts
    shown = [d for v in found.vehicles for d in v.drifts]
    assert [(d.kind, d.quantity, d.day) for d in shown] == [("day", "steering_trim", day_name(8))]


def test_less_than_the_tolerance_is_shown_but_does_not_count() -> None:
    found = fleet({"rover-2": lambda k: {"trim": 0.005 if k >= 4 else 0.0}})
    assert not found.drifts
    small = [d for v in found.vehicles for d in v.drifts]
    assert [(d.quantity, d.matters) for d in small] == [("steering_trim", False)]


def test_the_order_of_the_logs_does_not_matter() -> None:
    logs = [log for v in range(4) for log in vehicle_logs(f"rover-{v}", DAYS, v)]
    mixed = list(logs)
    random.Random(1).shuffle(mixed)
    assert season(mixed, ROVERS) == season(logs, ROVERS)


def test_a_changed_parameter_is_found_and_explains_a_step() -> None:
    logs = [log for v in range(4) for log in vehicle_logs(f"rover-{v}", DAYS, v)]
    logs += vehicle_logs(
        "rover-9",
        DAYS,
        9,
        lambda k: {"trim": 0.02 if k >= 5 else 0.0},
        lambda k: {"SERVO1_TRIM": 1520.0 if k >= 5 else 1500.0, "STAT_RUNTIME": 100.0 * k},
    )
    found = season(logs, ROVERS)
    drift = only(found)
    assert (drift.kind, drift.quantity, drift.day) == ("parameter", "SERVO1_TRIM", day_name(5))
    step = next(d for v in found.vehicles for d in v.drifts if d.kind == "step")
    assert step.quantity == "steering_trim" and "SERVO1_TRIM" in step.cause
    assert [p.name for p in step.parameters] == ["SERVO1_TRIM"]


def test_a_swapped_board_of_a_named_vehicle() -> None:
    logs = vehicle_logs("rover-1", DAYS, 1, board=lambda k: "Cube B" if k >= 3 else "Cube A")
    drift = only(season(logs, ROVERS))
    assert (drift.kind, drift.day) == ("board", day_name(3))
    assert "Cube A" in drift.sentence and "Cube B" in drift.sentence


def test_few_days_show_no_drift_and_say_so() -> None:
    found = season(vehicle_logs("rover-1", 3, 1), ROVERS)
    assert not found.drifts and "3 day(s)" in found.vehicles[0].remarks[0]
    assert found.sentence.startswith("no drift was searched")


def test_a_refused_log_is_in_the_summary() -> None:
    logs = vehicle_logs("rover-1", 4, 1)
    logs[2] = replace(logs[2], fit=None, refused="2.BIN is empty")
    found = season(logs, ROVERS)
    assert found.refused == (("logs/rover-1/2.BIN", "2.BIN is empty"),)
    assert "3 of 4 logs" in found.sentence and len(found.vehicles[0].logs) == 3
