"""Help, palette, hostile texts and the Bode view."""

from __future__ import annotations

import asyncio
import time
import unicodedata
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import SETUP, played
from scripted_source import ROVER, SWEEP, connected, under_way
from seen import text_of
from test_tui_keys import DRIVEN, READY, drives, press
from textual.command import CommandPalette

from rover_sweep.api.read import with_delta
from rover_sweep.data.braille import braille_lines
from rover_sweep.data.vehicle_file import load
from rover_sweep.live.source import (
    Checked,
    Connect,
    Ended,
    Judged,
    Lost,
    Preflight,
    ResponseCurve,
    Snapshot,
    Update,
    Verdict,
)
from rover_sweep.live.verdict import verdict_on_run
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.quality.coherence import responses
from rover_sweep.spectra.response import unwrapped_phase
from rover_sweep.tui.app import SweepApp
from rover_sweep.tui.drawn import LIGHT, Question, ScreenRows
from rover_sweep.tui.screens.frame import VIEWS, KeysHelp
from rover_sweep.tui.screens.results import decades, draw_bode
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.preflight.read_rover import Check


async def until(app: SweepApp, words: str) -> None:
    """The palette searches in the background."""
    end = time.monotonic() + 30.0
    while words not in text_of(app):
        assert time.monotonic() < end, text_of(app)
        await asyncio.sleep(0.05)


@played(READY)
async def test_every_view_tells_its_keys_and_how_to_stop_first(app, source, pilot) -> None:
    for number, view in enumerate(VIEWS, 1):
        await press(pilot, str(number), "question_mark")
        shown = text_of(app)
        assert shown.index("SPACE or ESC ends a run at once") < shown.index(f"Keys of {view}")
        asked = list(source.asked)
        await press(pilot, "g")  # closes it, and does nothing else
        assert not isinstance(app.screen, KeysHelp) and source.asked == asked
    assert drives(source) == []


@played((*DRIVEN, "y", under_way()))
async def test_space_aborts_from_the_help_and_from_the_palette(app, source, pilot) -> None:
    await press(pilot, "question_mark", "space")
    assert source.aborted == 1
    app.pop_screen()
    await press(pilot, "ctrl+p", "escape")
    assert source.aborted == 2


@played(READY)
async def test_the_palette_finds_a_view_and_never_drives(app, source, pilot) -> None:
    await press(pilot, "3", "ctrl+p")
    assert isinstance(app.screen, CommandPalette)
    await press(pilot, *"results")
    await until(app, "view results (7)")
    await press(pilot, "enter", "enter")
    await until(app, "[7 RESULTS]")
    await press(pilot, "3", "ctrl+p", *"drive", "enter", "enter")
    await pilot.pause(0.3)
    assert drives(source) == []


@played(("enter", connected()))
async def test_a_question_is_not_covered_by_the_palette(app, source, pilot) -> None:
    app.push_screen(Question("Is the area clear?", "drive"))
    await pilot.pause()
    await press(pilot, "ctrl+p")
    assert not isinstance(app.screen, CommandPalette)
    assert not isinstance(app.screen, Question), "every key but Y is no"
    assert drives(source) == []


# ---- Texts of a hostile vehicle and of hostile files on every view: nothing in them is obeyed.

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


@played(
    ("enter", connected(), [Ended(Preflight())], TOLD),
    replace(SETUP, url=EVIL, folder=Path("a\x1b[2Jb")),
    (120, 40),
)
async def test_no_view_and_no_question_holds_a_control_character(app, source, pilot) -> None:
    for view in "1234567":
        await press(pilot, view)
        text = text_of(app)
        assert not obeyed(text), [line for line in text.splitlines() if obeyed(line)]
        assert view != "6" or "[red]x[/red]" in text
    app.push_screen(Question(EVIL, EVIL))
    await pilot.pause()
    text = text_of(app)
    assert not obeyed(text) and "\\x1b[2J" in text and "[red]" in text


# ---- The picture of a run's response: the dots stand where the numbers are.

DATA = Path(__file__).parents[1] / "data"
RECORDED = DATA / "concealed-ardurover" / "a" / "run1.BIN"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"


def test_a_falling_line_falls_from_corner_to_corner() -> None:
    drawn = braille_lines([((0.0, 1.0, 2.0), (1.0, 0.5, 0.0))], (0.0, 2.0), (0.0, 1.0), 8, 4)
    first = [row.index(next(c for c in row if c != " ")) for row in drawn]
    assert first == sorted(first) and first[0] == 0
    assert drawn[3][-1] != " " and drawn[0][-1] == " "


@pytest.mark.parametrize("values", [(5.0, 5.0), (float("nan"), 0.5)])
def test_values_outside_and_without_a_number_leave_no_dot(values: tuple[float, float]) -> None:
    assert braille_lines([((1.0, 2.0), values)], (1.0, 2.0), (0.0, 1.0), 4, 2) == ["    ", "    "]


def test_the_axis_has_its_ends_and_decades() -> None:
    row = decades(0.26, 25.0, 60)
    assert row.startswith("0.26") and row.endswith("25") and " 1 " in row and len(row) == 60


def test_a_recorded_run_is_drawn_at_80_by_24() -> None:
    log = read_logs(str(RECORDED))[-1]
    curves = verdict_on_run(runs_of(log)[-1]).curves
    assert [c.response for c in curves][:2] == ["r", "ay"]
    assert all(len(c.w) == len(c.gain) == len(c.phase) == len(c.coherence) <= 80 for c in curves)
    rows = ScreenRows(LIGHT, 80, 19)
    draw_bode(rows, curves[0])
    text = rows.text().plain
    assert "gain dB" in text and "phase deg" in text and "coherence" in text and "25" in text
    assert max(map(len, text.splitlines())) <= 80 and len(text.splitlines()) <= 19


def test_phase_and_gain_are_those_of_the_report_where_the_wheel_angle_is_known() -> None:
    log = read_logs(str(NOMINAL))[-1]
    run = runs_of(log)[-1]
    vehicle = load(DATA / "rover.toml")
    live = verdict_on_run(run, vehicle).curves[0]
    assert (live.response, live.steering) == ("r", "rad")
    f = responses([with_delta(run, vehicle)], input="delta")["r"]
    reported, gain = np.interp(live.w, f.w, unwrapped_phase(f.h, f)), np.interp(live.w, f.w, f.magnitude_db)
    good = np.array(live.coherence) > 0.9
    assert good.sum() > 40
    np.testing.assert_allclose(np.array(live.phase)[good], reported[good], atol=6)
    np.testing.assert_allclose(np.array(live.gain)[good], gain[good], atol=0.7)
    rows = ScreenRows(LIGHT, 80, 19)
    draw_bode(rows, live)
    assert "per rad of wheel angle" in rows.text().plain
    unknown = verdict_on_run(run).curves[0]
    assert unknown.steering == "us"
    turned = (np.array(unknown.phase) - np.array(live.phase)) % 360
    np.testing.assert_allclose(turned[good], 180, atol=0.1)


def test_a_short_window_says_so() -> None:
    curve = ResponseCurve("r", (1.0, 2.0), (0.0, 0.0), (0.0, 0.0), (1.0, 1.0))
    rows = ScreenRows(LIGHT, 80, 6)
    draw_bode(rows, curve)
    assert "too small a window" in rows.text().plain
