"""The curves of an answer agree with its numbers, and the report shows them."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import rover_sweep as rs
from rover_sweep.diagnosis.result import LawCurve
from rover_sweep.report.charts.diagnosis_charts import curves_chart
from rover_sweep.report.diagnosis.report import diagnosis_report
from rover_sweep.report.on_terminal import on_terminal

FOLDER = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "f"  # play in the steering


@pytest.fixture(scope="module")
def found() -> rs.FullDiagnosis:
    runs = rs.read(FOLDER / "run1.BIN", FOLDER / "run2.BIN", vehicle=FOLDER / "rover.toml")
    return rs.diagnose(runs, baseline="roll-yaw", only=["steering_backlash"])


def curve(found: rs.FullDiagnosis, place: str) -> LawCurve:
    return next(c for c in found.curves if c.place == place)


def test_play_is_the_gap_of_the_steering_loop(found: rs.FullDiagnosis) -> None:
    loop = curve(found, "steering")
    half = len(loop.x) // 2
    up, down = np.array(loop.y[:half]), np.array(loop.y[half:])[::-1]
    assert loop.x[:half] == loop.x[half:][::-1]
    gap = found.findings[0].parameters["b"].value
    assert np.median(down - up) == pytest.approx(2.0 * gap, rel=0.01)
    assert np.all(np.array(loop.low) <= loop.y) and np.all(np.array(loop.high) >= loop.y)


def test_the_slope_of_a_tyre_is_its_cornering_stiffness(found: rs.FullDiagnosis) -> None:
    for place, name in (("side force front", "Cf"), ("side force rear", "Cr")):
        tyre = curve(found, place)
        x, y = np.array(tyre.x), np.array(tyre.y)
        middle = np.argsort(np.abs(x))[:5]
        slope = -np.polyfit(x[middle], y[middle], 1)[0]
        number = found.parameters[name]
        assert number.low < slope < number.high
        assert x[0] < 0.0 < x[-1] and y[0] > 0.0 > y[-1]


def test_the_curves_are_in_the_report_and_in_its_json(found: rs.FullDiagnosis, tmp_path: Path) -> None:
    found.report(tmp_path)
    assert rs.load_diagnosis(tmp_path).curves == found.curves
    assert 'id="curves"' in (tmp_path / "diagnosis.html").read_text()
    steering, *tyres = curves_chart(found.curves).stacks
    up, down = (line.y for line in steering.panels[0].lines if line.label == "fitted law")
    assert np.nanmax(down - up) > found.findings[0].parameters["b"].value  # both ways of the loop
    assert len(tyres) == 2 and all(len(stack.panels[0].spreads) == 1 for stack in tyres)


def test_a_terminal_draws_what_bends_and_matplotlib_draws_every_curve(found: rs.FullDiagnosis) -> None:
    console = Console(file=StringIO(), width=80)
    console.print(on_terminal(diagnosis_report(found)))
    drawn = console.file.getvalue()  # type: ignore[attr-defined]
    loop = drawn[drawn.index("steering, rad, over command, rad") :].splitlines()[1:8]
    assert all(line.count("┤") == 1 for line in loop) and any(chr(0x2800) < c for c in loop[3])
    assert "side force front, N" not in drawn  # as straight as its middle
    assert [axes.get_xlabel() for axes in found.plot_curves()] == [
        *("command, rad", "slip angle front, rad", "slip angle rear, rad")
    ]
