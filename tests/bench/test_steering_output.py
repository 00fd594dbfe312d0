"""A bench on firmware 4.7 and later, whose ground station's id has another name."""

from __future__ import annotations

import pytest

from rover_sweep.bench.steering_output import names_of, steering_output
from rover_sweep.errors import UsageError

COMMON = {
    "RC_OVERRIDE_TIME": 3.0,
    "SERVO1_FUNCTION": 26.0,
    **{
        f"SERVO1_{name}": value
        for name, value in (("TRIM", 1500), ("MIN", 1100), ("MAX", 1900), ("REVERSED", 0))
    },
    **{f"RC1_{name}": value for name, value in (("TRIM", 1500), ("MIN", 1100), ("MAX", 1900), ("DZ", 30))},
    "RC1_REVERSED": 0.0,
    "RC3_TRIM": 1500.0,
    "RC3_DZ": 30.0,
}


def test_the_new_name_is_asked_for_where_the_old_one_is_missing() -> None:
    assert {"MAV_GCS_SYSID", "MAV_GCS_SYSID_HI"} <= set(names_of(COMMON))
    assert "MAV_GCS_SYSID" not in names_of(COMMON | {"SYSID_MYGCS": 255.0})


def test_a_rover_of_4_7_is_benched_where_it_hears_us() -> None:
    assert steering_output(COMMON | {"MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 0.0}).servo == 1
    with pytest.raises(UsageError, match="MAV_GCS_SYSID is 250"):
        steering_output(COMMON | {"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 0.0})


def test_a_rover_that_tells_neither_name_is_refused() -> None:
    with pytest.raises(UsageError, match="did not report MAV_GCS_SYSID, MAV_GCS_SYSID_HI"):
        steering_output(COMMON)
