"""Reasons on the screen: of a key that does nothing, of a refusal, whole; and how old the checks are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from scenes import Step, after, played
from scripted_source import CHECKS, SWEEP, ScriptedSource, drive, finished, snapshot, under_way
from seen import text_of
from test_tui_keys import DRIVEN, OWN_SETUP, READY, press
from textual.pilot import Pilot

from rover_sweep.live.source import Checked, Ended
from rover_sweep.tui.app import SweepApp
from rover_sweep.tui.screens.plan import PreflightScreen
from rover_sweep.vehicle import events as e


@pytest.mark.parametrize(("view", "first", "last"), [("1", 0, 2), ("2", 0, len(CHECKS) - 1), ("3", 0, 2)])
@played(READY)
async def test_a_cursor_stops_at_both_ends(app, source, pilot, view: str, first: int, last: int) -> None:
    def at() -> int:
        screen = app.screen
        return screen.index if isinstance(screen, PreflightScreen) else screen.chosen  # type: ignore

    await press(pilot, view, *["up"] * 20)
    assert at() == first
    await press(pilot, *["down"] * 20)
    assert at() == last
    await press(pilot, "up")
    assert at() == last - 1


@pytest.mark.parametrize(("view", "key"), [("2", "f"), ("2", "r"), ("3", "g"), ("6", "l")])
@played(DRIVEN)
async def test_a_key_that_waits_for_the_end_of_a_run_says_so(app, source, pilot, view: str, key: str) -> None:
    before = list(source.asked)
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
