"""The picture of a run's response: the dots stand where the numbers are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rover_sweep.api.read import with_delta
from rover_sweep.data.braille import braille_lines
from rover_sweep.data.vehicle_file import load
from rover_sweep.live.source import ResponseCurve
from rover_sweep.live.verdict import verdict_on_run
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.quality.coherence import responses
from rover_sweep.spectra.response import unwrapped_phase
from rover_sweep.tui.drawn import LIGHT, ScreenRows
from rover_sweep.tui.screens.results import decades, draw_bode

DATA = Path(__file__).parents[1] / "data"
RECORDED = DATA / "concealed-ardurover" / "a" / "run1.BIN"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"


def test_a_falling_line_falls_from_corner_to_corner() -> None:
    drawn = braille_lines([((0.0, 1.0, 2.0), (1.0, 0.5, 0.0))], (0.0, 2.0), (0.0, 1.0), 8, 4)
    first = [row.index(next(c for c in row if c != " ")) for row in drawn]
    assert first == sorted(first) and first[0] == 0
    assert drawn[3][-1] != " " and drawn[0][-1] == " "


def test_values_outside_and_without_a_number_leave_no_dot() -> None:
    assert braille_lines([((1.0, 2.0), (5.0, 5.0))], (1.0, 2.0), (0.0, 1.0), 4, 2) == ["    ", "    "]
    assert braille_lines([((1.0, 2.0), (float("nan"), 0.5))], (1.0, 2.0), (0.0, 1.0), 4, 2) == [
        "    ",
        "    ",
    ]


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
