"""A document shows each part where its level says, and nothing empty."""

from __future__ import annotations

import io

import numpy as np
from rich.console import Console

from rover_sweep.report.charts.chart import Chart, ChartPlan, Curve, Panel, Stack
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
from rover_sweep.report.in_html import in_html
from rover_sweep.report.on_terminal import on_terminal

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
