"""Every stop condition stops, and stands in a line of its own: without that line nothing stops."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from applet_bench import HIGH, KINDS, LOW, Bench, Drive, moving, throw_switch

from firmware_params.applet_parameters import applet_source


@dataclass(frozen=True)
class Condition:
    """What happens to the vehicle, the line of the applet that minds it, and what is said."""

    name: str
    line: str
    happen: Callable[[Bench], None]
    said: str
    steering_only: bool = False
    settings: tuple[tuple[str, float], ...] = ()


def setting(**values: object) -> Callable[[Bench], None]:
    def happen(bench: Bench) -> None:
        for name, value in values.items():
            setattr(bench, name, value)

    return happen


def stick(bench: Bench) -> None:
    bench.rc[1] = 1710


def disable(bench: Bench) -> None:
    bench.parameters["SWP_ENABLE"] = 0


RATE = math.radians(160.0)
CONDITIONS = (
    Condition("switch low", "if seen.switch ~= HIGH then return", setting(switch=LOW), "switch low"),
    Condition("switch middle", "if seen.switch ~= HIGH then return", setting(switch=1), "switch low"),
    Condition("disarm", "if not seen.armed then return", setting(is_armed=False), "disarmed"),
    Condition(
        "mode HOLD", "if seen.mode ~= MANUAL then return", setting(current_mode=4), "mode 4, not MANUAL"
    ),
    Condition(
        "mode ACRO", "if seen.mode ~= MANUAL then return", setting(current_mode=1), "mode 1, not MANUAL"
    ),
    Condition("RC loss", "if not seen.rc_valid then return", setting(is_rc_valid=False), "RC lost"),
    Condition(
        "GCS loss",
        "(seen.gcs_age_ms <= GCS_LOST_MS)",
        setting(heard_ms=1000),
        "GCS lost",
        settings=(("gcs", 1),),
    ),
    Condition("disabled", "if not (parameter.ENABLE:get()", disable, "SWP_ENABLE is 0"),
    Condition(
        "servo moved", "~= v.channel then return", setting(steering_channel=1), "SERVO1 steers no more"
    ),
    Condition(
        "no servo", "~= v.channel then return", setting(steering_channel=None), "SERVO1 steers no more"
    ),
    Condition(
        "steering", "not (off <= v.PWM_MAX)", setting(forced_output=1751), "steering 251.0 > 250 us", True
    ),
    Condition("stick", "not (stick_off(v) <= v.axis.moved)", stick, "steering stick moved", True),
    Condition(
        "roll", "not (roll <= v.ROLL_MAX)", setting(roll=math.radians(-31)), "roll 31.0 > 30 deg", True
    ),
    Condition(
        "roll rate", "not (p <= v.P_MAX)", setting(rates=(4.0, 0, 0)), "roll rate 229.2 > 200 deg/s", True
    ),
    Condition(
        "yaw rate", "not (r <= v.R_MAX)", setting(rates=(0, 0, -RATE)), "yaw rate 160.0 > 150 deg/s", True
    ),
    Condition(
        "too fast", "not (seen.speed <= v.V_MAX)", setting(velocity=(3, 3, 0)), "speed 4.2 > 4 m/s", True
    ),
    Condition(
        "too slow", "not (seen.speed >= v.V_MIN)", setting(velocity=(0.3, 0, 0)), "speed 0.3 < 0.5 m/s", True
    ),
    Condition(
        "no EKF", "if not seen.speed then return", setting(velocity=None), "no velocity estimate", True
    ),
)
UNKNOWN_OUTPUT = "not (off <= v.PWM_MAX)"
COURSE = {"straight": 1, "fade": 1, "dwell": 1, "trec": 20}
SOONEST_S = 0.09  # one update, the longest gap of the real firmware included


def by_name(name: str) -> Condition:
    return next(condition for condition in CONDITIONS if condition.name == name)


def without(line: str) -> str:
    """The applet's source without the one line that contains `line`."""
    lines = applet_source().splitlines()
    hits = [i for i, text in enumerate(lines) if line in text]
    assert len(hits) == 1, f"{len(hits)} lines contain {line!r}"
    return "\n".join(lines[: hits[0]] + lines[hits[0] + 1 :])


