"""Preflight asks the autopilot whether it would arm: fault by fault, and it never arms or moves anything."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from virtual_faults import rc_lost, script_error
from virtual_line import VirtualLine
from virtual_run import BOOT
from virtual_world import Fault, World

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.preflight.read_rover import Check
from rover_sweep.vehicle.preflight.readiness import preflight

ARM = "MAV_CMD_COMPONENT_ARM_DISARM"
REFUSED = 4  # MAV_RESULT_FAILED
PAUSE = 4.0  # s: FS_TIMEOUT, and SYS_STATUS a second later


def looked_at(
    folder: Path, faults: tuple[Fault, ...] = (), **settings: float
) -> tuple[dict[str, Check], int]:
    """The checks of this rover, and the answer to arming it afterwards. Preflight itself moves nothing."""
    world = World(folder / "vehicle", settings, limit=400.0)
    world.run(BOOT)
    for fault in faults:
        fault.begin(world)
    world.run(PAUSE)
    with Link.open("virtual:", folder / "a.tlog", line=VirtualLine(world)) as link:
        checks = preflight(link, folder)
        assert not any(row.armed for row in world.record.rows)
        throttle = {row.throttle for row in world.record.rows}
        assert len(throttle) == 1, throttle
        assert not any(text.startswith("Arm: ") for _, text in world.record.texts)
        return {check.name: check for check in checks}, link.command(ARM, 1.0)


def test_a_rover_that_would_arm(tmp_path: Path) -> None:
    checks, answer = looked_at(tmp_path)
    assert {checks[name].state for name in ("prearm", "rc_options", "switch")} == {"good"}
    assert answer == 0


@pytest.mark.parametrize(
    ("settings", "fault", "said"),
    [
        ({"SERVO1_TRIM": 1000}, None, "SERVO1_MIN is greater than SERVO1_TRIM"),
        ({"RC3_MIN": 1350}, None, "Throttle radio min too high"),
        ({"SERVO3_FUNCTION": 0}, None, "check steering and throttle config"),
        ({"SERVO4_FUNCTION": 73}, None, "check skid steering config"),
        ({}, lambda: rc_lost(1), "Radio failsafe on"),
        ({}, script_error, "Scripting: "),
        ({"SERVO1_TRIM": 1000, "RC3_MIN": 1350}, None, "Throttle radio min too high; SERVO1_MIN is greater"),
    ],
)
def test_what_the_autopilot_says_before_arming(
    tmp_path: Path, settings: dict[str, float], fault: Callable[[], Fault] | None, said: str
) -> None:
    checks, answer = looked_at(tmp_path, () if fault is None else (fault(),), **settings)
    found = checks["prearm"]
    assert found.state == "bad" and said in found.sentence, found
    assert found.remedy is not None and found.remedy.by_hand and "look this text up" not in found.remedy.words
    assert answer == REFUSED


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("rc_options", {"RC9_OPTION": 300}, "RC6_OPTION and RC9_OPTION are 300: the autopilot does not arm"),
        ("rc_options", {"RC7_OPTION": 41, "RC9_OPTION": 41}, "RC7_OPTION and RC9_OPTION are 41"),
        ("rc_options", {"RC8_OPTION": 24}, "channel 8 is the mode switch (MODE_CH) and RC8_OPTION is 24"),
        ("switch", {"MODE_CH": 6}, "channel 6 starts the applet and is also the mode switch"),
    ],
)
def test_conflicts_that_the_autopilot_finds_only_at_arming(
    tmp_path: Path, name: str, settings: dict[str, float], said: str
) -> None:
    checks, answer = looked_at(tmp_path, **settings)
    found = checks[name]
    assert found.state == "bad" and said in found.sentence, found
    assert found.remedy is not None and found.remedy.by_hand
    assert checks["prearm"].state == "good" and answer == REFUSED


def test_duplicate_options_without_the_check_of_the_radio_are_only_a_doubt(tmp_path: Path) -> None:
    checks, answer = looked_at(tmp_path, RC9_OPTION=300, ARMING_CHECK=2)
    assert checks["rc_options"].state == "doubtful" and answer == 0


def test_checks_that_are_switched_off_are_a_doubt_with_a_remedy(tmp_path: Path) -> None:
    checks, answer = looked_at(tmp_path, ARMING_CHECK=0, SERVO1_TRIM=1000)
    found = checks["prearm"]
    assert found.state == "doubtful" and found.remedy is not None
    assert found.remedy.sets == (("ARMING_CHECK", 1.0),) and answer == 0
