"""Help and command palette: every key is told, how to stop comes first, and neither moves the rover."""

from __future__ import annotations

import asyncio
import time

from scenes import playing
from scripted_source import ScriptedSource, connected, under_way
from seen import text_of
from test_tui_keys import DRIVEN, READY, after, drives, press
from textual.command import CommandPalette
from textual.pilot import Pilot

from rover_sweep.tui.app import SweepApp
from rover_sweep.tui.drawn import Question
from rover_sweep.tui.screens.frame import VIEWS, KeysHelp


async def until(app: SweepApp, words: str) -> None:
    """The palette searches in the background."""
    end = time.monotonic() + 30.0
    while words not in text_of(app):
        assert time.monotonic() < end, text_of(app)
        await asyncio.sleep(0.05)


def test_every_view_tells_its_keys_and_how_to_stop_first() -> None:
    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        for number, view in enumerate(VIEWS, 1):
            await press(pilot, str(number), "question_mark")
            shown = text_of(app)
            assert shown.index("SPACE or ESC ends a run at once") < shown.index(f"Keys of {view}")
            asked = list(source.asked)
            await press(pilot, "g")  # closes it, and does nothing else
            assert not isinstance(app.screen, KeysHelp) and source.asked == asked
        assert drives(source) == []

    after(READY, then)


def test_space_aborts_from_the_help_and_from_the_palette() -> None:
    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        await press(pilot, "question_mark", "space")
        assert source.aborted == 1
        app.pop_screen()
        await press(pilot, "ctrl+p", "escape")
        assert source.aborted == 2

    after((*DRIVEN, "y", under_way()), then)


def test_the_palette_finds_a_view_and_never_drives() -> None:
    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        await press(pilot, "3", "ctrl+p")
        assert isinstance(app.screen, CommandPalette)
        await press(pilot, *"results")
        await until(app, "view results (7)")
        await press(pilot, "enter", "enter")
        await until(app, "[7 RESULTS]")
        await press(pilot, "3", "ctrl+p", *"drive", "enter", "enter")
        await pilot.pause(0.3)
        assert drives(source) == []

    after(READY, then)


def test_a_question_is_not_covered_by_the_palette() -> None:
    async def run() -> None:
        async with playing(("enter", connected()), (80, 24)) as (app, source, pilot):
            app.push_screen(Question("Is the area clear?", "drive"))
            await pilot.pause()
            await press(pilot, "ctrl+p")
            assert not isinstance(app.screen, CommandPalette)
            assert not isinstance(app.screen, Question), "every key but Y is no"
            assert drives(source) == []

    asyncio.run(run())
