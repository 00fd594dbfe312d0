"""Marks for invented answers, and the cases of recorded rovers."""

from __future__ import annotations

from typing import Any

import pytest

from rover_sweep.data.vehicle_file import parse
from tests.foreign.grade import PLACES, grade
from tests.foreign.outside_laws import OUTSIDE_LAWS
from tests.foreign.shared import hidden_ids, vehicle_text
from tests.foreign.summary import line, table, wilson


def said(*findings: tuple[str, tuple[str, ...]], verdict: str = "explained", unknown: bool = False) -> Any:
    named = [{"effect": e, "look_alikes": list(alike), "parameters": {}} for e, alike in findings]
    return {
        "verdict": verdict,
        "sentence": "",
        "findings": named,
        "unknown": {"channel": "r"} if unknown else None,
        "seconds": 3.0,
    }


TWO = ("roll_steer", "tyre_saturation")


@pytest.mark.parametrize(
    ("hidden", "answer", "mark"),
    [
        ((), said(), "none"),
        ((), said(("roll_steer", ())), "wrong"),
        (("roll_steer",), said(("roll_steer", ())), "exact"),
        (("roll_steer",), said(("roll_steer", ()), ("imu_offset", ())), "wrong"),
        (("roll_steer",), said(("tyre_relaxation", ("roll_steer",))), "look-alike"),
        (("roll_steer",), said(("tyre_relaxation", ())), "wrong"),
        (("roll_steer",), said(unknown=True), "unknown"),
        (("roll_steer",), said(), "nothing"),
        (("transport_delay",), said(("servo_lag", ())), "exact"),
        (("tyre_saturation",), said(("load_transfer", ())), "wrong"),
        (("tyre_saturation",), said(("load_transfer", ("tyre_saturation",))), "look-alike"),
        (TWO, said(("tyre_saturation", ()), ("roll_steer", ())), "exact"),
        (TWO, said(("tyre_saturation", ())), "part"),
        (TWO, said(("tyre_saturation", ()), ("load_transfer", ("tyre_saturation",))), "wrong"),
        (TWO, said(("load_transfer", ("tyre_saturation",)), ("roll_steer", ())), "look-alike"),
        (("outside:yaw_drag",), said(unknown=True), "unknown"),
        (("outside:yaw_drag",), said(("roll_steer", ()), unknown=True), "wrong"),
        (("outside:tyre_dead_zone",), said(("steering_deadband", ())), "nearest"),
        (("outside:yaw_drag", "imu_tilt"), said(("imu_tilt", ()), unknown=True), "exact"),
        (("roll_steer",), said(verdict="failed"), "failed"),
    ],
)
def test_marks(hidden: tuple[str, ...], answer: Any, mark: str) -> None:
    assert grade("1", "single", hidden, answer).mark == mark


def test_the_place_of_an_unknown_law_counts_outside_the_list() -> None:
    answer = said(unknown=True)
    assert grade("1", "outside", ("outside:yaw_drag",), answer).placed is False
    answer["unknown"] = {"channel": "r", "law": "yaw moment ~ r^3"}
    graded = grade("1", "outside", ("outside:yaw_drag",), answer)
    assert graded.placed is True and "place right" in table([graded])
    assert "yaw moment ~ r^3" in line(graded, answer)
    assert grade("1", "single", ("roll_steer",), answer).placed is None
    assert set(PLACES) == {law.effect for law in OUTSIDE_LAWS}


def test_a_name_is_counted_once_for_one_hidden_effect() -> None:
    twice = grade("1", "single", ("roll_steer",), said(("roll_steer", ()), ("imu_tilt", ("roll_steer",))))
    assert (twice.first, twice.wrong, twice.missed) == (("roll_steer",), ("imu_tilt",), ())


def test_a_table_counts_every_set_with_its_interval() -> None:
    graded = [grade("1", "none", (), said()), grade("2", "none", (), said(("roll_steer", ())))]
    words = table(graded)
    assert "none: 2 sets" in words
    assert "1/2     50.0 %" in words
    low, high = wilson(1, 2)
    assert 0.05 < low < 0.1 and low == pytest.approx(1 - high)
    assert "roll_steer" in line(graded[1], said(("roll_steer", ())))


def test_cases_of_recorded_rovers() -> None:
    assert hidden_ids({"surface_t": 20.2, "surface_k": 0.7}) == ("surface_change",)
    assert hidden_ids({"cubic": 0.5, "gyro_lp": 4.4}) == ("steering_nonlinearity", "sensor_filter")
    with pytest.raises(KeyError):
        hidden_ids({"moon": 1.0})
    told = {"mass": 2.64, "cg_to_front_axle": 0.2, "cg_to_rear_axle": 0.19, "rad_per_us": 0.00094}
    rover = parse(vehicle_text(told))
    assert rover.steering() == (1500.0, 0.00094)
    assert rover.imu_iso == (0.0, 0.0, -0.06)
