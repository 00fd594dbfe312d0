"""Drifts of vehicles over their days, found by prepared likelihoods."""

from __future__ import annotations

import json
import os
import random
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest

from rover_sweep.logs.read import recorded_day
from rover_sweep.season.season import season
from rover_sweep.season.season_result import (
    Drift,
    MeasuredLog,
    Season,
    as_document,
    by_vehicle,
    days_of,
    from_document,
)
from sitl.flash_log.dataflash_writer import HEAD, DataFlashWriter, encoded
from sitl.flash_log.formats import FORMATS
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


def test_a_servo_that_slows_from_a_day_on_and_a_drift_of_the_only_vehicle() -> None:
    drift = only(fleet({"rover-1": lambda k: {"lag": 0.008 * max(0, k - 4)}}))
    assert (drift.quantity, drift.kind) == ("servo_lag", "gradual")
    assert drift.earliest <= day_name(4) <= drift.latest
    drift = only(fleet({"rover-0": lambda k: {"trim": 0.02 if k >= 4 else 0.0}}, vehicles=1))
    assert (drift.quantity, drift.day) == ("steering_trim", day_name(4))


@pytest.mark.parametrize("seed", range(2, 4))
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


# ---- Which logs are of one vehicle.


def log(source: str, day: int, board: str = "", **more: str) -> MeasuredLog:
    """A log of a day in March."""
    return MeasuredLog(source, source, f"2026-03-{day:02d}", "GPS", board, **more)


@pytest.mark.parametrize(
    ("logs", "vehicles"),
    [
        ([log("a/1.BIN", 1, "A"), log("b/2.BIN", 2, "B"), log("c/3.BIN", 3, "A")], {"A": 2, "B": 1}),
        ([log(f"all/{k}.BIN", k, "A" if k % 2 else "B") for k in range(1, 7)], {"A": 3, "B": 3}),  # in turn
        ([log(f"van/{k}.BIN", k, "A" if k < 4 else "B") for k in range(1, 7)], {"van": 6}),  # a swap
        ([log(f"x/{k}.BIN", k, "AB"[k - 1], vehicle="rover-7") for k in (1, 2)], {"rover-7": 2}),
        (
            [log("van/1.tlog", 1, system="1"), log("van/2.tlog", 2, system="2"), log("car/3.BIN", 3)],
            {"car": 1, "van system 1": 1, "van system 2": 1},
        ),
    ],
)
def test_vehicle_file_board_folder_and_system_say_which_vehicle_it_is(
    logs: list[MeasuredLog], vehicles: dict[str, int]
) -> None:
    assert {name: len(own) for name, own in by_vehicle(logs).items()} == vehicles


def test_a_copy_of_a_log_counts_once_and_logs_of_one_day_add_up() -> None:
    first, second = vehicle_logs("rover-1", 2, 1)
    copy = replace(first, source="logs/rover-1/again.BIN")
    assert [len(d.logs) for d in days_of([first, copy, second])] == [1, 1]
    (day,) = days_of([first, replace(second, day=first.day)])
    assert first.fit is not None and second.fit is not None
    assert (day.linear == first.fit.linear + second.fit.linear).all()


def test_saved_values_come_back_exactly() -> None:
    first = vehicle_logs("rover-1", 1, 1, parameters=lambda k: {"INS_GYRO_FILTER": 0.1})[0]
    again = from_document(json.loads(json.dumps(as_document(first))))
    assert first.fit is not None and again.fit is not None
    assert (again.fit.information == first.fit.information).all()
    assert as_document(again) == as_document(first)


# ---- The day of a log.


def flash(path: Path) -> Path:
    """A .BIN without a message but its formats."""
    with path.open("wb") as file:
        DataFlashWriter(file, FORMATS)
    return path


def gps_message(t: float, day: date) -> bytes:
    """A GPS message with the date at noon."""
    since = datetime(day.year, day.month, day.day, 12, tzinfo=UTC) - datetime(1980, 1, 6, tzinfo=UTC)
    week, rest = divmod(since, timedelta(weeks=1))
    fmt = FORMATS["GPS"]
    values = (round(t * 1e6), 0, 3, round(rest.total_seconds() * 1000), week, 12, 0.8)
    values += (-35.36, 149.16, 584.0, 0.0, 0.0, 0.0, 0.0, 0)
    packed = fmt.packer.pack(*(encoded(c, v) for c, v in zip(fmt.codes, values, strict=True)))
    return HEAD + bytes([fmt.type]) + packed


def test_the_day_is_that_of_gps_then_of_the_name_then_of_the_file(tmp_path: Path) -> None:
    path = flash(tmp_path / "2020-01-01.BIN")
    with path.open("ab") as file:
        file.write(gps_message(10.0, date(2026, 4, 12)))
    assert recorded_day(path) == ("2026-04-12", "GPS")
    path = flash(tmp_path / "2026-04-12 10-33-21.bin")
    assert recorded_day(path) == ("2026-04-12", "file name")
    assert recorded_day(path, "s3://fleet/20260413/7.BIN") == ("2026-04-13", "file name")
    assert recorded_day(path, "s3://fleet/7.BIN") == ("", "")
    path = flash(tmp_path / "00000007.BIN")
    os.utime(path, (1_775_000_000, 1_775_000_000))
    assert recorded_day(path) == ("2026-03-31", "file time")


def test_a_telemetry_log_has_its_own_clock(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes((1_775_000_000_000_000).to_bytes(8, "big") + b"\xfd")
    assert recorded_day(path) == ("2026-03-31", "telemetry")
