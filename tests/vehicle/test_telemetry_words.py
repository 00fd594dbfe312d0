"""What is said of a run's telemetry: how it came, its clock, and whether it is identified from."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from rover_sweep.logs.readers.vehicle_clock import dropped_messages
from rover_sweep.vehicle.link.streams import StreamQuality
from rover_sweep.vehicle.preflight.rates import telemetry_words
from rover_sweep.vehicle.preflight.read_rover import ClockComparison
from rover_sweep.vehicle.preflight.readiness import arrival_clock

FIRMWARE = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"
SPAN = (50.0, 100.0)  # s, within the sweep of run1
GOOD = (
    StreamQuality("ATTITUDE", 3000, 50.0, 1.2, 41.0, 0.0, 50.0),
    StreamQuality("RAW_IMU", 2990, 50.0, 1.4, 60.0, 0.003, 49.8),
)
POOR = (GOOD[0], StreamQuality("RAW_IMU", 1500, 50.0, 20.0, 420.0, 0.1, 45.0))
GRANTED = {"ATTITUDE": 50.0, "RAW_IMU": 50.0}
CLOCK = ClockComparison(60.0, 1.0, 0.007, 4e-5, 1e-5)


def test_a_good_telemetry_would_do_and_the_log_is_taken() -> None:
    assert telemetry_words(GOOD, GRANTED, CLOCK, logs=True) == (
        "telemetry: 50 Hz, jitter 1.4 ms, longest gap 60 ms, 0.3% lost, arrival within 7 ms of the rover's "
        "clock, drift +40 ppm; the run is identified from the rover's log, once it is fetched (the telemetry "
        "would also be good enough)"
    )
    without = telemetry_words(GOOD, GRANTED, None, logs=False)
    assert without.endswith("lost; the run is identified from the telemetry, because the log is not fetched")


def test_a_poor_one_says_what_is_wrong_and_that_the_log_is_needed() -> None:
    said = telemetry_words(POOR, GRANTED, CLOCK, logs=True)
    assert "RAW_IMU arrives 45.0 times a second instead of 50, 10% did not arrive" in said
    assert "ATTITUDE" not in said and "(needed: the telemetry is too poor)" in said
    assert "spoil a response" in telemetry_words(POOR, GRANTED, CLOCK, logs=False)
    halved = telemetry_words(GOOD, {"ATTITUDE": 100.0}, CLOCK, logs=True)
    assert "ATTITUDE arrives 50.0 times a second instead of 100" in halved


def test_a_simulation_that_is_not_in_real_time_has_no_arrival() -> None:
    assert "arrival" not in telemetry_words(
        GOOD, GRANTED, ClockComparison(60.0, 8.0, 1.0, 0.9, 0.1), logs=True
    )


def test_the_clock_of_a_recording_of_the_firmware(tmp_path: Path) -> None:
    """And of the same file with every stamp 2 s later, and the clock there 300 ppm fast."""
    found = arrival_clock(FIRMWARE / "run1.tlog", SPAN)
    assert found is not None and found.span == pytest.approx(50, abs=0.1)
    whole = bytearray((FIRMWARE / "run1.tlog").read_bytes())
    at, first = 0, 0
    while at + 10 < len(whole):
        (stamp,) = struct.unpack_from(">Q", whole, at)
        first = first or stamp
        struct.pack_into(">Q", whole, at, stamp + 2_000_000 + round((stamp - first) * 3e-4))
        at += 8 + whole[at + 9] + 12 + (13 if whole[at + 10] & 1 else 0)
    (tmp_path / "late.tlog").write_bytes(whole)
    late = arrival_clock(tmp_path / "late.tlog", SPAN)
    assert late is not None and late.drift - found.drift == pytest.approx(3e-4, rel=0.1)
    assert late.offset - found.offset == pytest.approx(2.0, abs=0.05)
    assert late.jitter == pytest.approx(found.jitter, abs=0.002)
    assert arrival_clock(FIRMWARE / "run1.tlog", (1e6, 2e6)) is None


def test_messages_that_the_autopilot_dropped() -> None:
    assert dropped_messages(FIRMWARE / "run1.BIN") == 0
