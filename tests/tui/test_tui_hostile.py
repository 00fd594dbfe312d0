"""Texts of a hostile vehicle and of hostile files on every view: nothing in them is obeyed."""

from __future__ import annotations

import asyncio
import unicodedata
from dataclasses import replace
from pathlib import Path

import pytest
from scenes import SETUP, playing
from scripted_source import ROVER, SWEEP, connected
from seen import text_of

from rover_sweep.live.source import (
    Checked,
    Connect,
    Ended,
    Judged,
    Lost,
    Preflight,
    Snapshot,
    Update,
    Verdict,
)
from rover_sweep.tui.drawn import Question
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.preflight.read_rover import Check

EVIL = "\x1b[2J\x1b]52;c;aGk=\x07\r\x08\x7f\x9b31m\u202e\u2028[red]x[/red]"
TOLD: tuple[Update, ...] = (
    e.Connected(EVIL, replace(ROVER, firmware=EVIL, git_hash=EVIL)),
    e.Notice("warning", EVIL),
    e.Said(1.0, 2, EVIL),
    e.ParameterSet(EVIL, 1.0, 2.0),
    e.Rebooting((EVIL,)),
    Checked((Check(EVIL, "bad", EVIL),)),
    Snapshot(1.0, state=3, state_name=EVIL),
    e.RunStarted(EVIL, SWEEP, Path(EVIL)),
    e.RunFinished(EVIL, False, EVIL, Path(EVIL), (0.0, 1.0), 1, ()),
    Judged(Verdict(EVIL, "repeat", EVIL, remarks=(EVIL,))),
    e.LogSaved(Path(EVIL), 1, 1.0),
    Ended(Connect(EVIL), EVIL),
    Lost(EVIL),
)


def obeyed(text: str) -> set[str]:
    return {c for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp", "Cs")}


@pytest.mark.parametrize("view", "1234567")
def test_no_view_holds_a_control_character(view: str) -> None:
    async def look() -> str:
        setup = replace(SETUP, url=EVIL, folder=Path("a\x1b[2Jb"))
        async with playing(
            ("enter", connected(), [Ended(Preflight())], TOLD, view), (120, 40), setup
        ) as shown:
            return text_of(shown[0])

    text = asyncio.run(look())
    assert not obeyed(text), [line for line in text.splitlines() if obeyed(line)]
    assert view != "6" or "[red]x[/red]" in text


def test_a_question_holds_none_either() -> None:
    async def ask() -> str:
        async with playing(()) as (app, _, pilot):
            app.push_screen(Question(EVIL, EVIL))
            await pilot.pause()
            return text_of(app)

    text = asyncio.run(ask())
    assert not obeyed(text) and "\\x1b[2J" in text and "[red]" in text
