"""The worst that can happen to link, laptop and radio in the middle of a run, on the official firmware.

In real time, 15 minutes in all. It prints a table: s with throttle off trim after the fault, of that after
the tool let go, metres, how late throttle was still sent, runs begun, mode, what the tool says last, armed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from firmware_faults import Rig, Scenario, booted, broken, played

pytestmark = pytest.mark.ardurover

WHOLE = "the manoeuvre ran to its end"
SILENT = r"nothing was heard from the rover for \d\.\d s"
UNSEEN = 0.3  # s more than a lost link until a gap between overrides shows a lost transmitter, at worst
STOP_SCRIPTS = 2.0  # SCRIPTING_CMD_STOP


def link(mode: str, direction: str = "both") -> Callable[[Rig], None]:
    return lambda rig: rig.relay.set(mode, direction)  # type: ignore[arg-type]


def receiver(failure: float) -> Callable[[Rig], None]:
    return lambda rig: rig.observer.set("SIM_RC_FAIL", failure)


def scripts_end(rig: Rig) -> None:
    rig.observer.command("MAV_CMD_SCRIPTING", STOP_SCRIPTS)


def nothing(rig: Rig) -> None:
    """The program is killed."""


def stick(us: int, then: Callable[[Rig], None] = nothing) -> Callable[[Rig], None]:
    """The pilot's throttle stick beneath our override."""

    def fault(rig: Rig) -> None:
        rig.radio.hold(3, us)
        then(rig)

    return fault


def override_time(seconds: float) -> Callable[[Rig], None]:
    return lambda rig: rig.observer.set("RC_OVERRIDE_TIME", seconds)


def _lost() -> Iterator[Scenario]:
    """The laptop is lost, and the throttle stick was moved meanwhile, or somebody set the override time."""
    for us in (1000, 1800):
        at = f"throttle stick at {us} us"
        yield Scenario(f"program killed, {at}", stick(us), "", lapses=True, killed=True, lost=True)
        yield Scenario(f"program asleep, {at}", stick(us), "", lapses=True, asleep=True, lost=True)
        yield Scenario(f"hole for good, {at}", stick(us, link("hole")), SILENT, lapses=True, lost=True)
        gone = stick(us, link("hole", "up"))
        yield Scenario(f"uplink gone for good, {at}", gone, "HOLD|left MANUAL", lapses=True, lost=True)
    for seconds in (30.0, -1.0):
        at = f"RC_OVERRIDE_TIME set to {seconds:g}"
        fault = override_time(seconds)
        yield Scenario(f"program killed, {at}", fault, "", lapses=True, killed=True, lost=True)


SCENARIOS = (
    Scenario("no fault", None, WHOLE, drives=18.0),
    Scenario("hole 3.6 s", link("hole"), SILENT, lifts=3.6, lapses=True),
    Scenario("hole 4.5 s", link("hole"), SILENT, lifts=4.5, lapses=True),
    Scenario("hole 7 s", link("hole"), SILENT, lifts=7.0, lapses=True),
    Scenario("downlink gone for good", link("hole", "down"), SILENT),
    Scenario("uplink gone 3.6 s", link("hole", "up"), "HOLD", lifts=3.6, lapses=True),
    Scenario("stall 3.6 s", link("stall"), f"{SILENT}|went into HOLD", lifts=3.6, lapses=True),
    Scenario("scripts end", scripts_end, "the applet has not reported its state"),
    Scenario("SIM_RC_FAIL 1", receiver(1.0), "RC lost|receiver is not healthy", drives=UNSEEN),
    Scenario("SIM_RC_FAIL 2", receiver(2.0), "jumped at once"),
    Scenario(
        "too fast for the band", None, "above SWP_V_MAX|m/s", drives=3.0, throttle=1900, limits={"v_max": 2.0}
    ),
    Scenario("too slow for the band", None, "15 s of throttle did not", drives=15.0, throttle=1560),
    Scenario("program killed", nothing, "", lapses=True, killed=True),
    *_lost(),
)


@pytest.fixture(scope="module")
def rig(ardurover: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with booted(ardurover, tmp_path_factory.mktemp("rover")) as made:
        yield made


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
def test_what_moves_ends_and_is_told_as_what_it_was(rig: Rig, tmp_path: Path, scenario: Scenario) -> None:
    outcome = played(rig, scenario, tmp_path)
    print(f"\n{outcome.row(scenario.name)}")
    assert broken(outcome, scenario) == []
    assert len(outcome.seen.begun) == 1
    assert re.search(scenario.told, outcome.said), outcome.said
