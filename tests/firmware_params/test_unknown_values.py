"""What is not a number has passed every limit: the run stops, the script lives."""

from __future__ import annotations

from typing import Any

import pytest
from applet_bench import KINDS, Drive, happen, moving, mutant, thrown

from firmware_params.applet_parameters import applet_source

NAN = float("nan")


SPEED = (
    ("speed = speed == speed and speed or nil", "speed = speed"),
    ("not (seen.speed <= v.V_MAX)", "seen.speed > v.V_MAX"),
    ("not (seen.speed >= v.V_MIN)", "seen.speed < v.V_MIN"),
)
LIMITS = {  # what is said: what is unknown, and the line that would let it pass
    "roll unknown": ({"roll": NAN}, ("not (roll <= v.ROLL_MAX)", "roll > v.ROLL_MAX")),
    "roll rate unknown": ({"rates": (NAN, 0.0, 0.0)}, ("not (p <= v.P_MAX)", "p > v.P_MAX")),
    "yaw rate unknown": ({"rates": (0.0, 0.0, NAN)}, ("not (r <= v.R_MAX)", "r > v.R_MAX")),
}
STICK = ("not (stick_off(v) <= v.axis.moved)", "stick_off(v) > v.axis.moved")
ENABLE = ("not (parameter.ENABLE:get() >= 1)", "parameter.ENABLE:get() < 1")
VELOCITIES = ({"velocity": (NAN, 1.0, 0.0)}, {"velocity": (1.0, NAN, 0.0)})
UNKNOWN = (
    *((spoil, said, (change,)) for said, (spoil, change) in LIMITS.items()),
    *((spoil, "no velocity estimate", SPEED) for spoil in VELOCITIES),
    ({"rc": {1: None, 6: 1100}}, "steering stick moved", (STICK,)),
    ({"SWP_ENABLE": NAN}, "SWP_ENABLE is nan", (ENABLE,)),
)


def spoilt_in_a_run(spoil: dict[str, Any], source: str, kind: str) -> Drive:
    bench = moving(straight=1, fade=1, dwell=1, trec=20, still=0, **KINDS[kind])
    drive = thrown(bench, source)
    drive.run_until(6)
    happen(bench, spoil)
    drive.run(0.09)
    return drive


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("spoil", "said", "changes"), UNKNOWN)
def test_unknown_value_stops_the_run(
    spoil: dict[str, Any], said: str, changes: tuple[tuple[str, str], ...], kind: str
) -> None:
    drive = spoilt_in_a_run(spoil, applet_source(), kind)
    assert drive.bench.state == 10 and drive.bench.texts[-1] == f"SWP: run 1 stopped: {said}"
    assert drive.bench.overrides[-1][2] == 0 and drive.host.running
    assert spoilt_in_a_run(spoil, mutant(*changes), kind).bench.state == 6


@pytest.mark.parametrize("spoil", VELOCITIES)
def test_unknown_velocity_is_refused_at_the_switch(spoil: dict[str, Any]) -> None:
    bench = moving()
    happen(bench, spoil)
    thrown(bench)
    assert bench.texts[-1] == "SWP: refused: no velocity estimate" and bench.overrides == []


@pytest.mark.parametrize("spoil", [spoil for spoil, _ in LIMITS.values()])
def test_unknown_value_lets_nothing_start(spoil: dict[str, Any]) -> None:
    bench = moving(still=0, straight=0)
    happen(bench, spoil)
    thrown(bench)
    assert bench.state == 10 and bench.overrides == []
