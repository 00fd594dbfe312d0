"""On a phone, one finger moves a chart, two zoom it, and a finger up or down scrolls the page."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator

import numpy as np
import pytest
from phone import Phone, Point

from rover_sweep.report.charts.chart import Chart, Curve, Panel, Stack
from rover_sweep.report.charts.static_svg import chart_json, page_script, page_styles

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")


def stack(kind: str) -> Stack:
    x = np.linspace(1.0, 100.0, 500)
    line = Curve("sine", np.sin(x), "#222222")
    return Stack(
        kind, "x", (Panel("y", x, (line,), height=200),), (1.0, 100.0), "log" if kind == "log" else "linear"
    )


@pytest.fixture(scope="module")
def phone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Phone]:
    folder = tmp_path_factory.mktemp("phone")
    figures = "".join(
        f'<figure data-chart><script type="application/json">{chart_json(Chart((stack(kind),)))}</script>'
        '<div class="chart"></div></figure>'
        for kind in ("linear", "log")
    )
    page = folder / "page.html"
    page.write_text(
        '<!DOCTYPE html><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<style>{page_styles()}</style>{figures}<div style='height: 3000px'></div>"
        f"<script>{page_script()}</script>"
    )
    assert CHROMIUM is not None
    found = Phone(CHROMIUM, folder / "profile")
    try:
        found.open(page)
        found.wait("window.plots && plots.length === 2")
        yield found
    finally:
        found.close()


@pytest.fixture(params=[0, 1], ids=["linear", "log"])
def chart(phone: Phone, request: pytest.FixtureRequest) -> int:
    """A chart that shows its whole range, at the top of the page."""
    phone.value(
        "scrollTo(0, 0); document.querySelectorAll('[title=\"whole range\"]').forEach(b => b.click())"
    )
    return int(request.param)


def within(phone: Phone, chart: int, *shares: Point) -> list[Point]:
    """Points at shares of a chart's width and height."""
    left, top, wide, high = phone.value(
        f"(r => [r.left, r.top, r.width, r.height])(plots[{chart}].over.getBoundingClientRect())"
    )
    return [(left + x * wide, top + y * high) for x, y in shares]


def shown(phone: Phone, chart: int) -> tuple[float, float]:
    """Ends of the shown range as shares of the whole: 0, 1 for all."""
    low, high = phone.value(f"[plots[{chart}].scales.x.min, plots[{chart}].scales.x.max]")
    if chart == 1:
        return math.log(low) / math.log(100), math.log(high) / math.log(100)
    return (low - 1) / 99, (high - 1) / 99


def test_two_fingers_apart_zoom_in_about_their_middle(phone: Phone, chart: int) -> None:
    start = within(phone, chart, (0.4, 0.5), (0.6, 0.5))
    phone.gesture(start, within(phone, chart, (0.2, 0.5), (0.8, 0.5)))
    assert shown(phone, chart) == pytest.approx((1 / 3, 2 / 3), abs=0.03)
    assert phone.value("visualViewport.scale") == 1 and phone.value("scrollY") == 0


def test_one_finger_moves_a_zoomed_chart(phone: Phone, chart: int) -> None:
    start = within(phone, chart, (0.4, 0.5), (0.6, 0.5))
    phone.gesture(start, within(phone, chart, (0.2, 0.5), (0.8, 0.5)))
    phone.gesture(within(phone, chart, (0.8, 0.5)), within(phone, chart, (0.2, 0.5)))
    low, high = shown(phone, chart)
    assert high - low == pytest.approx(1 / 3, abs=0.03) and low > 1 / 3 + 0.12


def test_a_finger_up_scrolls_the_page_alone(phone: Phone, chart: int) -> None:
    phone.gesture(within(phone, chart, (0.5, 0.9)), within(phone, chart, (0.5, -0.5)))
    assert phone.value("scrollY") > 50
    assert shown(phone, chart) == pytest.approx((0, 1), abs=1e-6)
