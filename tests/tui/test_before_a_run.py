"""Before a run: what is BAD, what is kept already, and with which throttle; every run has its own yes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from scenes import FAST, OWN, SETUP, Step, after, played
from scripted_source import CHECKS, VERDICT, ScriptedSource, drive, finished, under_way
from seen import text_of
from test_tui_keys import DRIVEN, OWN_SETUP, READY, drives, press
from textual.pilot import Pilot

from rover_sweep.live.source import Checked, Ended, Judged
from rover_sweep.tui.app import SweepApp
from rover_sweep.tui.drawn import Question
from rover_sweep.tui.model.setup import Setup, bad_checks
from rover_sweep.vehicle.preflight.read_rover import Check

KEEP = replace(VERDICT, advice="keep", sentence="keep: coherence >= 0.6")
KEPT: Sequence[Step] = (*DRIVEN, [*finished()[:-1], Judged(KEEP)])
OWN_END = [*finished()[:3], Ended(drive(settings=OWN)), Judged(KEEP)]
OWN_KEPT: Sequence[Step] = (*READY, "3", "g", "y", under_way(), OWN_END)
TOO_FAST = ("y", [*under_way(), *FAST], "5")


def words(app: SweepApp) -> str:
    return " ".join(text_of(app).replace("┃", " ").split())


@pytest.mark.parametrize(
    ("checks", "said"),
    [
        (CHECKS, "3 of 11 checks are BAD: applet, parameters, switch (view 2)."),
        (CHECKS[:2], "1 of 2 checks is BAD: applet (view 2)."),
        (CHECKS[:1], "None of the 1 checks is BAD."),
    ],
)
def test_the_question_counts_and_names_the_bad_checks(checks: tuple[Check, ...], said: str) -> None:
    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        assert isinstance(app.screen, Question)
        assert said in words(app)
        await press(pilot, "y")
        assert len(drives(source)) == 1, "the box is shown whole in 80x24"

    after((*READY, [Checked(checks)], "3", "g"), then, OWN_SETUP)


def test_checks_that_were_not_run_are_said() -> None:
    assert bad_checks(()) == "The checks were NOT RUN: view 2, R."


@pytest.mark.parametrize(("setup", "begun"), [(SETUP, KEPT), (OWN_SETUP, OWN_KEPT)])
def test_a_run_that_is_kept_is_driven_again_only_with_a_yes(setup: Setup, begun: Sequence[Step]) -> None:
    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        before = len(drives(source))
        await press(pilot, "3", "up", "g")
        assert isinstance(app.screen, Question)
        assert "sweep1 is already KEEP" in words(app)
        await press(pilot, "n")
        assert len(drives(source)) == before
        await press(pilot, "g", "y")
        assert [run.planned.name for run in drives(source)[before:]] == ["sweep1"]

    after(begun, then, setup)


@played((*DRIVEN, finished()))
async def test_a_run_that_is_not_kept_is_not_said_to_be(app, source, pilot) -> None:
    await press(pilot, "3", "up", "g")
    assert "already KEEP" not in text_of(app) and len(drives(source)) == 2


@played((*READY, "3", "g", *TOO_FAST), OWN_SETUP)
async def test_a_throttle_that_is_too_high_is_lowered_by_a_key_and_asked_about(app, source, pilot) -> None:
    assert "the throttle of 1710 us is too high for 2 m/s" in words(app)
    assert "T lowers the throttle to 1605 us; then G asks" in words(app)
    await press(pilot, "t")
    assert len(drives(source)) == 1, "the key drives nothing"
    assert "with throttle 1605 us" in words(app)
    await press(pilot, "t")
    assert app.setup.settings.throttle_us == 1605, "once only"
    await press(pilot, "g")
    assert "drives it with throttle 1605 us" in words(app) and len(drives(source)) == 1
    await press(pilot, "n", "g", "y")
    assert [run.settings for run in drives(source)] == [OWN, replace(OWN, throttle_us=1605)]


@played((*READY, "3", "g", *TOO_FAST), OWN_SETUP)
async def test_a_throttle_set_otherwise_is_not_changed_by_an_old_verdict(app, source, pilot) -> None:
    app.setup = replace(app.setup, settings=replace(OWN, throttle_us=1550))
    app.redraw()
    await press(pilot, "t")
    assert app.setup.settings.throttle_us == 1550
    assert "T lowers" not in words(app)


@played((*READY, "3"), OWN_SETUP)
async def test_a_yes_counts_only_for_what_was_asked(app, source, pilot) -> None:
    await press(pilot, "g")
    app.setup = replace(app.setup, settings=replace(OWN, throttle_us=1800))
    await press(pilot, "y")
    assert not drives(source)
