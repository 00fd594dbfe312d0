"""Which logs are of one vehicle."""

from __future__ import annotations

import json
from dataclasses import replace

from rover_sweep.season.season_result import MeasuredLog, as_document, by_vehicle, days_of, from_document
from tests.season.prepared_days import vehicle_logs


def log(source: str, day: int, board: str = "", **more: str) -> MeasuredLog:
    """A log of a day in March."""
    return MeasuredLog(source, source, f"2026-03-{day:02d}", "GPS", board, **more)


def test_the_board_is_the_vehicle() -> None:
    found = by_vehicle([log("a/1.BIN", 1, "A"), log("b/2.BIN", 2, "B"), log("c/3.BIN", 3, "A")])
    assert {name: len(own) for name, own in found.items()} == {"A": 2, "B": 1}


def test_boards_in_turn_in_one_folder_are_vehicles() -> None:
    logs = [log(f"all/{k}.BIN", k, "A" if k % 2 else "B") for k in range(1, 7)]
    assert {name: len(own) for name, own in by_vehicle(logs).items()} == {"A": 3, "B": 3}


def test_boards_one_after_the_other_in_one_folder_are_a_swap() -> None:
    logs = [log(f"van/{k}.BIN", k, "A" if k < 4 else "B") for k in range(1, 7)]
    assert {name: len(own) for name, own in by_vehicle(logs).items()} == {"van": 6}


def test_the_vehicle_file_decides_before_the_board() -> None:
    logs = [log("x/1.BIN", 1, "A", vehicle="rover-7"), log("x/2.BIN", 2, "B", vehicle="rover-7")]
    assert list(by_vehicle(logs)) == ["rover-7"]


def test_without_a_board_the_folder_and_the_system_are_the_vehicle() -> None:
    logs = [log("van/1.tlog", 1, system="1"), log("van/2.tlog", 2, system="2"), log("car/3.BIN", 3)]
    assert list(by_vehicle(logs)) == ["car", "van system 1", "van system 2"]


def test_a_copy_of_a_log_counts_once() -> None:
    logs = vehicle_logs("rover-1", 2, 1)
    copy = replace(logs[0], source="logs/rover-1/again.BIN")
    days = days_of([logs[0], copy, logs[1]])
    assert [len(d.logs) for d in days] == [1, 1]


def test_logs_of_one_day_add_up() -> None:
    first, second = vehicle_logs("rover-1", 2, 1)
    day = days_of([first, replace(second, day=first.day)])
    assert len(day) == 1 and first.fit is not None and second.fit is not None
    assert (day[0].linear == first.fit.linear + second.fit.linear).all()


def test_saved_values_come_back_exactly() -> None:
    first = vehicle_logs("rover-1", 1, 1, parameters=lambda k: {"INS_GYRO_FILTER": 0.1})[0]
    again = from_document(json.loads(json.dumps(as_document(first))))
    assert first.fit is not None and again.fit is not None
    assert (again.fit.information == first.fit.information).all()
    assert as_document(again) == as_document(first)
