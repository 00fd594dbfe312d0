"""What is not a number has passed every limit: the run stops, the script lives."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from applet_bench import KINDS, Bench, Drive, moving, mutant, throw_switch

from firmware_params.applet_parameters import applet_source

NAN = float("nan")


def roll(bench: Bench) -> None:
    bench.roll = NAN


def roll_rate(bench: Bench) -> None:
    bench.rates = (NAN, 0.0, 0.0)


def yaw_rate(bench: Bench) -> None:
    bench.rates = (0.0, 0.0, NAN)


def velocity_north(bench: Bench) -> None:
    bench.velocity = (NAN, 1.0, 0.0)


def velocity_east(bench: Bench) -> None:
    bench.velocity = (1.0, NAN, 0.0)


def stick(bench: Bench) -> None:
    bench.rc[1] = None  # type: ignore[assignment]


def enable(bench: Bench) -> None:
    bench.parameters["SWP_ENABLE"] = NAN


SPEED = (
    ("speed = speed == speed and speed or nil", "speed = speed"),
    ("not (seen.speed <= v.V_MAX)", "seen.speed > v.V_MAX"),
    ("not (seen.speed >= v.V_MIN)", "seen.speed < v.V_MIN"),
)
UNKNOWN = (
    (roll, "roll unknown", (("not (roll <= v.ROLL_MAX)", "roll > v.ROLL_MAX"),)),
    (roll_rate, "roll rate unknown", (("not (p <= v.P_MAX)", "p > v.P_MAX"),)),
    (yaw_rate, "yaw rate unknown", (("not (r <= v.R_MAX)", "r > v.R_MAX"),)),
    (velocity_north, "no velocity estimate", SPEED),
    (velocity_east, "no velocity estimate", SPEED),
    (stick, "steering stick moved", (("not (stick_off(v) <= v.axis.moved)", "stick_off(v) > v.axis.moved"),)),
    (enable, "SWP_ENABLE is nan", (("not (parameter.ENABLE:get() >= 1)", "parameter.ENABLE:get() < 1"),)),
)
IDS = [spoil.__name__ for spoil, _, _ in UNKNOWN]


def spoilt_in_a_run(spoil: Callable[[Bench], None], source: str, kind: str) -> Drive:
    bench = moving(straight=1, fade=1, dwell=1, trec=20, still=0, **KINDS[kind])
    drive = Drive(bench, source)
    throw_switch(drive)
    drive.run_until(6)
    spoil(bench)
    drive.run(0.09)
    return drive


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("spoil", "said", "changes"), UNKNOWN, ids=IDS)
def test_unknown_value_stops_the_run(
    spoil: Callable[[Bench], None], said: str, changes: tuple[tuple[str, str], ...], kind: str
) -> None:
    drive = spoilt_in_a_run(spoil, applet_source(), kind)
    assert drive.bench.state == 10 and drive.bench.texts[-1] == f"SWP: run 1 stopped: {said}"
    assert drive.bench.overrides[-1][2] == 0 and drive.host.running
    assert spoilt_in_a_run(spoil, mutant(*changes), kind).bench.state == 6


@pytest.mark.parametrize("spoil", [velocity_north, velocity_east])
def test_unknown_velocity_is_refused_at_the_switch(spoil: Callable[[Bench], None]) -> None:
    bench = moving()
    spoil(bench)
    throw_switch(Drive(bench))
    assert bench.texts[-1] == "SWP: refused: no velocity estimate" and bench.overrides == []


@pytest.mark.parametrize("spoil", [roll, roll_rate, yaw_rate])
def test_unknown_value_lets_nothing_start(spoil: Callable[[Bench], None]) -> None:
    bench = moving(still=0, straight=0)
    spoil(bench)
    throw_switch(Drive(bench))
    assert bench.state == 10 and bench.overrides == []
