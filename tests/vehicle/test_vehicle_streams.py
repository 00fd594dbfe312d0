"""Message rates: what is denied, what is had instead, how well it came."""

from __future__ import annotations

import random

import pytest
from fake_vehicle import FakeVehicle

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import make
from rover_sweep.vehicle.link.streams import (
    StreamMonitor,
    fastest_interval_ms,
    request,
    stream_fault,
    stream_quality,
)


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
