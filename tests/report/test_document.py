"""A document shows each part where its level says, and nothing empty."""

from __future__ import annotations

import base64
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner
from rich.console import Console

from rover_sweep.cli.main import cli
from rover_sweep.comparison.answer import Bode
from rover_sweep.data.recording import Signal
from rover_sweep.report.charts.chart import Chart, ChartPlan, Curve, Panel, Stack
from rover_sweep.report.charts.diagnosis_charts import bode_chart
from rover_sweep.report.document import (
    Badge,
    Cell,
    Document,
    Figures,
    Section,
    Sentence,
    Table,
    charts_of,
    items,
    some,
)
from rover_sweep.report.in_html import in_html, log_page
from rover_sweep.report.on_terminal import on_terminal
from rover_sweep.report.season_report import vehicle_report
from rover_sweep.season.season_result import DayValue, TrackedQuantity, VehicleSeason

X = np.linspace(0.0, 1.0, 5)
PLAN = ChartPlan(
    "line",
    "A line.",
    lambda: Chart((Stack("rise", "t, s", (Panel("y, m", X, (Curve("y", X, "#222222"),)),), (0.0, 1.0)),)),
)
TABLE = Table(
    "Sizes",
    ("what", "size", "why"),
    ((Cell("a", link="a.html"), Cell("1"), Cell("so")),),
    text_columns=(0, 2),
)
DOCUMENT = Document(
    "title",
    "subtitle",
    (Sentence("The <answer>.", "strong", badge=Badge("explained", "good")), *items(["first", "second"])),
    (
        Section("Numbers", (TABLE,), "numbers"),
        Section("More", (Sentence("everything"),), "more", level="full"),
        Section("Page", (Sentence("page only"), Figures((PLAN,))), "page", "closed", level="page"),
        Section("Dots", (Figures((PLAN,), level="terminal"),)),
        Section("Empty", some(None, Table("none", ("a",), ()), Figures(()), Sentence("")), "empty"),
    ),
)


def terminal(full: bool = False, answer_last: bool = False) -> str:
    out = io.StringIO()
    Console(file=out, width=80).print(on_terminal(DOCUMENT, full, answer_last))
    return out.getvalue()


def test_a_terminal_shows_what_is_brief_and_everything_when_asked() -> None:
    text = terminal()
    assert text.startswith("EXPLAINED\nThe <answer>.\n- first\n- second\n\nSizes")
    assert "everything" not in text and "page only" not in text and "Empty" not in text
    assert "⠉" in text or any(0x2800 < ord(c) < 0x28FF for c in text), "the chart in braille"
    assert "everything" in terminal(full=True) and "page only" not in terminal(full=True)
    assert terminal(answer_last=True).rstrip().endswith("- second")


def test_a_page_shows_all_but_the_terminals_own_and_links_what_has_an_address() -> None:
    html = in_html(DOCUMENT)
    assert "The &lt;answer&gt;." in html and '<span class="badge good">explained</span>' in html
    assert "everything" in html and "page only" in html and html.count("<figure") == 1
    assert '<a href="a.html">a</a>' in html and 'href="#more"' in html
    assert "Empty" not in html and "Dots" not in html
    assert '<td class="words ">so</td>' in html and "<caption>" not in html, "the heading says it"
    assert [plan.name for plan in charts_of(DOCUMENT.sections)] == ["line"]


# ---- The page of a log holds its channels and loads nothing.


def channels(html: str) -> dict[str, dict[str, str]]:
    found = re.search(r'id="channels">(.*?)</script>', html, re.S)
    assert found
    return dict(json.loads(found[1]))


def test_the_page_holds_every_channel_in_degrees_since_the_start() -> None:
    t = np.arange(5.0, 9.0)
    html = log_page("<b>log", [{"r": Signal(t, np.full(4, np.pi), "rad/s"), "ay": Signal(t + 1, t, "m/s^2")}])
    found = channels(html)
    assert (found["r"]["unit"], found["ay"]["unit"]) == ("deg/s", "m/s²")
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(found["r"]["x"]), "<f4"), 180.0)
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(found["ay"]["t"]), "<f4"), t - 4)
    assert "holds no channel" in log_page("empty.BIN", [{}])
    assert "<b>log" not in html and not re.search(r"(src|href)=", html.partition("<script")[0])


def test_the_command_writes_the_page(data: Path, tmp_path: Path) -> None:
    page = tmp_path / "run4.html"
    log = data / "ardurover-4.6.3" / "nominal" / "run4.BIN"
    done = CliRunner().invoke(cli, ["view", str(log), "--out", str(page)])
    assert done.exit_code == 0, done.output
    assert {"r", "ay", "p", "speed", "pwm"} <= set(channels(page.read_text(encoding="utf-8")))


# ---- The season's page and the charts of a comparison hold their numbers.


def test_a_vehicles_page_has_a_chart_of_each_quantity() -> None:
    days = ("2026-05-01", "2026-05-02", "2026-05-04")
    numbers: dict[str, Any] = {"value": 3.0, "low": 2.5, "high": 3.5, "fitted": 3.0}
    values = tuple(DayValue(day=day, **numbers) for day in days)
    quantity = TrackedQuantity("Cf", "N/rad", "stiffness", 0.1, values)
    vehicle = VehicleSeason("red", dict.fromkeys(days, ("a.BIN",)), {}, (quantity,))
    html = in_html(vehicle_report(vehicle, {}))
    found = re.search(r'<script type="application/json">(.*?)</script>', html, re.S)
    assert found
    (stack,) = json.loads(found[1])["stacks"]
    assert stack["kind"] == "date" and stack["title"] == "Cf, N/rad"
    assert stack["span"][1] - stack["span"][0] == 5 * 86400


def test_responses_of_a_comparison_are_in_db() -> None:
    w = np.array([1.0, 2.0, 5.0])
    h = np.array([1.0, 10.0, 1j])
    chart = bode_chart([Bode("run", True, "r", w, h, 2 * h, h, np.ones(3), (1.0, 5.0))])
    magnitude, phase, coherence = chart.stacks[0].panels
    np.testing.assert_allclose(magnitude.lines[0].y, [0, 20, 0], atol=1e-9)
    np.testing.assert_allclose(phase.lines[0].y, [0, 0, 90], atol=1e-9)
    assert coherence.label == "coherence"
