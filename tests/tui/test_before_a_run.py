"""Before a run: what is BAD, what is kept already, and with which throttle; every run has its own yes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from scenes import FAST, OWN, SETUP, Step, after, played
from scripted_source import CHECKS, SWEEP, VERDICT, ScriptedSource, drive, finished, snapshot, under_way
from seen import text_of
from test_tui_keys import DRIVEN, OWN_SETUP, READY, drives, press
from textual.pilot import Pilot

from rover_sweep.live.source import Checked, Ended, Judged
from rover_sweep.tui.app import SweepApp
from rover_sweep.tui.drawn import Question
from rover_sweep.tui.model.setup import Setup, bad_checks
from rover_sweep.tui.screens.plan import PreflightScreen
from rover_sweep.vehicle import events as e
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


# ---- Reasons on the screen: of a key that does nothing, of a refusal, whole; and how old the checks are.


@played(READY)
async def test_a_cursor_stops_at_both_ends(app, source, pilot) -> None:
    for view, start, last in (("1", 0, 2), ("2", 1, len(CHECKS) - 1), ("3", 0, 2)):
        await press(pilot, view, *["up"] * (start + 1))
        screen = app.screen
        at = lambda: screen.index if isinstance(screen, PreflightScreen) else screen.chosen  # noqa: B023, E731
        assert at() == 0, view
        await press(pilot, *["down"] * (last + 1))
        assert at() == last, view
        await press(pilot, "up")
        assert at() == last - 1, view


@played(DRIVEN)
async def test_a_key_that_waits_for_the_end_of_a_run_says_so(app, source, pilot) -> None:
    before = list(source.asked)
    for view, key in (("2", "f"), ("2", "r"), ("3", "g"), ("6", "l")):
        await press(pilot, view, key)
        assert f"SPACE or ESC ABORTS - {key.upper()}: not during a run" in text_of(app)
        await press(pilot, "down")
        assert "not during a run" not in text_of(app) and source.asked == before


@pytest.mark.parametrize(
    ("steps", "key", "said"),
    [
        (("2",), "r", "R: no rover is connected; 1 connects"),
        ((*READY, "r"), "f", "F: not while running the checks"),
        ((*READY, *["down"] * 7), "f", "F: this is done by hand, as described above"),
        ((*READY, "up"), "f", "F: there is nothing to fix at firmware"),
        ((*READY, [snapshot(2.0, state=0)], "6"), "l", "L: not while the rover is armed"),
    ],
)
def test_a_key_that_does_nothing_says_why(steps: Sequence[Step], key: str, said: str) -> None:
    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        await press(pilot, key)
        assert said in text_of(app)
        await press(pilot, "c")
        assert said not in text_of(app)

    after(steps, then)


def test_checks_tell_their_age_and_fade_when_the_rover_has_changed() -> None:
    good = tuple(check for check in CHECKS if check.state == "good")

    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        assert "3 bad, 2 doubtful or unknown, 6 good\n" in text_of(app) and not app.checks_old
        source.tell(replace(app.state.snapshot, switch=1950.0))
        await pilot.pause()
        assert app.checks_old, "the switch is high now"
        app._checked_at -= 45
        app.redraw()
        await pilot.pause()
        assert "6 good, 40 s ago: R checks again" in text_of(app)
        source.tell(Checked(good))
        await pilot.pause()
        assert not app.checks_old and f"All {len(good)} checks are good: press 3" in text_of(app)
        app._checked_at -= 200
        app.redraw()
        await pilot.pause()
        assert (
            f"All {len(good)} checks were good 3 min ago; R checks again" in text_of(app) and app.checks_old
        )

    after(READY, then)


@played((*READY, "3"), OWN_SETUP)
async def test_a_question_tells_how_old_the_checks_are(app, source, pilot) -> None:
    app._checked_at -= 200
    await press(pilot, "g")
    assert "(view 2, checked 3 min ago)" in " ".join(text_of(app).replace("┃", " ").split())


def test_a_long_refusal_is_shown_whole() -> None:
    words = (
        "sweep1 needs 240 us, but the rover's SWP_PWM_MAX allows 200 us; give less, or raise SWP_PWM_MAX if "
        "the steering moves freely that far: press 3, then E to change the run"
    )

    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        assert words in " ".join(text_of(app).split())
        assert app.state.runs[-1].began is False

    after((*READY, "3", "g", [Ended(drive(), words)]), then)


def test_runs_of_one_name_are_told_apart() -> None:
    again = [e.RunStarted("sweep1", SWEEP, Path("sweep1-2.tlog")), *under_way()[1:]]
    end = replace(finished()[1], tlog=Path("sweep1-2.tlog"))

    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        await press(pilot, "7")
        assert "D diagnoses sweep1, sweep1-2" in text_of(app)
        await press(pilot, "6")
        assert "sweep1-2" in text_of(app)

    after((*DRIVEN, finished(), "3", "up", "g", again, [end, Ended(drive())]), then)
