"""Whose overrides a rover hears, by the parameters of both generations of firmware."""

from __future__ import annotations

import pytest

from rover_sweep.vehicle.link.greeting import why_overrides_ignored


@pytest.mark.parametrize(
    "have",
    [
        {},
        {"SYSID_MYGCS": 255.0},
        {"MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 0.0},
        {"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 255.0},
        {"MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 255.0},
    ],
)
def test_our_overrides_are_heard(have: dict[str, float]) -> None:
    assert why_overrides_ignored(have) == ""


@pytest.mark.parametrize(
    ("have", "told"),
    [
        ({"SYSID_MYGCS": 250.0}, "SYSID_MYGCS is 250: "),
        ({"MAV_GCS_SYSID": 245.0, "MAV_GCS_SYSID_HI": 0.0}, "MAV_GCS_SYSID is 245: "),
        ({"MAV_GCS_SYSID": 1.0, "MAV_GCS_SYSID_HI": 254.0}, "MAV_GCS_SYSID is 1 and MAV_GCS_SYSID_HI 254: "),
    ],
)
def test_ignored_overrides_are_named_with_the_parameter(have: dict[str, float], told: str) -> None:
    sentence = why_overrides_ignored(have)
    assert sentence.startswith(told)
    assert "this one is 255" in sentence
