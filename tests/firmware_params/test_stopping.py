"""Every stop condition stops, and stands in a line of its own: without that line nothing stops."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from applet_bench import HIGH, KINDS, LOW, SOONEST_S, Drive, happen, moving, mutant, thrown, without

from firmware_params.applet_parameters import applet_source

Condition = tuple[
    dict[str, Any], str, str
]  # what happens, what is said, the line of the applet that minds it
ALWAYS: dict[str, Condition] = {
    "switch low": ({"switch": LOW}, "switch low", "if seen.switch ~= HIGH then return"),
    "switch middle": ({"switch": 1}, "switch low", "if seen.switch ~= HIGH then return"),
    "disarm": ({"is_armed": False}, "disarmed", "if not seen.armed then return"),
    "mode HOLD": ({"current_mode": 4}, "mode 4, not MANUAL", "if seen.mode ~= MANUAL then return"),
    "mode ACRO": ({"current_mode": 1}, "mode 1, not MANUAL", "if seen.mode ~= MANUAL then return"),
    "RC loss": ({"is_rc_valid": False}, "RC lost", "if not seen.rc_valid then return"),
    "GCS loss": ({"heard_ms": 1000}, "GCS lost", "(seen.gcs_age_ms <= GCS_LOST_MS)"),
    "disabled": ({"SWP_ENABLE": 0}, "SWP_ENABLE is 0", "if not (parameter.ENABLE:get()"),
    "servo moved": ({"steering_channel": 1}, "SERVO1 steers no more", "~= v.channel then return"),
    "no servo": ({"steering_channel": None}, "SERVO1 steers no more", "~= v.channel then return"),
}
STEERED: dict[str, Condition] = {  # only while the applet steers
    "steering": ({"forced_output": 1751}, "steering 251.0 > 250 us", "not (off <= v.PWM_MAX)"),
    "stick": ({"rc": {1: 1710, 6: 1100}}, "steering stick moved", "not (stick_off(v) <= v.axis.moved)"),
    "roll": ({"roll": math.radians(-31)}, "roll 31.0 > 30 deg", "not (roll <= v.ROLL_MAX)"),
    "roll rate": ({"rates": (4.0, 0, 0)}, "roll rate 229.2 > 200 deg/s", "not (p <= v.P_MAX)"),
    "yaw rate": ({"rates": (0, 0, -math.radians(160))}, "yaw rate 160.0 > 150 deg/s", "not (r <= v.R_MAX)"),
    "too fast": ({"velocity": (3, 3, 0)}, "speed 4.2 > 4 m/s", "not (seen.speed <= v.V_MAX)"),
    "too slow": ({"velocity": (0.3, 0, 0)}, "speed 0.3 < 0.5 m/s", "not (seen.speed >= v.V_MIN)"),
    "no EKF": ({"velocity": None}, "no velocity estimate", "if not seen.speed then return"),
}
CONDITIONS = ALWAYS | STEERED
UNKNOWN_OUTPUT = "not (off <= v.PWM_MAX)"
COURSE = {"straight": 1, "fade": 1, "dwell": 1, "trec": 20}


def swept(name: str, source: str | None = None, state: int = 6, kind: str = "sweep") -> Drive:
    """A drive that was in the middle of a run of this kind (or in `state`) when the condition came up."""
    settings = COURSE | KINDS[kind] | ({"gcs": 1} if name == "GCS loss" else {})
    bench = moving(speed=0.0 if state < 3 else 2.0, **settings)
    drive = thrown(bench, source)
    drive.run_until(state)
    drive.run(0.5)
    assert bench.state == state
    happen(bench, CONDITIONS[name][0])
    return drive


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CONDITIONS)
def test_stops_at_once_and_gives_steering_back(name: str, kind: str) -> None:
    drive = swept(name, kind=kind)
    bench = drive.bench
    bench.pilot_pwm, moved = 1444, bench.now
    drive.run(SOONEST_S)
    assert bench.log[-1]["St"] == 10 and bench.state == (10 if bench.switch == HIGH else 0)
    assert bench.texts[-1] == f"SWP: run 1 stopped: {CONDITIONS[name][1]}"
    count = len(bench.overrides)
    drive.run(1)
    bench.forced_output = None
    assert len(bench.overrides) == count, "the override went on after the stop"
    assert bench.servo_pwm(0) == 1444
    if name != "disarm":
        assert bench.overrides[-1][2] == 0 and bench.overrides[-1][0] - moved <= SOONEST_S * 1e6


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CONDITIONS)
def test_does_not_stop_with_the_condition_taken_out(name: str, kind: str) -> None:
    line = CONDITIONS[name][2]
    source = without(line)
    if line.startswith("~= v.channel"):  # its output is unknown then, which is a limit passed
        assert source.count(UNKNOWN_OUTPUT) == 1
        source = source.replace(UNKNOWN_OUTPUT, "off > v.PWM_MAX")
    drive = swept(name, source, kind=kind)
    drive.run(1)
    assert drive.host.error is None
    assert drive.bench.state == 6 and "stopped" not in drive.bench.said


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ALWAYS)
def test_stops_before_the_override_too(name: str, kind: str) -> None:
    drive = swept(name, state=1, kind=kind)
    drive.run(SOONEST_S)
    assert drive.bench.log[-1]["St"] == 10 and not drive.bench.overrides


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", STEERED)
def test_limits_mean_nothing_while_the_pilot_steers(name: str, kind: str) -> None:
    drive = swept(name, state=2 if name == "too slow" else 1, kind=kind)
    drive.run(1)
    assert drive.bench.state in (1, 2, 3) and "stopped" not in drive.bench.said


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "doublet"])
def test_end_of_record_ends_the_override_and_only_it_does(kind: str) -> None:
    def overridden_to(source: str) -> float:
        bench = moving(**COURSE | KINDS[kind] | {"dwell": 0, "trec": 5, "still": 0})
        thrown(bench, source, seconds=13)
        begun = next(row["t"] for row in bench.log if row["St"] == 3)
        return bench.overrides[-1][0] * 1e-6 - begun

    source = applet_source()
    end = "left > -run.STRAIGHT and STRAIGHT_AFTER or nil"
    assert source.count(end) == 1
    assert 9 <= overridden_to(source) < 9.1
    assert overridden_to(source.replace(end, "STRAIGHT_AFTER")) > 11


def test_limits_are_not_passed_at_their_value() -> None:
    bench = moving(speed=4.0, still=0, trec=5, roll_max=30, r_max=150)
    bench.roll, bench.rates = math.radians(29.99), (0, 0, math.radians(149.99))
    drive = thrown(bench)
    drive.run_until(0)
    assert bench.texts[-1] == "SWP: run 1 done"


def test_script_that_dies_leaves_an_override_that_runs_out() -> None:
    bench = moving(still=0)
    drive = thrown(bench)
    drive.run_until(6)
    assert {timeout for _, _, timeout, _ in bench.overrides} == {100}
    bench.now += 101_000
    bench.pilot_pwm = 1444
    assert bench.servo_pwm(0) == 1444


def test_switch_must_go_low_after_a_stop() -> None:
    assert runs_after_a_stop(applet_source()) == 1


def runs_after_a_stop(source: str) -> int:
    drive = swept("roll", source)
    drive.run(1)
    drive.bench.roll = 0.0
    drive.run(5)
    return int(drive.bench.parameters["SWP_RUN"])


def runs_with_switch_high_at_boot(source: str) -> int:
    bench = moving()
    bench.switch = HIGH
    Drive(bench, source).run(5)
    return int(bench.parameters["SWP_RUN"])


def runs_with_switch_high_at_arming(source: str) -> int:
    bench = moving()
    bench.is_armed = False
    drive = Drive(bench, source)
    drive.run(1)
    bench.is_armed, bench.switch = True, HIGH
    drive.run(5)
    return int(bench.parameters["SWP_RUN"])


def runs_with_another_switch_that_is_high(source: str) -> int:
    bench = moving()
    bench.rc[7] = 1900
    drive = Drive(bench, source)
    drive.run(1)
    bench.parameters["SWP_CHAN"] = 7
    drive.run(5)
    return int(bench.parameters["SWP_RUN"])


def overrides_while_disarmed_in_between(source: str) -> int:
    """Disarmed in the middle of an update, after the applet looked."""
    drive = swept("switch low", source)
    bench = drive.bench
    bench.switch, bench.is_armed, bench.arming_answers = HIGH, False, [True]
    drive.run(1)
    return sum(not armed for _, _, _, armed in bench.overrides)


RULES: tuple[tuple[Callable[[str], int], int, tuple[tuple[str, str], ...]], ...] = (
    (
        runs_after_a_stop,
        1,
        (
            ("        ready = false\n        begin(seen)", "        begin(seen)"),
            ("if seen.switch ~= HIGH then\n", "if true then\n"),
        ),
    ),
    (
        runs_with_switch_high_at_boot,
        0,
        (("local ready = false", "local ready = true"), ("        ready = false\n    end\n", "    end\n")),
    ),
    (runs_with_switch_high_at_arming, 0, ((" or armed ~= was_armed then", " then"),)),
    (runs_with_another_switch_that_is_high, 0, (("if source ~= last_source or armed", "if armed"),)),
    (overrides_while_disarmed_in_between, 0, (("    if arming:is_armed() then\n", "    if true then\n"),)),
)


@pytest.mark.parametrize(("scenario", "allowed", "mutation"), RULES, ids=[rule[0].__name__ for rule in RULES])
def test_rule_holds_and_only_because_of_its_lines(
    scenario: Callable[[str], int], allowed: int, mutation: tuple[tuple[str, str], ...]
) -> None:
    assert scenario(applet_source()) == allowed
    assert scenario(mutant(*mutation)) > allowed


def test_nothing_moves_while_disarmed() -> None:
    bench = moving()
    bench.is_armed = False
    drive = thrown(bench, seconds=3)
    assert bench.overrides == [] and bench.texts[-1] == "SWP: refused: not armed"
    bench.is_armed = True
    drive.run(3)
    assert bench.overrides == [], "a throw while disarmed must not start a run at arming"
