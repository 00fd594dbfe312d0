"""Message rates: what is denied, what is had instead, how well it came."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle

from rover_sweep.logs.readers.vehicle_clock import dropped_messages
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import make
from rover_sweep.vehicle.link.streams import (
    StreamMonitor,
    StreamQuality,
    fastest_interval_ms,
    request,
    stream_fault,
    stream_quality,
)
from rover_sweep.vehicle.preflight.rates import telemetry_words
from rover_sweep.vehicle.preflight.read_rover import ClockComparison
from rover_sweep.vehicle.preflight.readiness import arrival_clock


@pytest.mark.parametrize(("loop", "interval"), [(50, 25), (100, 12), (200, 6), (400, 3)])
def test_the_cap_by_the_loop_rate(loop: float, interval: int) -> None:
    assert fastest_interval_ms(loop) == interval


def test_a_denied_rate_names_its_remedy_and_the_fastest_is_taken(link: Link, vehicle: FakeVehicle) -> None:
    vehicle.parameters["SCHED_LOOP_RATE"] = 50
    stream = request(link, "ATTITUDE", 100, loop_rate=50)
    assert stream.hz == 40
    assert "SCHED_LOOP_RATE 50 allows at most 40 Hz; set SCHED_LOOP_RATE to 200" in stream.advice
    assert request(link, "ATTITUDE", 40, loop_rate=50).advice == ""
    asked = [c.param2 for c in vehicle.of_kind("COMMAND_LONG") if c.command == 511]
    assert asked == [10_000, 25_000, 25_000]


def test_quality_of_a_stream() -> None:
    steady = [n * 0.02 for n in range(200)]
    good = stream_quality("ATTITUDE", steady)
    assert (good.hz, good.lost, stream_fault(good, 50)) == (pytest.approx(50), 0, "")
    assert "50.0 times a second instead of 100" in stream_fault(good, 100)  # every other one is lost
    gap = stream_quality("ATTITUDE", steady[:100] + steady[120:])
    assert gap.gap_ms == pytest.approx(420)
    assert gap.lost == pytest.approx(0.1)
    assert "10% did not arrive, longest gap 420 ms" in stream_fault(gap, 50)
    short = stream_quality("ATTITUDE", steady[:100] + steady[103:])  # 80 ms without, once in 4 s
    assert stream_fault(short, 50) == "" and "longest gap 80 ms" in stream_fault(short, 50, gap=0.06)
    assert "arrived only" in stream_fault(stream_quality("ATTITUDE", [1.0]), 50)


def test_the_monitor_keeps_the_vehicles_stamps(link: Link) -> None:
    monitor = StreamMonitor(frozenset({"ATTITUDE", "SERVO_OUTPUT_RAW"}))
    with link.listening(monitor):
        for _ in range(300):
            link.receive(1.0)
    attitude, servo = monitor.quality()
    assert (attitude.message, servo.message) == ("ATTITUDE", "SERVO_OUTPUT_RAW")
    assert attitude.hz == pytest.approx(50, rel=0.01)
    assert servo.hz == pytest.approx(50, rel=0.01)


def test_late_and_repeated_messages_are_no_lost_ones() -> None:
    steady = [n * 0.02 for n in range(400)]
    chance = random.Random(1)
    jittered = sorted(steady + steady[::20], key=lambda t: t + chance.uniform(0, 0.5))
    assert jittered != sorted(jittered)
    assert stream_quality("ATTITUDE", jittered) == stream_quality("ATTITUDE", steady)


def test_the_servo_clock_that_wraps_is_no_gap() -> None:
    monitor = StreamMonitor(frozenset({"SERVO_OUTPUT_RAW"}))
    for n in range(200):
        us = (2**32 - 2_000_000 + n * 20_000) % 2**32
        monitor(
            make("SERVO_OUTPUT_RAW", time_usec=us, port=0, **{f"servo{k}_raw": 1500 for k in range(1, 9)})
        )
    (servo,) = monitor.quality()
    assert (servo.count, servo.lost) == (200, 0)
    assert servo.gap_ms == pytest.approx(20)


# ---- What is said of a run's telemetry: how it came, its clock, and whether it is identified from.

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