def swept(condition: Condition, source: str | None = None, state: int = 6, kind: str = "sweep") -> Drive:
    """A drive that was in the middle of a run of this kind (or in `state`) when the condition came up."""
    settings = COURSE | KINDS[kind] | dict(condition.settings)
    bench = moving(speed=0.0 if state < 3 else 2.0, **settings)
    drive = Drive(bench, source)
    throw_switch(drive)
    drive.run_until(state)
    drive.run(0.5)
    assert bench.state == state
    condition.happen(bench)
    return drive


def ids(condition: Condition) -> str:
    return condition.name


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("condition", CONDITIONS, ids=ids)
def test_stops_at_once_and_gives_steering_back(condition: Condition, kind: str) -> None:
    drive = swept(condition, kind=kind)
    bench = drive.bench
    bench.pilot_pwm, moved = 1444, bench.now
    drive.run(SOONEST_S)
    assert bench.log[-1]["St"] == 10 and bench.state == (10 if bench.switch == HIGH else 0)
    assert bench.texts[-1] == f"SWP: run 1 stopped: {condition.said}"
    count = len(bench.overrides)
    drive.run(1)
    bench.forced_output = None
    assert len(bench.overrides) == count, "the override went on after the stop"
    assert bench.servo_pwm(0) == 1444
    if condition.name != "disarm":
        assert bench.overrides[-1][2] == 0 and bench.overrides[-1][0] - moved <= SOONEST_S * 1e6


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("condition", CONDITIONS, ids=ids)
def test_does_not_stop_with_the_condition_taken_out(condition: Condition, kind: str) -> None:
    source = without(condition.line)
    if condition.line.startswith("~= v.channel"):  # its output is unknown then, which is a limit passed
        assert source.count(UNKNOWN_OUTPUT) == 1
        source = source.replace(UNKNOWN_OUTPUT, "off > v.PWM_MAX")
    drive = swept(condition, source, kind=kind)
    drive.run(1)
    assert drive.host.error is None
    assert drive.bench.state == 6 and "stopped" not in drive.bench.said


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("condition", [c for c in CONDITIONS if not c.steering_only], ids=ids)
def test_stops_before_the_override_too(condition: Condition, kind: str) -> None:
    drive = swept(condition, state=1, kind=kind)
    drive.run(SOONEST_S)
    assert drive.bench.log[-1]["St"] == 10 and not drive.bench.overrides


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("condition", [c for c in CONDITIONS if c.steering_only], ids=ids)
def test_limits_mean_nothing_while_the_pilot_steers(condition: Condition, kind: str) -> None:
    drive = swept(condition, state=2 if condition.name == "too slow" else 1, kind=kind)
    drive.run(1)
    assert drive.bench.state in (1, 2, 3) and "stopped" not in drive.bench.said


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "doublet"])
def test_end_of_record_ends_the_override_and_only_it_does(kind: str) -> None:
    def overridden_to(source: str) -> float:
        bench = moving(**COURSE | KINDS[kind] | {"dwell": 0, "trec": 5, "still": 0})
        drive = Drive(bench, source)
        throw_switch(drive)
        drive.run(13)
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
    drive = Drive(bench)
    throw_switch(drive)
    drive.run_until(0)
    assert bench.texts[-1] == "SWP: run 1 done"


def test_script_that_dies_leaves_an_override_that_runs_out() -> None:
    bench = moving(still=0)
    drive = Drive(bench)
    throw_switch(drive)
    drive.run_until(6)
    assert {timeout for _, _, timeout, _ in bench.overrides} == {100}
    bench.now += 101_000
    bench.pilot_pwm = 1444
    assert bench.servo_pwm(0) == 1444


def test_switch_must_go_low_after_a_stop() -> None:
    assert runs_after_a_stop(applet_source()) == 1


def runs_after_a_stop(source: str) -> int:
    drive = swept(by_name("roll"), source)
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
    drive = swept(by_name("switch low"), source)
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
    source = applet_source()
    assert scenario(source) == allowed
    for old, new in mutation:
        assert source.count(old) == 1, f"{old!r} is there {source.count(old)} times"
        source = source.replace(old, new)
    assert scenario(source) > allowed


def test_nothing_moves_while_disarmed() -> None:
    bench = moving()
    bench.is_armed = False
    drive = Drive(bench)
    throw_switch(drive)
    drive.run(3)
    assert bench.overrides == [] and bench.texts[-1] == "SWP: refused: not armed"
    bench.is_armed = True
    drive.run(3)
    assert bench.overrides == [], "a throw while disarmed must not start a run at arming"
